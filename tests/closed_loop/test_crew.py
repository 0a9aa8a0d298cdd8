"""The robot keeps its distance from crew members: it waits, or makes way."""

import numpy as np
import pytest

from mlivr_gym.closed_loop import evasion
from mlivr_gym.closed_loop.course import Course
from mlivr_gym.closed_loop.crew import (
    LEAST_DISTANCE,
    CrewMember,
    distance_from_crew,
    segment_distances,
)
from mlivr_gym.closed_loop.loop import run_closed_loop
from mlivr_gym.closed_loop.path_check import robot_axes, robot_radii
from mlivr_gym.closed_loop.record import ARRIVED, STOPPED
from mlivr_gym.closed_loop.sensing_robot import SensingRobot
from mlivr_gym.collisions.distances import segments_distance
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.limits import Limits
from mlivr_gym.values import as_triple

START, GOAL = ("D2a:4", "D2b:4"), (4.2, 0.0, 0.42)
ACROSS = CrewMember((3.4, -4.0, 0.2), (3.4, 4.0, 0.2))
LENGTHWISE = CrewMember((9.0, 0.0, 0.0), (-2.0, 0.0, 0.0))


def test_distances_of_segments_agree_with_the_compiled_ones():
    """Also of parallel segments, and of such without length."""
    rng = np.random.default_rng(2)
    first, second = rng.normal(size=(2, 400, 2, 3))
    second[:100, 1] = second[:100, 0] + 2.0 * (first[:100, 1] - first[:100, 0])
    first[50:150, 1] = first[50:150, 0]
    second[120:200, 1] = second[120:200, 0]
    expected = [
        segments_distance(*(as_triple(x) for x in (p[0], p[1] - p[0], q[0], q[1] - q[0])))
        for p, q in zip(first, second, strict=True)
    ]
    assert segment_distances(first, second) == pytest.approx(np.array(expected), abs=1e-9)


def test_the_distance_is_that_of_the_closest_points():
    """By points on the surfaces of the capsules."""
    rng = np.random.default_rng(3)
    axes, radii, times = rng.normal(size=(5, 3, 2, 3)), np.array([0.1, 0.2, 0.05]), np.arange(5.0)
    there = distance_from_crew(axes, radii, [ACROSS], times)
    share = np.linspace(0.0, 1.0, 300)[:, None]
    ends, thickness = ACROSS.capsules
    for k, time in enumerate(times):
        assert ACROSS.middles(times)[k] == pytest.approx([3.4, -4.0 + 0.5 * time, 0.2])
        gaps = []
        for axis, radius in zip(axes[k], radii, strict=True):
            for end, thick in zip(ends + ACROSS.middles(times)[k], thickness, strict=True):
                mine, other = (one[0] + share * (one[1] - one[0]) for one in (axis, end))
                apart = np.linalg.norm(mine[:, None] - other, axis=2).min()
                gaps.append(apart - radius - thick)
        assert there[k] == pytest.approx(min(gaps), abs=0.01)


@pytest.fixture
def hasty(monkeypatch):
    """Whether each step that is attempted is hasty."""
    attempt, noted = SensingRobot.attempt, []

    def noting(robot, step, wait=0.0, plan_ahead=None, is_hasty=False):
        done = attempt(robot, step, wait, plan_ahead, is_hasty)
        assert robot.executor.simulation.is_hasty == is_hasty
        noted.append(is_hasty)
        return done

    monkeypatch.setattr(SensingRobot, "attempt", noting)
    return noted


def test_it_waits_until_who_crosses_its_way_has_passed(graph, hasty):
    alone = run_closed_loop(graph, START, GOAL)
    record = run_closed_loop(graph, START, GOAL, crew=[ACROSS])
    waits = [event.values["duration"] for event in record.events if event.kind == "waits"]
    assert (record.outcome, record.steps) == (ARRIVED, alone.steps)
    assert record.duration == pytest.approx(alone.duration + sum(waits), abs=0.1)
    assert sum(waits) > 0.0
    assert record.crew_distance >= LEAST_DISTANCE
    assert not any(hasty)
    assert alone.crew_distance is None


