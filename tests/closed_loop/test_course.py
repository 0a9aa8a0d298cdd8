"""A robot keeps what remains of its plan while that is cheaper than a new plan and possible."""

import numpy as np
import pytest

from mlivr_gym import stance_graph
from mlivr_gym.closed_loop.belief import Belief
from mlivr_gym.closed_loop.cautions import CAUTIONS
from mlivr_gym.closed_loop.course import AT_ONCE, PATIENCE, Course
from mlivr_gym.planners import Planner

START, GOAL = ("D2a:4", "D2b:4"), (4.2, 0.0, 0.42)


@pytest.fixture(scope="module")
def graph(jem):
    return stance_graph(jem)


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_a_longer_plan_replaces_what_remains_only_if_that_is_blocked(graph, cost):
    planner = Planner(graph)
    best = planner.plan(START, GOAL, cost)
    # After the first step a search without time for more goes back to the start and on from there.
    limb, point = best.unwrap().actions[0]
    start = graph.state(best.unwrap().stances[0])
    moves = graph.successors(start)
    state = moves.after(start, moves.find(limb, graph.grasp_map.index(point)))
    rest = planner.plan(state, GOAL, cost).unwrap()
    worse = planner.plan(state, GOAL, cost, method="greedy")
    assert worse.unwrap().cost > rest.cost + 0.01
    answers = iter([best, worse, worse])
    course = Course(Belief(graph, 0.003), lambda *_: next(answers))
    course.replan(start)
    assert (course.plan, course.taken, course.is_new) == (best.plan, 0, True)
    course.taken += 1
    assert course.replan(state) is worse
    # Its swings were checked among the obstacles of then, so they are not those to follow.
    assert (course.plan, course.taken, course.is_new) == (best.plan, 1, False)
    graph.occupy([best.unwrap().actions[1][1]])
    course.replan(state)
    graph.vacate()
    assert (course.plan, course.taken, course.is_new) == (worse.plan, 0, True)


def test_a_cheaper_plan_replaces_what_remains(graph):
    planner = Planner(graph)
    best, worse = planner.plan(START, GOAL), planner.plan(START, GOAL, method="greedy")
    assert best.unwrap().cost < worse.unwrap().cost
    answers = iter([worse, best])
    course = Course(Belief(graph, 0.003), lambda *_: next(answers))
    for found in (worse, best):
        course.replan(graph.state(START))
        assert course.plan is found.plan


def test_a_plan_of_equal_cost_replaces_another_except_in_a_retry(graph):
    """A limb that was refused tries again before it goes elsewhere."""
    planner = Planner(graph)
    best = planner.plan(START, GOAL, "steps")
    graph.occupy([best.unwrap().actions[0][1]])
    equal = planner.plan(START, GOAL, "steps")
    graph.vacate()
    assert equal.unwrap().cost == best.unwrap().cost
    assert equal.unwrap().actions[0] != best.unwrap().actions[0]
    for is_retry, followed in ((False, equal), (True, best)):
        answers = iter([best, equal])
        course = Course(Belief(graph, 0.003), lambda *_, answers=answers: next(answers))
        course.replan(graph.state(START))
        course.replan(graph.state(START), is_retry)
        assert course.plan is followed.plan


def test_what_remains_is_followed_if_no_plan_is_found_in_time(graph):
    planner = Planner(graph)
    best = planner.plan(START, GOAL)
    limb, point = best.unwrap().actions[0]
    start = graph.state(best.unwrap().stances[0])
    moves = graph.successors(start)
    state = moves.after(start, moves.find(limb, graph.grasp_map.index(point)))
    late = planner.plan(start, GOAL, limit=1)
    assert late.plan is None
    answers, asked = iter([best, *[late] * (len(CAUTIONS) + 2)]), []

    def plan_from(_, patience):
        asked.append(patience)
        return next(answers)

    belief = Belief(graph, 0.003)
    belief.add_hits(np.array([[6.0, 0.0, 0.0]]), graph.configuration(start))
    course = Course(belief, plan_from)
    course.replan(start)
    course.taken += 1
    course.replan(state)
    assert (course.plan, course.taken, asked) == (best.plan, 1, [1.0, AT_ONCE])
    graph.occupy([best.unwrap().actions[1][1]])
    course.replan(state)  # among smaller boxes, too, and then for longer
    graph.vacate()
    assert (course.plan, asked[2:]) == (None, [1.0] * len(CAUTIONS) + [PATIENCE])


def test_what_was_planned_ahead_is_followed_if_nothing_has_changed(graph):
    planner, asked = Planner(graph), []

    def plan_from(state, _):
        asked.append(state)
        return planner.plan(state, GOAL)

    course, start = Course(Belief(graph, 0.003), plan_from), graph.state(START)
    first = course.replan(start).unwrap()
    limb, point = first.actions[0]
    moves = graph.successors(start)
    state = moves.after(start, moves.find(limb, graph.grasp_map.index(point)))
    assert course.plan_ahead(state)
    assert not course.plan_ahead(state)  # nothing is left to do
    course.taken += 1
    rest = course.replan(state).unwrap()
    assert asked == [start, state]
    assert rest.cost == pytest.approx(planner.plan(state, GOAL).unwrap().cost)
    assert course.plan_ahead(start)
    graph.occupy([first.actions[1][1]])
    try:
        assert course.plan_ahead(start)
        graph.vacate()
        course.replan(start)
    finally:
        graph.vacate()
    assert asked == [start, state, start, start, start]


def test_that_no_plan_was_found_ahead_is_believed_until_it_would_end_the_walk(graph):
    """A long proof is not repeated at each look, but the last one holds in the present world."""
    asked, planner = [], Planner(graph)

    def plan_from(state, _):
        asked.append(graph.version)
        return planner.plan(state, GOAL)

    start, belief = graph.state(START), Belief(graph, 0.003)
    goal = planner.plan(START, GOAL).unwrap().stances[-1]
    others = set(graph.grasp_map.ids) - set(START)
    course = Course(belief, plan_from)
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


def test_a_robot_that_knows_a_step_does_not_wait_for_a_long_search(graph):
    """What was planned ahead is followed while it is possible, else a search without limit."""
    planner, asked = Planner(graph), []

    def plan_from(state, patience):
        asked.append(patience)
        how = {"limit": 1} if patience == AT_ONCE else {}
        return planner.plan(state, GOAL, "steps", **how)

    start, state_points = graph.state(START), set(START)
    for taken in (False, True):
        course = Course(Belief(graph, 0.003), plan_from)
        try:
            assert course.plan_ahead(start)
            ahead = course._forecast.result.plan
            points = {point for _, point in ahead.actions}
            spare = set(graph.grasp_map.ids) - state_points - points
            graph.occupy([ahead.actions[-1][1] if taken else min(spare)])
            course.replan(start)
            if taken:
                assert course.is_new
                assert course.plan is not ahead
            else:  # its swings were found in the world of then
                assert not course.is_new
                assert course.plan is ahead
        finally:
            graph.vacate()
    assert asked == [1.0, AT_ONCE, 1.0, 1.0]
