"""Records of how far the joints of a limb turn during a part of a motion (compiled).

Each family of arms proves the bounds in a file of its own, see `ur_bounds` and
`spherical_wrist_bounds`. Between the middle of an interval and either end let the wrist point
travel at most `d` in the limb base frame, the flange axis turn at most `a` and the flange at most
`w`. What turns by `b` on its path to an end, and by `c` between middle and end, is never farther
from where it was in the middle than `(b + c) / 2`: it must come back.
"""

from __future__ import annotations

from typing import NamedTuple

from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record


class FlangeMotion(NamedTuple):
    """How a flange moves at most from the middle of an interval to either end, in the limb base."""

    travel: float
    """Distance that the wrist point travels [m]."""
    axis: float
    """Turn of the flange axis [rad]."""
    turn: float
    """Turn of the flange [rad]."""


class Turns(Record):
    """How far joints and sums of joints turn at most from the middle of an interval [rad]."""

    q1: float
    q2: float
    q23: float
    """Sum of joints 2 and 3, as are the next ones; of an arm whose upper arm is held at an angle
    `t`, see `spherical_wrist`, the sum of `cos(t) q2` and `q3`."""
    q234: float
    """For parallel axes alone."""
    q3: float
    q34: float
    """For parallel axes alone."""
    q4: float
    q5: float
    q6: float


class GraspMotion(NamedTuple):
    """How far the links of a limb that holds turn at most, and its anchors move, in the world."""

    wrist_2: float
    """Turn of wrist 2 [rad]."""
    wrist_1: float
    """Turn of wrist 1 [rad]."""
    forearm: float
    """Turn of the forearm [rad]."""
    upper_arm: float
    """Turn of the upper arm [rad]."""
    forearm_end: float
    """Travel of the forearm's end [m]."""
    elbow: float
    """Travel of the elbow [m]."""


@kernel
def come_back(bound: float, minus: float, plus: float) -> float:
    """Return half of a bound on the way and the larger change from the middle to an end."""
    return 0.5 * (bound + min(max(abs(minus), abs(plus)), bound))
