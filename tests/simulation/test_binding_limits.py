"""Each limit in turn decides how fast a step is: then it is reached, and none is exceeded."""

from dataclasses import replace

import numpy as np
import pytest
from pinocchio_loads import loads_of

from mlivr_gym.motion.time_scaling import duration_of, quintic
from mlivr_gym.motion.trajectory import trajectory
from mlivr_gym.simulation.parameters import Limits
from mlivr_gym.simulation.path_dynamics import SegmentDynamics
from mlivr_gym.simulation.time_optimal import time_optimal_scaling
from mlivr_gym.simulation.timing import timed_path

LOOSE = Limits(1.0, 1.0, 1e5, 1e5, 10.0)
"""So that a limit that is tightened decides alone."""

TIGHT = {
    "torque": 0.02, "speed": 0.03, "grasp_force": 0.5, "grasp_torque": 0.2, "surface_speed": 0.01,
}  # fmt: skip
"""Limits that decide for a whole step; the speed of a gripper does near the surface alone."""


def shares_of_limits(grasp_map, walk, limits):
    """The largest share of each limit in each segment of a step, by name, from its positions."""
    path, stances = walk.joint_path(2), walk.stances[2:4]
    timed, robot, limb = timed_path(path, limits), path.robot, path.limb
    moved = trajectory(grasp_map, stances, timed, timed.duration / 6000)
    loads = loads_of(robot, moved, [i for i in range(robot.limbs) if i != limb])
    force, torque = (np.linalg.norm(loads.wrenches[..., k : k + 3], axis=2) for k in (0, 3))
    at_ends = np.isin(moved.phase[1:-1], [0, 2])
    shares = {
        "torque": np.abs(loads.torques / robot.torque_limits.reshape(-1, 6)) / limits.torque,
        "speed": np.abs(loads.speeds / robot.speed_limits.reshape(-1, 6)) / limits.speed,
        "grasp_force": force / limits.grasp_force,
        "grasp_torque": torque / limits.grasp_torque,
        "surface_speed": loads.grippers[:, limb] * at_ends / limits.surface_speed,
    }
    part = np.searchsorted(timed.ends / timed.duration, moved.times[1:-1] / moved.times[-1])
    return {
        name: np.array([values[part == k].max() for k in range(len(path.segments))])
        for name, values in shares.items()
    }


@pytest.mark.parametrize(
    ("name", "profile"), [*((name, "fastest") for name in TIGHT), ("torque", "quintic")]
)
def test_the_limit_that_decides_is_reached_and_none_is_exceeded(jem, walk, name, profile):
    """By Pinocchio and finite differences of the positions of the trajectory.

    The limits are far below the usual ones, so that a step takes up to a minute, and its
    acceleration rises within a hundredth of it.
    """
    shares = shares_of_limits(jem, walk, replace(LOOSE, profile=profile, **{name: TIGHT[name]}))
    decided = [0, -1] if name == "surface_speed" else slice(None)
    reached = shares.pop(name)[decided]
    assert reached.max() < 1.005
    # Differences over three samples cut off the peak of an acceleration that has just risen.
    assert reached.min() > (0.95 if profile == "fastest" else 0.995)
    for others in shares.values():
        assert others[decided].max() < 0.5
        assert others.max() < 1.005


def segment(speed, load, at_speed=0, at_load=0):
    """One of two limbs with one speed and one load that do not change along it, else none.

    Their numbers are those of the columns: 12 joints and a gripper, 12 joints, force and torque.
    """
    loads, speeds = np.zeros((97, 2, 14, 3)), np.zeros((97, 13))
    loads[:, 0, at_load], speeds[:, at_speed] = load * np.array([0.6, 0.0, 0.8]), -speed
    return SegmentDynamics((1,), 0, np.linspace(0.0, 1.0, 97), loads, speeds)


@pytest.mark.parametrize(
    ("speed", "load", "expected"),
    [(3.0, 0.0, 3.0), (0.0, 2.25, 3.0), (2.0, 2.0, 3.0), (1.0, 2.25, 3.0)],
)
@pytest.mark.parametrize("rise", [0.3, 0.6])
def test_the_shortest_time_is_that_of_the_closed_form(speed, load, expected, rise):
    """A trapezoid of speeds, or a triangle, and the time in which the acceleration rises."""
    scaling = time_optimal_scaling(segment(speed, load, 7, 13), rise)
    assert duration_of(scaling) == pytest.approx(expected + rise, rel=0.02)
    if load:
        rising = scaling(rise * np.array([0.25, 0.5, 0.75, 1.0]), 2) * load
        np.testing.assert_allclose(rising, [0.125, 0.5, 0.875, 1.0], atol=0.06)


@pytest.mark.parametrize(
    ("at_speed", "at_load", "speed", "expected"),
    [
        (5, 0, 9.0, ("speed", 0, 6)), (6, 0, 9.0, ("speed", 1, 1)),
        (12, 0, 9.0, ("surface_speed", 0, 0)), (0, 11, 0.1, ("torque", 1, 6)),
        (0, 12, 0.1, ("grasp_force", 1, 0)), (0, 13, 0.1, ("grasp_torque", 1, 0)),
    ],
)  # fmt: skip
def test_the_limit_that_decides_is_named_with_the_duration_it_asks_for(
    at_speed, at_load, speed, expected
):
    """A quintic goes at 15/8 of its mean speed, and accelerates by 10/sqrt(3) over T squared."""
    found = segment(speed, 4.0, at_speed, at_load).binding(quintic(1.0))
    seconds = 15.0 / 8.0 * speed if speed > 1.0 else np.sqrt(4.0 * 10.0 / np.sqrt(3.0))
    assert found == (pytest.approx(seconds, rel=1e-3), *expected)
