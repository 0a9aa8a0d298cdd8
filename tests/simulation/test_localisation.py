"""What cameras find out about a robot whose encoders and points are off."""

import numpy as np
import pytest
from plans import first_steps

from mlivr_gym.motion.joint_path import PHASES
from mlivr_gym.simulation.controller import CONTROLLERS
from mlivr_gym.simulation.disturbances import DisturbanceRanges
from mlivr_gym.simulation.execution import execute_timed_plan, timed_plan
from mlivr_gym.simulation.limits import GENTLE
from mlivr_gym.simulation.simulator import Simulation

BIAS = float(np.deg2rad(0.5))


@pytest.fixture(scope="module")
def executed(checked_graph, long_plan):
    """Three steps, encoders and points off as far as they may be, without and with cameras."""
    plan = first_steps(long_plan, 3)
    walk = timed_plan(checked_graph, plan, GENTLE, 0.002)
    ranges = DisturbanceRanges(encoder_bias=BIAS, point_position=0.005, point_angle=2.0 * BIAS)
    drawn, both = ranges.draw(4, 17, 2, len(checked_graph.grasp_map)), []
    for is_localised in (False, True):
        simulation = Simulation(checked_graph.grasp_map, plan.world.robot, disturbance=drawn)
        simulation.is_localised = is_localised
        both.append((simulation, execute_timed_plan(simulation, walk)))
        assert both[-1][1][-1].failure is None
    return both


def test_the_errors_of_encoders_are_found(executed):
    """Readings are those of joints whose angles MuJoCo knows."""
    simulation, _ = executed[1]
    true, found = simulation.disturbance.encoder_bias, simulation._localisation.encoder_errors
    assert np.abs(true).max() > 0.7 * BIAS
    assert np.abs(found - true).max() < 0.2 * BIAS


def test_the_base_moves_on_its_path_although_points_and_encoders_are_off(executed):
    """In the swings of the second and third step, whose support points are off the map."""
    shifts, turns = [], []
    for _, done in executed:
        swings = [one.recording.phase == PHASES.index("swing") for one in done[1:3]]
        recordings = [one.recording for one in done[1:3]]
        shifts.append(_mean(recordings, swings, "base_errors"))
        turns.append(_mean(recordings, swings, "base_angle_errors"))
    assert shifts[0] > 0.005
    assert turns[0] > 0.5 * BIAS
    assert shifts[1] < 0.5 * shifts[0]
    assert turns[1] < 0.5 * turns[0]


def test_a_late_reading_is_compared_with_the_reference_of_its_time(checked_graph, plan):
    """Otherwise the limb would be ahead of its reference by speed times delay."""
    walk = timed_plan(checked_graph, plan, GENTLE, 0.002)
    drawn, step = (
        DisturbanceRanges(delay=0.01).draw(1, 17, 2, len(checked_graph.grasp_map)),
        walk.steps[0],
    )
    simulation = Simulation(
        checked_graph.grasp_map, plan.world.robot, controller=CONTROLLERS["delayed"],
        disturbance=drawn,
    )  # fmt: skip
    recording = execute_timed_plan(simulation, walk)[0].recording
    swing, limb = recording.phase == PHASES.index("swing"), plan.steps[0].limb
    samples = np.rint(recording.times[swing] / 0.002).astype(int)
    ahead = (recording.joint_positions[swing] - step.joint_positions[samples])[:, limb]
    speeds = step.joint_velocities[samples][:, limb]
    moves = np.abs(speeds).max(axis=0) > 0.1
    lead = ((ahead * speeds).sum(axis=0) / (speeds**2).sum(axis=0))[moves]
    assert len(lead) >= 4
    assert np.abs(lead).max() < 0.002


def _mean(recordings, swings, name):
    """Return the mean of a measurement during the swings."""
    rows = [getattr(one, name)[swing] for one, swing in zip(recordings, swings, strict=True)]
    return float(np.concatenate(rows).mean())
