"""The search over any number of limbs against the compiled one."""

import numpy as np
import pytest

from mlivr_gym.planners import Planner
from mlivr_gym.stances.lazy_graph import LazyGraph


def test_compiled_and_plain_search_agree(small_map, small_graph):
    lazy = Planner(LazyGraph(small_map, small_graph.robot, small_graph.settings))
    ours, rng = Planner(small_graph), np.random.default_rng(3)
    for cost in ("base", "steps"):
        for _ in range(3):
            s, g = (int(v) for v in rng.integers(0, len(small_graph), 2))
            goal = np.clip(small_graph.base_in_world[g], *small_map.cabin)
            start = small_graph.points[s].tolist()
            a = ours.plan(start, goal, cost).plan
            b = lazy.plan(start, goal, cost, heuristic="consistent", inflation=1.0).plan
            assert (a is None) == (b is None)
            if a is not None:
                assert a.cost == pytest.approx(b.cost, abs=1e-9)
