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
    other = planner.plan(state, GOAL, {"steps": "base", "base": "steps"}[cost])
    assert other.unwrap().stances != rest.stances
    course, asked = course_of(best, other)
    course.replan(start)
    assert (course.plan, course.taken) == (best.plan, 0)
    course.taken += 1
    found = course.replan(state).unwrap()
    assert (course.plan, course.taken, len(asked)) == (found, 0, 1)
    assert found.stances == best.unwrap().stances[1:]
    assert found.cost == pytest.approx(rest.cost)
    graph.occupy([best.unwrap().actions[1][1]])
    course.replan(state)
    assert (course.plan, course.taken, len(asked)) == (other.plan, 0, 2)


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
