"""Joint angles of a limb that are followed along a path (compiled)."""

from __future__ import annotations

import numpy as np

from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Joints, Record
from mlivr_gym.kinematics.poses import Pose


class Track(Record):
    """Joint angles of a limb that are followed along a path."""

    q: Joints
    """Where they are [rad]; NaN for none yet."""
    low: Joints
    """The least so far [rad]."""
    high: Joints
    """The largest so far [rad]."""
    farthest: float
    """The largest turn of a joint over one interval so far [rad]."""
    turn: Joints
    """The turns over the last interval [rad]; NaN for none yet."""
    bend: float
    """The largest change of a joint's turn from one interval to the next so far [rad]."""
    base: Pose
    """Base in the world."""


@kernel
def begin(track: Track) -> None:
    """Start without joint angles."""
    for joint in range(6):
        track.q[joint], track.low[joint], track.high[joint] = np.nan, np.inf, -np.inf
        track.turn[joint] = np.nan
    track.farthest = track.bend = 0.0
