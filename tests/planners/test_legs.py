"""Plans along a route: walks of the graph past its places, and what is done about a failed leg."""

from types import SimpleNamespace

import numpy as np
import pytest
from walk_steps import count_steps

from mlivr_gym import stance_graph
from mlivr_gym.errors import GoalError, SettingError
from mlivr_gym.planners import Planner, corridor, legs
from mlivr_gym.planners.corridor import plan_in_corridor
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.outcome import GOAL_REACHED, LIMIT_REACHED, SearchResult
from mlivr_gym.planners.query import Goal, SearchQuery

START, GOAL, TOLERANCE = ("D2a:4", "D2b:6", "D2b:2"), (6.0, 0.0, -0.3), 0.3
PLACE = (4.0, 0.5, 0.6)


@pytest.fixture(scope="module")
def graph():
    return stance_graph("jem", "mlivr3")


def test_a_plan_passes_the_places_of_its_route(monkeypatch, graph):
    """All its steps are steps of the graph; the shortest way does not pass the place."""
    planner = Planner(graph)
    straight = planner.plan(START, GOAL, "steps", goal_tolerance=TOLERANCE, inflation=1.0).unwrap()
    monkeypatch.setattr(legs, "LEG", 0.6)
    monkeypatch.setattr(legs, "LEG_TOLERANCE", 0.3)
    plan = planner.plan(START, GOAL, "steps", goal_tolerance=TOLERANCE, route=[PLACE]).unwrap()
    assert count_steps(graph, plan.stances) == len(plan.steps)
    assert np.linalg.norm(plan.motion.base_positions[-1] - GOAL) <= TOLERANCE
    assert plan.statistics.bound is None
    least = [
        np.linalg.norm(one.motion.base_positions - PLACE, axis=1).min() for one in (straight, plan)
    ]
    assert least[1] <= 0.6 < least[0]


def test_a_long_way_of_three_limbs_is_planned_in_legs(monkeypatch, graph):
    """Its bound is one of the whole map, whose fewest steps the shipped table gives."""
    monkeypatch.setattr(corridor, "LEGS_FROM", 1.0)
    found = plan_in_corridor("jem", START, GOAL, robot="mlivr3", goal_tolerance=TOLERANCE)
    plan = found.result.unwrap()
    assert not found.is_whole
    assert count_steps(graph, plan.stances) == len(plan.steps)
    best = Planner(graph).plan(START, GOAL, "steps", goal_tolerance=TOLERANCE, inflation=1.0)
    assert 1.0 <= len(plan.steps) / plan.statistics.bound <= len(best.unwrap().steps)


def searched(line, starts_over):
    """Search along a line of 12 m where a leg from a place to another is found if `line` says."""
    tried = []

    def find(search, state):
        to = float(search.goal.target[0])
        tried.append((state, to))
        status = GOAL_REACHED if line(state, to) else LIMIT_REACHED
        return SearchResult(status, (state, to), 0.0, 1, 1, np.zeros((0, 2, 3)))

    def posture_of(state):
        return postures_of([state])

    def postures_of(states):
        return SimpleNamespace(base_position=np.array([[x, 0.0, 0.0] for x in states]))

    graph = SimpleNamespace(posture_of=posture_of, postures_of=postures_of)
    goal = Goal(np.array([12.0, 0.0, 0.0]), 0.2, Cost.named("steps", None))
    search = SearchQuery(goal, "astar", "consistent", np.inf, starts_over, route=())
    return legs.search_by_legs(graph, search, 0.0, find), tried


def test_a_leg_that_is_not_found_is_halved():
    result, tried = searched(lambda at, to: to - at < 3.0 or at >= 6.0, 99)
    assert result.states == (0.0, 1.5, 3.0, 4.5, 6.0, 9.0, 12.0)
    assert (result.cost, result.expanded) == (6.0, len(tried))


def test_a_dead_end_is_left_by_a_longer_leg_from_before_it():
    """From 3 m no leg leads on; legs from the start over it do."""
    result, tried = searched(lambda at, to: at != 3.0, 99)
    assert result.states[:2] == (0.0, 4.5)
    assert result.states[-1] == 12.0
    assert (3.0, 3.75) in tried


@pytest.mark.parametrize("limit", [7, 10_000])
def test_a_search_along_a_route_ends(limit):
    """At its limit of expansions, or after some legs that fail."""
    result, tried = searched(lambda at, to: to < 5.0, limit)
    assert result.status == LIMIT_REACHED
    assert result.states == (0.0,)
    assert len(tried) == limit if limit == 7 else legs.MOST_FAILED < len(tried) < 200


def test_a_start_from_which_no_moves_lead_is_told(graph):
    """As without a route, by a search for the goal at once."""
    planner, far = Planner(graph), (*GOAL[:2], 0.42)
    graph.occupy([point for point in graph.grasp_map.ids if point not in START])
    try:
        found, once = planner.plan(START, far, "steps", route=[PLACE]), planner.plan(START, far)
    finally:
        graph.vacate()
    assert (found.reason, found.message) == (once.reason, once.message)
    assert found.plan is None


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"route": [(1.0, 2.0)]}, GoalError, r"route\[0\]"),
        ({"route": "there"}, SettingError, "route"),
        ({"route": [GOAL], "inflation": 2.0}, SettingError, "inflation is 2.0"),
    ],
)
def test_faulty_routes_are_refused(graph, options, error, text):
    with pytest.raises(error, match=text):
        Planner(graph).plan(START, GOAL, **options)
