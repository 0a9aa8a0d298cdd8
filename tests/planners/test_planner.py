"""The planner: optimal plans, why there is none, and plans as files."""

import numpy as np
import pytest
from paper import NO_COLLISIONS

from mlivr_gym import stance_graph
from mlivr_gym.errors import GoalError, PlanError, SettingError
from mlivr_gym.planners import Planner, SearchOptions


def test_no_path_says_why(graph, jem):
    planner = Planner(graph)
    start = ("D1a:4", "D1b:4")
    result = planner.plan(("D1a:4", "D2b:4"), (6.0, 0.0, 0.42))
    assert (result.reason, bool(result)) == ("start infeasible", False)
    assert "limb manipulability" in result.message
    assert (result.expanded, result.generated, len(result.tree)) == (0, 0, 0)
    result = planner.plan(start, (9.5, 0.0, 0.0))
    assert result.reason == "goal outside the reachable set"
    assert "[9.5, 0.0, 0.0]" in result.message
    result = planner.plan(
        start, (6.0, 0.0, 0.42), options=SearchOptions(heuristic="zero", limit=10)
    )
    assert result.reason == "limit reached"
    assert result.expanded == 10
    with pytest.raises(PlanError, match="limit reached"):
        result.unwrap()
    far = {"D1a", "D1b", "D6a", "D6b", "F6a", "F6b"}
    split = jem.subset(np.array([point.split(":")[0] in far for point in jem.ids]), "split")
    result = Planner(stance_graph(split, settings=NO_COLLISIONS)).plan(start, (6.6, 0.0, -0.4))
    assert result.reason == "goal outside the reachable set"


def test_a_search_that_is_cut_short_promises_no_more_than_it_proved(graph):
    rng, bounds, factor, none = np.random.default_rng(3), [], 1.2, 0
    for _ in range(22):
        first, last = rng.integers(len(graph), size=2)
        start, goal = graph.ids(graph.points[first]), graph.base_position[last]
        best = Planner(graph).plan(start, goal).plan
        for limit in (8, 17, 10_000):
            options = SearchOptions(inflation=factor, limit=limit)
            cut = Planner(graph).plan(start, goal, options=options).plan
            none += cut is None
            if cut is not None:
                bounds.append(cut.statistics.bound)
                assert cut.cost <= bounds[-1] * best.cost * (1.0 + 1e-9)
    assert 1.0 < max(bounds) <= factor
    assert none  # the limit came first


def test_bad_arguments_are_named(graph):
    planner, start, goal = Planner(graph), ("D1a:4", "D1b:4"), (6.0, 0.0, 0.42)
    for error, words, change in (
        (SettingError, "regrasp_price", {"cost": "weighted"}),
        (SettingError, "regrasp_price", {"regrasp_price": 0.1}),
        (GoalError, "outside the cabin", {"goal": (60.0, 0.0, 0.0)}),
    ):
        with pytest.raises(error, match=words):
            planner.plan(**({"start": start, "goal": goal} | change))
    for words, options in (
        ("greedy", {"method": "greedy", "heuristic": "zero"}),
        ("now called 'relaxed'", {"heuristic": "cost_to_go"}),
    ):
        with pytest.raises(SettingError, match=words):
            planner.plan(start, goal, options=SearchOptions(**options))
    many = Planner(stance_graph(graph.grasp_map, "mlivr3", NO_COLLISIONS))
    with pytest.raises(SettingError, match="two limbs"):
        many.cost_to_go(goal)


def test_start_inside_the_goal_is_a_plan_without_steps(graph):
    start = graph.state(("D1a:4", "D1b:4"))
    here = graph.posture(start.stance).base_position[0]
    plan = Planner(graph).plan(start.stance, here).unwrap()
    assert plan.steps == ()
    assert plan.statistics.cost == 0.0
    assert plan.base_translation == 0.0
