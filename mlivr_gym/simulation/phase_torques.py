"""The joint torques of a simulated walk, phase by phase."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import BoolArray
from mlivr_gym.motion.regrasp import PHASES
from mlivr_gym.simulation.recording import Capture, Recording

CAPTURE = "capture"
"""Name of the time just after a gripper took hold, beside those of `regrasp.PHASES`."""

CAPTURE_TIME = 1.0
"""How long that lasts [s]; a grasp with the figures of `Physics` comes to rest with a time constant
of 0.15 s."""

PARTS = (*PHASES, CAPTURE)
"""Parts of a step in the order in which they come."""


class PhaseTorque(NamedTuple):
    """The root mean square of all joint torques in one part of a step."""

    step: int
    """Index of the step."""
    part: str
    """One of `PARTS`."""
    time: float
    """When it is largest [s]."""
    peak: float
    """Its largest value [N m]."""
    mean: float
    """Its mean [N m]."""


def after_captures(recording: Recording, captures: Sequence[Capture]) -> BoolArray:
    """Which samples lie in the `CAPTURE_TIME` after one of the captures, shape (k,)."""
    inside: BoolArray = np.zeros(len(recording.times), dtype=np.bool_)
    for capture in captures:
        since = recording.times - capture.time
        # Times are multiples of the time step but for rounding.
        inside |= (since > -1e-9) & (since < CAPTURE_TIME - 1e-9)
    return inside


def phase_torques(recording: Recording, captures: Sequence[Capture]) -> list[PhaseTorque]:
    """Peak and mean of the torques in each part of each step, in the order of time.

    What follows a capture belongs to the step that ends with it, even where the next one has begun.
    Parts of which nothing was recorded are missing.
    """
    found, rms, caught = [], recording.torque_rms, after_captures(recording, captures)
    for step in np.unique(recording.step).tolist():
        inside = {
            name: (recording.step == step) & (recording.phase == k) & ~caught
            for k, name in enumerate(PHASES)
        }
        ending = [capture for capture in captures if capture.step == step]
        inside[CAPTURE] = after_captures(recording, ending)
        for part in PARTS:
            samples = np.flatnonzero(inside[part])
            if len(samples):
                best = samples[np.argmax(rms[samples])]
                time, peak, mean = recording.times[best], rms[best], rms[samples].mean()
                found.append(PhaseTorque(step, part, float(time), float(peak), float(mean)))
    return found


def largest(torques: Sequence[PhaseTorque], step: int) -> PhaseTorque:
    """The part of a step in which the torques are largest."""
    return max((entry for entry in torques if entry.step == step), key=lambda entry: entry.peak)
