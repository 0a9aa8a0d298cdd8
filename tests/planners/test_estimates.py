"""What a search has learnt of a goal, and how long it holds."""

import numpy as np
import pytest

from mlivr_gym import Box, stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.planners import Planner


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_what_is_learnt_among_obstacles_is_forgotten_with_them(small_map, monkeypatch, cost):
    """After they are gone plans cost what they cost a planner that never saw them."""
    monkeypatch.setattr("mlivr_gym.planners.searches.PATIENCE", 1)
    monkeypatch.setattr("mlivr_gym.planners.searches.SHARE", 0.0)
    graph, rng, dearer = stance_graph(small_map), np.random.default_rng(0), 0
    planner = Planner(graph)
    for _ in range(10):
        start, goal = sample_task(graph, rng, 0.3)
        middle = 0.5 * (graph.posture(start.stance).base_position[0] + goal)
        graph.add_obstacles([Box.between("crate", "obstacle", middle - 0.15, middle + 0.15)])
        graph.occupy(rng.choice(len(small_map), 4, replace=False).tolist())
        among = planner.plan(start.stance, goal, cost).plan
        graph.remove_obstacles()
        graph.vacate()
        plan = planner.plan(start.stance, goal, cost).unwrap()
        fresh = Planner(graph).plan(start.stance, goal, cost).unwrap()
        assert plan.statistics.cost == pytest.approx(fresh.statistics.cost, abs=1e-9)
        dearer += among is None or among.statistics.cost > fresh.statistics.cost + 1e-9
    assert dearer > 2