def test_it_makes_way_for_who_comes_towards_it(graph):
    record = run_closed_loop(graph, START, GOAL, crew=[LENGTHWISE])
    assert record.outcome == ARRIVED
    assert record.crew_distance >= LEAST_DISTANCE
    assert not record.is_crew_unavoidable
    actions = [action for plan, _ in record.plans for action in plan.actions]
    steps = [(e.values["limb"], e.values["point"]) for e in record.events if e.kind == "step"]
    assert not set(steps) <= set(actions)  # it took a step that is none of its plans


def test_who_comes_to_where_it_has_arrived_is_made_way_for(graph, monkeypatch):
    """It does not arrive before they have passed, though it starts at its goal."""
    monkeypatch.setattr(evasion, "MOST_TRIED", 20)
    goal = graph.posture_of(graph.state(START)).base_position[0]
    record = run_closed_loop(graph, START, goal.tolist(), crew=[LENGTHWISE])
    assert (record.outcome, record.events[-1].time) == (ARRIVED, record.duration)
    assert record.crew_distance >= LEAST_DISTANCE
    assert LENGTHWISE.middles(np.array([record.duration]))[0, 0] < goal[0]
    assert "step" in {event.kind for event in record.events}


def test_who_comes_to_where_it_stops_without_a_plan_is_made_way_for(graph, monkeypatch):
    """From its second look on there is no plan: its goal is a corner of the module."""
    replan, looks = Course.replan, []

    def none_later(course, state, is_retry=False):
        looks.append(state)
        found = replan(course, state, is_retry)
        if len(looks) > 1:
            course.plan, found = None, Planner(graph).plan(START, (0.1, 1.0, 1.0))
        return found

    monkeypatch.setattr(Course, "replan", none_later)
    record = run_closed_loop(graph, START, GOAL, crew=[LENGTHWISE])
    assert record.outcome == STOPPED
    assert record.steps > 0
    assert record.crew_distance >= LEAST_DISTANCE
    shapes, times = LimbShapes(graph.robot), np.arange(record.duration, LENGTHWISE.arrival, 0.1)
    axes = robot_axes(graph.robot, shapes, graph.configuration(record.state))
    still = np.broadcast_to(axes, (len(times), *axes.shape))
    after = distance_from_crew(still, robot_radii(shapes), [LENGTHWISE], times)
    assert after.min() >= LEAST_DISTANCE


def test_it_is_in_haste_if_only_a_way_out_without_delays_is_left(graph, hasty, monkeypatch):
    """Who comes leaves no time to come to rest at a point, but some to take hold of it sooner."""
    monkeypatch.setattr(evasion, "MOST_TRIED", 20)
    member = CrewMember((6.5, -0.2, 0.1), (-3.5, -0.2, 0.1), begin=3.6)
    record = run_closed_loop(graph, ("F1a:2", "O1a:0"), (1.43, -0.35, -0.24), crew=[member])
    assert record.outcome == ARRIVED
    assert hasty[0]
    assert record.crew_distance >= LEAST_DISTANCE
    assert record.peak_force < Limits().grasp_force


def test_it_holds_if_it_cannot_make_way(graph, monkeypatch):
    """Someone who is as large as the cabin."""
    monkeypatch.setattr(evasion, "MOST_TRIED", 5)
    giant = CrewMember((9.0, 0.0, 0.0), (-2.0, 0.0, 0.0), radius=0.9, speed=1.0)
    record = run_closed_loop(graph, START, GOAL, crew=[giant])
    assert {"holds", "step"} <= {event.kind for event in record.events}
    assert record.outcome == ARRIVED
    assert record.crew_distance < 0.0


def test_who_starts_at_the_robot_cannot_be_avoided(graph):
    x, y, z = graph.posture_of(graph.state(START)).base_position[0].tolist()
    member = CrewMember((x, y, z), (x + 5.0, y, z))
    assert run_closed_loop(graph, START, GOAL, crew=[member], max_steps=1).is_crew_unavoidable
