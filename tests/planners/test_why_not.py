"""Why there is no plan: the rule that is named lets a plan through when it goes."""

from dataclasses import replace

import numpy as np
import pytest
from unreachable import unreachable

from mlivr_gym import Settings, stance_graph
from mlivr_gym.planners import Planner, why_not
from mlivr_gym.planners.planning_result import NO_SWING
from mlivr_gym.planners.query import Goal
from mlivr_gym.planners.why_not import OBSTACLES, RULES
from mlivr_gym.stances.random_states import random_state


@pytest.fixture(scope="module")
def sparse_graph(jem):
    few = np.random.default_rng(0).random(len(jem)) < 0.35
    return stance_graph(jem.subset(few, "sparse"))


def test_nothing_cuts_off_a_goal_that_can_be_reached(checked_graph):
    """Whatever was left out, a plan would exist: so there has to be one with all rules first."""
    planner, query = Planner(checked_graph), (("D2a:4", "D2b:4"), (6.0, 0.0, 0.42))
    plan = planner.plan(*query, "steps").unwrap()
    cause = planner.why_not(*query)
    assert cause.message.startswith("nothing cuts the goal off")
    assert f"there is a plan of {len(plan.steps)} steps" in cause.message
    assert cause.rules == ()
    at_goal = planner.why_not(query[0], plan.motion.base_positions[0])
    assert "a plan of 0 steps" in at_goal.message


def test_nothing_is_blamed_where_the_limit_ends_the_search(jem):
    """With three limbs a rule that is left out makes a search shorter, too."""
    graph = stance_graph(jem, "mlivr3")
    planner, goal = Planner(graph), (1.5, 0.0, 0.0)
    start = random_state(graph, np.random.default_rng(3))
    expanded = planner.plan(start, goal, "steps", goal_tolerance=0.6).expanded
    for limit in (1, expanded // 2):
        cause = planner.why_not(start, goal, goal_tolerance=0.6, limit=limit)
        assert cause.rules == ()
        assert cause.message.startswith(f"limit reached after {limit} expansions, no path from")
        assert cause.message.endswith("a larger limit may tell whether there is one")
    cause = planner.why_not(start, goal, goal_tolerance=0.6, limit=10 * expanded)
    assert "there is a plan of" in cause.message


def test_that_no_rule_helps_is_told_only_if_it_is_proved(small_map, monkeypatch):
    graph = stance_graph(small_map)
    start, far = graph.state(graph.points[0].tolist()), graph.base_position.argmax(axis=0)[0]
    goal = Goal.from_arguments(graph, graph.base_position[far], "steps", None, 0.0)
    assert why_not.is_plan_found(graph, start, goal, 10**6)
    assert why_not.is_plan_found(graph, start, goal, 1) is None
    for found, words in ((False, "no path of this robot leads"), (None, "found by 7 expansions")):
        monkeypatch.setattr(why_not, "_plan_exists", lambda *_, found=found: found)
        assert words in why_not.find_cause(graph, start, goal, 7).message


@pytest.mark.parametrize("face", [None, "overhead"])
def test_a_goal_far_from_all_stances_is_refused_with_the_nearest_distance(checked_graph, face):
    """In the plan's own message, too, and with the largest distance that is refused."""
    graph, start, goal = checked_graph, ("D2a:4", "D2b:4"), (8.0, 0.0, 0.0)
    planner = Planner(graph)
    on_face = np.array([face is None or one == face for one in graph.grasp_map.faces])
    bases = graph.base_position[on_face[graph.points].all(axis=1)]
    nearest = min(np.sqrt(((base - goal) ** 2).sum()) for base in bases)
    for found in (
        planner.plan(start, goal, goal_face=face),
        planner.why_not(start, goal, goal_face=face),
    ):
        assert f"the nearest is {nearest:.3f} m away" in found.message
        assert f"of goal {list(goal)}" in found.message
        told = float(found.message.split("goal_tolerance of ")[1].split(" m")[0])
        assert nearest <= told < nearest + 1e-3
    below, above = (
        planner.plan(start, goal, goal_face=face, goal_tolerance=nearest + d) for d in (-1e-4, 1e-3)
    )
    assert "the nearest is" in below.message
    assert "the nearest is" not in above.message


@pytest.mark.parametrize("seed", range(4))
def test_without_the_rules_named_there_is_a_plan_and_with_fewer_there_is_none(sparse_graph, seed):
    graph = sparse_graph
    start, goal = unreachable(graph, np.random.default_rng(seed))
    cause = Planner(graph).why_not(start, goal, goal_tolerance=0.05)
    if not cause.rules:
        assert "whatever rule is left out" in cause.message
        return
    changes = {key: value for name in cause.rules for key, value in RULES[name][0].items()}

    def leads(settings):
        other = stance_graph(graph.grasp_map, settings=settings)
        found = Planner(other).plan(start.stance, goal, "steps", goal_tolerance=0.05)
        # Where steps are not checked there may be a path of stances that no swing can follow.
        return bool(found) or found.reason == NO_SWING

    assert leads(replace(Settings(), **changes))
    assert all(name in cause.message for name in cause.rules)
    if len(cause.rules) == 1:
        assert RULES[cause.rules[0]][1] in cause.message


def test_occupied_points_alone_may_cut_a_goal_off(small_checked_graph):
    """All points are, but those of the first and the last stance of a plan."""
    graph = small_checked_graph
    planner, start = Planner(graph), graph.points[0].tolist()
    goals = graph.base_position[::7]
    plans = [planner.plan(start, goal, "steps", goal_tolerance=0.0).plan for goal in goals]
    plan = max(filter(None, plans), key=lambda one: len(one.steps))
    assert len(plan.steps) > 3
    ends = {*plan.stances[0], *plan.stances[-1]}
    graph.occupy([point for point in graph.grasp_map.ids if point not in ends])
    cause = planner.why_not(start, plan.query.goal, goal_tolerance=0.0)
    graph.vacate()
    assert cause.rules == (OBSTACLES,)


def test_rules_are_left_out_with_the_robot_where_it_is(small_checked_graph):
    """At a goal that it has reached, beside the posture of its stance."""
    graph = small_checked_graph
    position, quaternion, _ = graph.configuration(graph.state(graph.points[0].tolist()))
    beside = position + np.array([0.0, 0.0, 0.005])
    start = graph.state(graph.points[0].tolist(), (*beside, *quaternion))
    goal = Goal.from_arguments(graph, beside, "steps", None, 0.001)
    assert why_not.is_plan_found(graph, start, goal, 100)
