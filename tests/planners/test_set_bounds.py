"""Lower bounds of steps against exhaustive search."""

import itertools

import networkx as nx
import numpy as np
import pytest
from map_data import few_of_a_wall
from paper import NO_COLLISIONS

from mlivr_gym import Settings, stance_graph
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.planners import Planner
from mlivr_gym.planners.query import Goal
from mlivr_gym.planners.set_bounds import SetBounds, fewest_moves


@pytest.fixture(scope="module", params=[(3, 24), (4, 16)])
def stances_and_steps(request):
    """A graph of three or four limbs on a few points of a wall, its stances, and its steps."""
    limbs, count = request.param
    graph = stance_graph(few_of_a_wall(count), f"mlivr{limbs}", NO_COLLISIONS)
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
        goal = Goal.from_arguments(
            graph, np.clip(base[k], *graph.grasp_map.cabin), "steps", None, 0.2
        )
        bound = SetBounds(graph, graph.sets(), goal).steps(rows)
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


def test_a_goal_to_which_no_moves_lead_is_told(stances_and_steps):
    """At once, with no state expanded."""
    graph, rows, _ = stances_and_steps
    planner, base = Planner(graph), graph.postures(rows).base_position
    start = rows[0].tolist()
    goal = np.clip(base.min(axis=0) - 5.0, *graph.grasp_map.cabin)
    found = planner.plan(start, goal, "steps", goal_tolerance=0.01)
    assert found.reason == "goal outside the reachable set"
    assert found.expanded == 0
    assert planner.plan(start, np.clip(base[0], *graph.grasp_map.cabin), "steps").plan is not None


def test_a_start_in_a_given_pose_needs_no_set_in_reach(stances_and_steps):
    """It may have less manipulability than a node: it is at its goal, though no set says so."""
    graph, rows, _ = stances_and_steps
    strict = stance_graph(
        graph.grasp_map, graph.robot, Settings(collisions=False, limb_threshold=0.2)
    )
    (weak, *_) = np.flatnonzero(strict.sets().find(rows) < 0)
    posture = graph.postures(rows[weak : weak + 1])
    pose = [*posture.base_position[0], *quaternion(posture.base_rotation[0])]
    goal = np.clip(posture.base_position[0], *graph.grasp_map.cabin)
    stance, planner = rows[weak].tolist(), Planner(strict)
    assert planner.plan(stance, goal, "steps").reason == "start infeasible"
    found = planner.plan(stance, goal, "steps", start_pose=pose)
    assert found.plan is not None
    assert not found.plan.steps


def test_fewest_moves_are_those_of_networkx(stances_and_steps):
    """From some sets, over sets with a rest in common."""
    graph, _, _ = stances_and_steps
    sets, rng = graph.sets(), np.random.default_rng(0)
    over = nx.Graph()
    over.add_nodes_from(range(len(sets)))
    over.add_edges_from(
        (s, ("support", r)) for s, row in enumerate(sets.support_sets.tolist()) for r in row
    )
    for _ in range(5):
        goals = rng.choice(len(sets), 2, replace=False).tolist()
        moves = np.full(len(sets), -1, dtype=np.int16)
        moves[goals] = 0
        fewest_moves(sets.support_sets, moves, np.zeros(sets.support_set_count, dtype=np.bool_))
        found = nx.multi_source_dijkstra_path_length(over, set(goals), weight=None)
        assert moves.tolist() == [found.get(s, -2) // 2 for s in range(len(sets))]
