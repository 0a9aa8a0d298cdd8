"""The compiled search: A* against Dijkstra and greedy search."""

import numpy as np
import pytest
from paper import NO_COLLISIONS

from mlivr_gym import stance_graph
from mlivr_gym.planners import Planner

COSTS = [("base", None), ("steps", None), ("weighted", 0.1)]


@pytest.fixture(scope="module")
def sparse_graph(jem):
    """A third of the points, on all faces: a ninth of the stances."""
    points = np.random.default_rng(0).permutation(len(jem))[: len(jem) // 3]
    return stance_graph(
        jem.subset(np.isin(np.arange(len(jem)), points), "third"), settings=NO_COLLISIONS
    )


@pytest.mark.parametrize(("cost", "price"), COSTS)
def test_astar_equals_dijkstra(sparse_graph, cost, price):
    compare(sparse_graph, cost, price)


@pytest.mark.slow
@pytest.mark.parametrize(("cost", "price"), COSTS)
def test_astar_equals_dijkstra_on_the_whole_module(graph, cost, price):
    compare(graph, cost, price)


def compare(graph, cost, price):
    """A* with all its heuristics, Dijkstra, and searches that may cost more."""
    planner, rng = Planner(graph), np.random.default_rng(2)
    for _ in range(2):
        s, g = (int(v) for v in rng.integers(0, len(graph), 2))
        goal = np.clip(graph.base_in_world[g], *graph.grasp_map.cabin)
        start = graph.points[s].tolist()
        costs = [
            planner.plan(start, goal, cost, regrasp_price=price, **how).unwrap().statistics.cost
            for how in ({}, {"heuristic": "consistent"}, {"method": "dijkstra"})
        ]
        planner.prepare(goal, cost, regrasp_price=price)
        costs.append(planner.plan(start, goal, cost, regrasp_price=price).unwrap().statistics.cost)
        assert np.ptp(costs) < 1e-9
        greedy = planner.plan(start, goal, cost, regrasp_price=price, method="greedy").unwrap()
        inflated = planner.plan(
            start, goal, cost, regrasp_price=price, heuristic="consistent", inflation=1.5
        ).unwrap()
        assert greedy.cost >= costs[0] - 1e-9
        assert costs[0] - 1e-9 <= inflated.cost <= 1.5 * costs[0] + 1e-9
