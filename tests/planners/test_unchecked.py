"""Costs where steps are not checked against Dijkstra's search of another library."""

import networkx as nx
import numpy as np
import pytest

from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.estimates import unchecked

COSTS = [("steps", None), ("base", None), ("weighted", 0.1)]


def every_pair(graph, nodes, cost):
    """Stances joined with those that share the point of a limb, whatever lies between."""
    out = nx.Graph()
    out.add_nodes_from(nodes)
    for k, s in enumerate(nodes):
        for s2 in nodes[k + 1 :]:
            if (graph.points[s] == graph.points[s2]).any():
                away = np.linalg.norm(graph.base_in_world[s] - graph.base_in_world[s2])
                out.add_edge(s, s2, weight=cost.base_weight * away + cost.step_weight)
    return out


@pytest.fixture(scope="module")
def some(small_graph):
    """A third of the stances, so that some lie apart; the others have no branch."""
    keep = np.random.default_rng(0).choice(len(small_graph), len(small_graph) // 3, replace=False)
    mask = small_graph.mask.copy()
    gone = np.ones(len(small_graph), dtype=bool)
    gone[keep] = False
    small_graph.mask[gone] = 0
    yield small_graph
    small_graph.mask[:] = mask


@pytest.mark.parametrize(("name", "price"), COSTS)
def test_costs_are_the_least_where_every_pair_of_stances_that_share_a_point_is_a_step(
    some, name, price
):
    cost, n = Cost.named(name, price), len(some)
    nodes = np.flatnonzero(some.mask[:, 0]).tolist()
    truth = every_pair(some, nodes, cost)
    goal = np.zeros(n, dtype=bool)
    goal[[nodes[0], nodes[-1], int(np.flatnonzero(some.mask[:, 0] == 0)[0])]] = True
    lengths = nx.multi_source_dijkstra_path_length(truth, {nodes[0], nodes[-1]})
    expected = [lengths.get(s, np.inf) for s in range(n)]
    np.testing.assert_allclose(unchecked(some, goal, cost), expected, atol=1e-9)


@pytest.mark.parametrize(("name", "price"), COSTS[1:])
def test_a_search_that_stops_at_the_start_has_its_cost(small_graph, name, price):
    cost, rng = Cost.named(name, price), np.random.default_rng(1)
    for start, end in rng.integers(0, len(small_graph), (20, 2)):
        goal = np.arange(len(small_graph)) == end
        away = np.linalg.norm(small_graph.base_in_world - small_graph.base_in_world[start], axis=1)
        found = unchecked(small_graph, goal, cost, int(start), cost.base_weight * away)
        whole = unchecked(small_graph, goal, cost)
        assert found[start] == pytest.approx(whole[start], abs=1e-9)
