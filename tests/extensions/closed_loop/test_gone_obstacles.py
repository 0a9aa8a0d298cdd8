"""A robot in the closed loop gives up obstacles that are not there."""

import numpy as np
import pytest
from loop_walks import CAMERA, GOAL, START, kinds

from mlivr_gym import Box
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.loop import run_closed_loop
from mlivr_gym.extensions.closed_loop.record import ARRIVED, STOPPED
from mlivr_gym.extensions.closed_loop.sensing_robot import SensingRobot
from mlivr_gym.planners import Planner


@pytest.fixture(scope="module")
def plan(graph):
    return Planner(graph).plan(START, GOAL, "steps").unwrap()


def test_it_looks_through_a_box_that_is_gone(graph, plan):
    """The box shuts the way of the free plan; without cameras the robot believes in it."""
    point = graph.grasp_map.index(plan.steps[0].to_point)
    middle = graph.grasp_map.positions[point] + 0.25 * graph.grasp_map.normals[point]
    box = Box.between("gone", "obstacle", middle - 0.15, middle + 0.15)
    graph.add_obstacles([box])
    try:
        blind = run_closed_loop(graph, START, GOAL, gone=["gone"], max_steps=1)
        record = run_closed_loop(graph, START, GOAL, gone=["gone"], camera=CAMERA, max_steps=1)
        kept = run_closed_loop(graph, START, GOAL, camera=CAMERA, max_steps=1)
        assert graph.obstacles == (box,)
    finally:
        graph.remove_obstacles()
    assert "gone" not in kinds(blind)
    assert [event.values for event in record.events if event.kind == "gone"] == [{"box": "gone"}]
    taken = [event.values["point"] for event in record.events if event.kind == "step"]
    assert taken == [plan.steps[0].to_point]
    assert not record.sensed
    assert "gone" not in kinds(kept)  # it is there


def test_it_looks_before_it_believes_that_no_way_is_left(graph):
    around = Box.between("goal", "obstacle", np.array(GOAL) - 0.3, np.array(GOAL) + 0.3)
    graph.add_obstacles([around])
    try:
        blind = run_closed_loop(graph, START, GOAL, gone=["goal"])
        record = run_closed_loop(graph, START, GOAL, gone=["goal"], camera=CAMERA, max_steps=1)
    finally:
        graph.remove_obstacles()
    assert (blind.outcome, blind.proved) == (STOPPED, True)
    assert (record.steps, record.proved) == (1, False)


def test_it_goes_and_looks_at_what_leaves_no_plan(graph):
    """At first the walls round the goal are too far to be seen."""
    goal = np.array([6.0, 0.0, 0.42])
    around = Box.between("goal", "obstacle", goal - 0.3, goal + 0.3)
    camera = DepthCamera(pixels=28, period=1.0, max_range=1.5)
    graph.add_obstacles([around])
    try:
        record = run_closed_loop(graph, START, goal, gone=["goal"], camera=camera, max_steps=1)
        there = run_closed_loop(graph, START, goal, camera=camera, max_steps=12)
    finally:
        graph.remove_obstacles()
    assert "doubts" in kinds(record)
    assert record.steps == 1
    assert (there.outcome, there.proved) == (STOPPED, True)
    assert there.steps > 0
    assert there.sensed


def test_what_is_gone_has_no_say_in_the_branches_of_the_start(graph):
    """While the robot believes in the wall, no branch is left from which a step leads on."""
    wall = Box.between("wall", "obstacle", (3.0, -1.0, -1.0), (3.3, 1.0, 0.0))
    bag = Box.between("bag", "obstacle", (3.6, -0.35, -0.9), (3.9, 0.35, 0.0))
    for unknown in ((), (bag,)):
        graph.add_obstacles([wall])
        try:
            record = run_closed_loop(
                graph, START, GOAL, unknown=unknown, gone=["wall"], camera=CAMERA, max_steps=1
            )
        finally:
            graph.remove_obstacles()
        assert record.steps == 1


def test_it_goes_where_a_wall_was_that_it_saw(graph, monkeypatch):
    """The wall is taken away after the first step; as long as it is there, it is believed."""
    wall = Box.between("wall", "obstacle", (3.2, -1.0, -1.0), (3.4, 1.0, 0.1))
    simulations = []
    monkeypatch.setattr(
        "mlivr_gym.extensions.closed_loop.sensing_robot.SensingRobot.start",
        lambda robot, *given, start=SensingRobot.start: (
            start(robot, *given),
            simulations.append(robot.executor.simulation),
        )[0],
    )

    def take_away(event):
        if event.kind == "step":
            model = simulations[-1].model
            model.geom_pos[model.geom("box/wall").id, 2] = 50.0

    among = {"unknown": [wall], "camera": CAMERA}
    there = run_closed_loop(graph, START, GOAL, **among, max_steps=6)
    gone = run_closed_loop(graph, START, GOAL, **among, show=take_away)
    assert "freed" not in kinds(there)
    assert "freed" in kinds(gone)
    assert gone.outcome == ARRIVED
    # The volume of single boxes depends on how they overlap, what they cover does not.
    low, high = (np.array(corner) for corner in wall.bounds)
    axes = [np.arange(a, b, 0.025) for a, b in zip(low - 0.1, high + 0.1, strict=True)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    believed, left = (covered(walk.sensed, places) for walk in (there, gone))
    # It looks between steps alone, and never at all of the wall.
    assert left.sum() < 0.8 * believed.sum()
    # What it sees of the rim from farther on is new.
    assert (left & ~believed).sum() < 0.02 * believed.sum()


def covered(boxes, places):
    """Which places, shape (k, 3), lie in one of some boxes."""
    inside = np.zeros(len(places), dtype=bool)
    for box in boxes:
        away = np.abs((places - np.array(box.centre)) @ np.array(box.rotation))
        inside |= (away <= np.array(box.half)).all(axis=1)
    return inside
