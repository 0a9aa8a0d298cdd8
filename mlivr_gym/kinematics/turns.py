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
from mlivr_gym.compiled.records import Joints, Record
from mlivr_gym.kinematics.arm import Arm


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
    """Sum of `cos(t) q2` and `q3`, with `t` the angle between axes 2 and 3, which is 0 but for arms
    of seven joints, see `spherical_wrist`."""
    q234: float
    """Sum of joints 2 to 4, of use where axes 2 to 4 are parallel."""
    q3: float
    q34: float
    """Sum of joints 3 and 4, of use for parallel axes as well."""
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


@kernel
def line_turns(arm: Arm, change: Joints, turns: Turns) -> None:
    """Compute the turns on a line in joint space by the change of joint angles to its end [rad]."""
    turns.q1, turns.q2, turns.q3 = abs(change[0]), abs(change[1]), abs(change[2])
    turns.q4, turns.q5, turns.q6 = abs(change[3]), abs(change[4]), abs(change[5])
    turns.q23 = abs(arm.c_held * change[1] + change[2])
    turns.q34 = abs(change[2] + change[3])
    turns.q234 = abs(change[1] + change[2] + change[3])


@kernel
def more_turns(arm: Arm, change: Joints, turns: Turns) -> None:
    """Raise turns to those on a line in joint space where these are larger, see `line_turns`."""
    turns.q1, turns.q2 = max(turns.q1, abs(change[0])), max(turns.q2, abs(change[1]))
    turns.q3, turns.q4 = max(turns.q3, abs(change[2])), max(turns.q4, abs(change[3]))
    turns.q5, turns.q6 = max(turns.q5, abs(change[4])), max(turns.q6, abs(change[5]))
    turns.q23 = max(turns.q23, abs(arm.c_held * change[1] + change[2]))
    turns.q34 = max(turns.q34, abs(change[2] + change[3]))
    turns.q234 = max(turns.q234, abs(change[1] + change[2] + change[3]))


@kernel
def lower_turns(arm: Arm, minus: Joints, plus: Joints, turns: Turns) -> None:
    """Lower the turns on the path by the changes from the middle to both ends [rad]."""
    turns.q1 = come_back(turns.q1, minus[0], plus[0])
    turns.q2 = come_back(turns.q2, minus[1], plus[1])
    turns.q3 = come_back(turns.q3, minus[2], plus[2])
    turns.q4 = come_back(turns.q4, minus[3], plus[3])
    turns.q5 = come_back(turns.q5, minus[4], plus[4])
    turns.q6 = come_back(turns.q6, minus[5], plus[5])
    back, forth = arm.c_held * minus[1] + minus[2], arm.c_held * plus[1] + plus[2]
    turns.q23 = come_back(turns.q23, back, forth)
    turns.q34 = come_back(turns.q34, minus[2] + minus[3], plus[2] + plus[3])
    back, forth = minus[1] + minus[2] + minus[3], plus[1] + plus[2] + plus[3]
    turns.q234 = come_back(turns.q234, back, forth)
