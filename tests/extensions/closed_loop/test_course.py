"""A robot follows what it knows while that is possible, and plans anew only where nothing is."""

import numpy as np
import pytest

from mlivr_gym.extensions.closed_loop.belief import Belief
from mlivr_gym.extensions.closed_loop.course import PATIENCE, Course
from mlivr_gym.extensions.closed_loop.hit_cubes import CAUTIONS
from mlivr_gym.planners import Planner, SearchOptions

START, GOAL = ("D2a:4", "D2b:4"), (4.2, 0.0, 0.42)


@pytest.fixture(scope="module")
def planner(graph):
    return Planner(graph)


@pytest.fixture
def course_of(graph, planner):
    """Returns a course whose plans are given in turn, and what it asks for."""

    def made(*answers):
        asked, left = [], iter(answers)

        def plan_from(state, patience):
            asked.append((state, patience))
            return next(left)

        return Course(Belief(graph, 0.003), planner, plan_from), asked

    yield made
    graph.vacate()


def after_step(graph, plan):
    """The state after the first step of a plan."""
    return graph.step_to(graph.state(plan.stances[0]), graph.indices(plan.stances[1]))


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_what_remains_is_followed_without_a_search_until_it_is_blocked(
    graph, planner, course_of, cost
):
    best = planner.plan(START, GOAL, cost)
    start, state = graph.state(START), after_step(graph, best.unwrap())
    rest = planner.plan(state, GOAL, cost).unwrap()
    worse = planner.plan(state, GOAL, cost, options=SearchOptions(method="greedy"))
    assert worse.unwrap().cost > rest.cost + 0.01
    course, asked = course_of(best, worse)
    course.replan(start)
    assert (course.plan, course.taken) == (best.plan, 0)
    course.taken += 1
    found = course.replan(state).unwrap()
    assert (course.plan, course.taken, len(asked)) == (found, 0, 1)
    assert found.stances == best.unwrap().stances[1:]
    assert found.cost == pytest.approx(rest.cost)
    graph.occupy([best.unwrap().actions[1][1]])
    course.replan(state)
    assert (course.plan, course.taken, len(asked)) == (worse.plan, 0, 2)


@pytest.mark.parametrize("is_retry", [False, True])
def test_a_cheaper_plan_replaces_what_remains(graph, planner, course_of, is_retry):
    best, worse = (
        planner.plan(START, GOAL),
        planner.plan(START, GOAL, options=SearchOptions(method="greedy")),
    )
    assert best.unwrap().cost < worse.unwrap().cost
    for first, ahead in ((worse, best), (best, worse)):
        course, _ = course_of(first, ahead)
        course.replan(graph.state(START))
        assert course.plan is first.plan
        course.plan_ahead(graph.state(START))
        course.replan(graph.state(START), is_retry)
        assert course.plan.stances == best.plan.stances


@pytest.mark.parametrize("is_retry", [False, True])
def test_a_plan_of_equal_cost_replaces_another_except_in_a_retry(
    graph, planner, course_of, is_retry
):
    """A limb that was refused tries again before it goes elsewhere."""
    best = planner.plan(START, GOAL, "steps")
    graph.occupy([best.unwrap().actions[0][1]])
    equal = planner.plan(START, GOAL, "steps")
    graph.vacate()
    assert equal.unwrap().cost == best.unwrap().cost
    assert equal.unwrap().actions[0] != best.unwrap().actions[0]
    course, _ = course_of(best, equal)
    course.replan(graph.state(START))
    course.plan_ahead(graph.state(START))
    course.replan(graph.state(START), is_retry)
    assert course.plan.stances == (best if is_retry else equal).plan.stances


def test_where_nothing_is_possible_less_is_believed_before_more_effort_is_spent(
    graph, planner, course_of
):
    best = planner.plan(START, GOAL)
    start, state = graph.state(START), after_step(graph, best.unwrap())
    late = planner.plan(start, GOAL, options=SearchOptions(limit=1))
    assert late.plan is None
    course, asked = course_of(best, *[late] * (len(CAUTIONS) + 1))
    course._belief.add_hits(np.array([[6.0, 0.0, 0.0]]), graph.configuration(start))
    course.replan(start)
    course.taken += 1
    graph.occupy([best.unwrap().actions[1][1]])
    course.replan(state)
    assert course.plan is None
    efforts = [patience for _, patience in asked]
    assert efforts == [1.0] + [1.0] * len(CAUTIONS) + [PATIENCE]


def test_a_plan_found_ahead_is_followed_while_it_is_possible(graph, planner, course_of):
    """What comes is checked along it, and nothing is sought again; what goes may open another."""
    first = planner.plan(START, GOAL)
    start, state = graph.state(START), after_step(graph, first.unwrap())
    ahead = planner.plan(state, GOAL)
    graph.occupy([ahead.unwrap().actions[-1][1]])
    again = planner.plan(state, GOAL)
    graph.vacate()
    course, asked = course_of(first, ahead, ahead, again)
    course.replan(start)
    assert course.plan_ahead(state)
    assert not course.plan_ahead(state)  # nothing is left to do
    used = {point for stance in ahead.plan.stances for point in stance}
    spare = min(set(graph.grasp_map.ids) - used)
    graph.occupy([spare])
    assert course.plan_ahead(state)  # whether it is still possible
    assert len(asked) == 2
    course.taken += 1
    found = course.replan(state).unwrap()
    assert found.stances == ahead.plan.stances
    assert found.world.occupied == (spare,)
    graph.vacate()
    assert course.plan_ahead(state)
    assert asked[2:] == [(state, 1.0)]
    graph.occupy([ahead.unwrap().actions[-1][1]])  # it is blocked
    assert course.replan(state) is again


def test_that_no_plan_was_found_ahead_is_believed_until_it_would_end_the_walk(graph, planner):
    """A long proof is not repeated at each look, but the last one holds in the present world."""
    asked = []

    def plan_from(state, _):
        asked.append(graph.version)
        return planner.plan(state, GOAL)

    start, belief = graph.state(START), Belief(graph, 0.003)
    goal = planner.plan(START, GOAL).unwrap().stances[-1]
    others = set(graph.grasp_map.ids) - set(START)
    course = Course(belief, planner, plan_from)
    try:
        graph.occupy(sorted(others))
        assert course.plan_ahead(start)
        graph.occupy(["D2b:5"])
        assert not course.plan_ahead(start)
        version = graph.version
        result = course.replan(start)
        assert (result.reason, course.plan) == ("search exhausted", None)
        assert asked == [version - 1, version]
        graph.vacate([goal[0]])
        assert course.plan_ahead(start)  # it may be another now
    finally:
        graph.vacate()
