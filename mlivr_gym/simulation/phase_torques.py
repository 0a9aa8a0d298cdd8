"""Joint torques of a simulated walk, by phase."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import BoolArray
from mlivr_gym.motion.joint_path import PHASES
from mlivr_gym.simulation.recording import Capture, Recording

CAPTURE = "capture"
"""Name of the time after a capture, in addition to the phases of `regrasp.PHASES`."""

CAPTURE_TIME = 1.0
"""Duration of that time [s]; a grasp with the parameters of `Physics` comes to rest with a time
constant of 0.15 s."""

PARTS = (*PHASES, CAPTURE)
"""Parts of a step in their order."""


class PhaseTorque(NamedTuple):
    """Root mean square over all joint torques in one part of a step."""

    step: int
    """Index of the step."""
    part: str
    """Name of the part, one of `PARTS`."""
    time: float
    """Time of the maximum [s]."""
    peak: float
    """Maximum [N m]."""
    mean: float
    """Mean [N m]."""


def after_captures(recording: Recording, captures: Sequence[Capture]) -> BoolArray:
    """Return which samples lie within `CAPTURE_TIME` after a capture, shape (k,)."""
    inside: BoolArray = np.zeros(len(recording.times), dtype=np.bool_)
    for capture in captures:
        since = recording.times - capture.time
        # Times are multiples of the time step up to rounding.
        inside |= (since > -1e-9) & (since < CAPTURE_TIME - 1e-9)
    return inside


def phase_torques(recording: Recording, captures: Sequence[Capture]) -> list[PhaseTorque]:
    """Return maximum and mean of the torques in each part of each step, in the order of time.

    The time after a capture belongs to the step that the capture ends, even if the next step has
    started. Parts without samples are omitted.
    """
    parts, rms, caught = [], recording.torque_rms, after_captures(recording, captures)
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
                parts.append(PhaseTorque(step, part, float(time), float(peak), float(mean)))
    return parts


def largest(torques: Sequence[PhaseTorque], step: int) -> PhaseTorque:
    """Return the part of a step with the largest torques."""
    return max((entry for entry in torques if entry.step == step), key=lambda entry: entry.peak)
