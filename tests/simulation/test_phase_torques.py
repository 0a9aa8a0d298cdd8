"""Torques phase by phase, and the figure that marks them."""

from dataclasses import replace

import numpy as np
import pytest
from recordings import resting

from mlivr_gym.simulation.phase_torques import (
    PARTS,
    after_captures,
    largest,
    phase_torques,
)
from mlivr_gym.simulation.recording import Capture

PERIOD = 0.1
STEP = 50.0


@pytest.fixture
def walk():
    """Two steps of 50 s and 2 s of rest, without torques, and their captures."""
    times = np.arange(round((2 * STEP + 2.0) / PERIOD)) * PERIOD
    step = np.minimum(times // STEP + 1e-9, 1).astype(np.int64)
    within = times - STEP * step
    phase = (within >= 10.0).astype(np.int64) + (within >= 40.0)
    recording = replace(resting(len(times)), times=times, step=step, phase=phase)
    captures = tuple(Capture((n + 1) * STEP, n, n, "point", 0.0, 0.0) for n in range(2))
    return recording, captures


def with_torque(recording, *bursts):
    """The same with all joints at one torque for one sample each: times [s] and torques [N m]."""
    torques = recording.joint_torques.copy()
    for time, torque in bursts:
        torques[round(time / PERIOD)] = torque
    return replace(recording, joint_torques=torques)


@pytest.mark.parametrize(
    ("time", "step", "part"),
    [
        (0.0, 0, "departure"),
        (10.0, 0, "swing"),
        (40.0, 0, "approach"),
        (49.9, 0, "approach"),
        (50.0, 0, "capture"),
        (50.9, 0, "capture"),
        (51.0, 1, "departure"),
        (100.0, 1, "capture"),
    ],
)
def test_a_torque_belongs_to_the_part_in_which_it_is(walk, time, step, part):
    """Also to the step that ends, where the next has begun; all joints alike have that RMS."""
    recording, captures = walk
    found = phase_torques(with_torque(recording, (time, -3.0)), captures)
    best = largest(found, step)
    assert (best.step, best.part) == (step, part)
    assert best.time == pytest.approx(time)
    assert best.peak == pytest.approx(3.0)
    assert [entry.part for entry in found] == [*PARTS, *PARTS]
    assert sum(entry.peak > 0.0 for entry in found) == 1


def test_the_mean_is_that_of_the_part(walk):
    recording, captures = walk
    torques = np.empty_like(recording.joint_torques)
    torques[:] = 1.0 + recording.phase[:, None, None]
    torques[after_captures(recording, captures)] = 7.0
    found = phase_torques(replace(recording, joint_torques=torques), captures)
    assert [entry.mean for entry in found] == pytest.approx(2 * [1.0, 2.0, 3.0, 7.0])


def test_a_step_without_capture_has_no_such_part(walk):
    recording, captures = walk
    found = phase_torques(recording, captures[:1])
    assert [entry.part for entry in found if entry.step == 1] == list(PARTS[:3])
