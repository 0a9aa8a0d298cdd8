"""Heuristics of costs: which are lower bounds."""

import gymnasium
import numpy as np
import pytest

from mlivr_gym.errors import SettingError
from mlivr_gym.motion import Plan
from mlivr_gym.planners import Planner
from mlivr_gym.planners.costs import Cost


def test_heuristics_never_overestimate_and_the_papers_does(small_graph):
    graph = small_graph
    goal = np.array([2.5, 0.0, -0.3])
    distance = np.linalg.norm(graph.base_position - goal, axis=1)
    over = 0
    for name in ("base", "steps"):
        truth = Planner(graph).cost_to_go(goal, name).values
        ours = Cost.named(name).heuristic("consistent", distance, 0.2, graph.max_displacement)
        assert (ours <= truth + 1e-9).all()
        steps = np.random.default_rng(0).integers(0, len(graph), 10)
        for s in steps:
            for t in np.flatnonzero(graph.points[:, 0] == graph.points[s, 0]):
                moved = np.linalg.norm(graph.base_position[s] - graph.base_position[t])
                edge = moved if name == "base" else 1.0
                assert ours[s] <= edge + ours[t] + 1e-9
        over += (
            Cost.named(name).heuristic("paper", distance, 0.2, graph.max_displacement)
            > truth + 1e-9
        ).sum()
    assert over > 0


@pytest.mark.parametrize("count", [2, 10_000])
def test_prices_of_another_number_of_points_are_refused(small_graph, count):
    cost, points = Cost.custom(base_weight=1.0, prices=np.ones(count)), len(small_graph.grasp_map)
    with pytest.raises(SettingError, match=f"{count} numbers; the map has {points} points"):
        Planner(small_graph).plan((0, 1), (2.5, 0.0, -0.3), cost)
    with pytest.raises(SettingError, match=f"{count} numbers; the map has {points} points"):
        Planner(small_graph).cost_to_go((2.5, 0.0, -0.3), cost)
    with pytest.raises(SettingError, match=f"{count} numbers; the map has {points} points"):
        gymnasium.make("mlivr_gym:MLIVR-JEM-v0", map=small_graph.grasp_map, reward=cost)


def test_the_plan_of_a_cost_without_a_name_can_be_read_back(small_graph, tmp_path):
    """Whether it is made by `Cost.custom` or by its fields."""
    here = small_graph.points[0].tolist()
    goal = small_graph.base_position[-1]
    assert {cost.name for cost in map(Cost.named, ("base", "steps"))} == {"base", "steps"}
    for cost in (Cost(prices=lambda stances, points: 0.5 * (points % 3)), Cost(base_weight=2.0)):
        plan = Planner(small_graph).plan(here, goal, cost).unwrap()
        assert plan.query.cost_name == cost.name == "custom"
        plan.save(tmp_path / "plan.json")
        assert Plan.load(tmp_path / "plan.json").steps == plan.steps
