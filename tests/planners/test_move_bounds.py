"""Lower bounds of steps against exhaustive search."""

import itertools

import networkx as nx
import numpy as np
import pytest
from paper import NO_COLLISIONS

from mlivr_gym import stance_graph
from mlivr_gym.planners.move_bounds import MoveBounds, partitions
from mlivr_gym.planners.query import Goal
from mlivr_gym.world.grasp_map import jem_map


@pytest.fixture(scope="module", params=[(3, 24), (4, 16)])
def stances_and_steps(request):
    """A graph of three or four limbs on a few points of a wall, its stances, and its steps."""
    limbs, count = request.param
    jem = jem_map()
    chosen = np.flatnonzero((np.array(jem.faces) == "forward") & (jem.positions[:, 0] < 5.5))
    chosen = chosen[np.linspace(0, len(chosen) - 1, count).astype(int)]
    few = jem.subset(np.isin(np.arange(len(jem)), chosen), "few")
    graph = stance_graph(few, f"mlivr{limbs}", NO_COLLISIONS)
    rows = np.array(list(itertools.permutations(range(count), limbs)))
    rows = rows[graph.is_node(graph.nodes(rows))]
    steps = nx.Graph()
    steps.add_nodes_from(range(len(rows)))
    for limb in range(limbs):
        others = np.delete(rows, limb, axis=1)
        _, group = np.unique(others, axis=0, return_inverse=True)
        for k in range(group.max() + 1):
            steps.add_edges_from(itertools.combinations(np.flatnonzero(group == k).tolist(), 2))
    return graph, rows, steps


def test_bounds_of_steps_are_admissible_and_consistent(stances_and_steps):
    """Never above the fewest steps between nodes, and no step changes them by more than one."""
    graph, rows, steps = stances_and_steps
    base, rng, useful = graph.postures(rows).base_position, np.random.default_rng(0), 0
    for k in rng.integers(0, len(rows), 12):
        goal = Goal.checked(graph, np.clip(base[k], *graph.grasp_map.cabin), "steps", None, 0.2)
        bound = MoveBounds(graph, goal).steps(rows)
        goals = set(np.flatnonzero(goal.reached(base, rows)).tolist())
        if not goals:
            continue
        fewest = nx.multi_source_dijkstra_path_length(steps, goals, weight=None)
        for row, count in fewest.items():
            assert bound[row] <= count
            useful += bound[row] > 1
        ends = np.array(steps.edges)
        assert (np.abs(np.diff(bound[ends], axis=1)) <= 1.0).all()
    assert useful


def test_partitions_are_all_there_are_into_pairs():
    for count, number in ((2, 1), (3, 3), (4, 3), (5, 15), (6, 15)):
        found = list(partitions(tuple(range(count))))
        assert len({frozenset(map(frozenset, one)) for one in found}) == len(found) == number
        for one in found:
            assert sorted(itertools.chain(*one)) == list(range(count))
            assert sorted(map(len, one)) == [1] * (count % 2) + [2] * (count // 2)
