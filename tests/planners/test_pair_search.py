"""The compiled search: A* against Dijkstra and greedy search, and the order of its queue."""

import heapq

import numpy as np
import pytest

from mlivr_gym.planners import Planner
from mlivr_gym.planners.heap import sift_down, sift_up

COSTS = [("base", None), ("steps", None), ("weighted", 0.1)]


@pytest.mark.parametrize(("cost", "price"), COSTS)
def test_astar_equals_dijkstra_on_the_whole_module(graph, cost, price):
    planner, rng = Planner(graph), np.random.default_rng(2)
    for _ in range(4):
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


def test_ties_prefer_what_is_further_along(small_map):
    """Equal f: larger g first, then the earlier entry; compared with a heap of the library."""
    rng = np.random.default_rng(0)
    f, g = rng.integers(0, 4, 300).astype(float), rng.integers(0, 4, 300).astype(float)
    heap, size, plain = np.empty(300, dtype=np.int64), 0, []
    for k in range(300):
        heap[size] = k
        size += 1
        sift_up(heap, size, f, g)
        heapq.heappush(plain, (f[k], -g[k], k))
    while size:
        assert heap[0] == heapq.heappop(plain)[2]
        size -= 1
        if size:
            heap[0] = heap[size]
            sift_down(heap, size, f, g)
