"""How far the joints of a limb turn during a part of a motion, proved (compiled).

On a line in joint space that is known. A limb whose flange is given (it holds while the base moves,
or departs along the normal) is solved in the middle and at both ends of an interval. Between them
let the wrist point travel at most `d` in the limb base frame, the flange axis turn at most `a` and
the flange at most `w`, from the middle to either end. With the least `u`, `|s5|` and `|s3|` of the
interval, which follow from those in the middle as in `certificate`, the joints turn at most, each
along its way,

    q1              d / u                                 = b1
    q5              a + b1                                (the angle between z6 and y1)
    q2 + q3 + q4    (a + b1) / |s5|                       = b4, since z4 = +-(y1 x z6) / |s5|
    q2              e / (|a2| |s3|)                       e = d + |d4| b1 + |d5| b4, the travel
    q2 + q3         e / (|a3| |s3|)                       of the forearm end
    q3              e D / (|a2 a3| |s3|)                  D from the shoulder to the forearm end
    q3 + q4, q4     b4 plus that of q2, of q2 + q3
    q6              w + b1 + b4

where those of q2 and q2 + q3 are the parts of the forearm end's velocity along the other link. What
turns by `b` on its way to an end, and by `c` between middle and end, is never farther from where it
was in the middle than `(b + c) / 2`: it must come back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Joints, Record
from mlivr_gym.kinematics.arm import Arm


class FlangeMotion(NamedTuple):
    """How a flange moves at most from the middle of an interval to either end, in the limb base."""

    travel: float
    """Way of the wrist point [m]."""
    axis: float
    """Turn of the flange axis [rad]."""
    turn: float
    """Turn of the flange [rad]."""


class Turns(Record):
    """How far joints and sums of joints turn at most from the middle of an interval [rad]."""

    q1: float
    q2: float
    q23: float
    """Joints 2 and 3 together, as are the next ones."""
    q234: float
    q3: float
    q34: float
    q4: float
    q5: float
    q6: float


@kernel
def line_turns(change: Joints, turns: Turns) -> None:
    """Those on a line in joint space, by the change of joint angles to its end [rad]."""
    turns.q1, turns.q2, turns.q3 = abs(change[0]), abs(change[1]), abs(change[2])
    turns.q23, turns.q34 = abs(change[1] + change[2]), abs(change[2] + change[3])
    turns.q234 = abs(change[1] + change[2] + change[3])
    turns.q4, turns.q5, turns.q6 = abs(change[3]), abs(change[4]), abs(change[5])


@kernel
def more_turns(change: Joints, turns: Turns) -> None:
    """Raise turns to those on a line in joint space where these are larger, see `line_turns`."""
    turns.q1, turns.q2 = max(turns.q1, abs(change[0])), max(turns.q2, abs(change[1]))
    turns.q3, turns.q4 = max(turns.q3, abs(change[2])), max(turns.q4, abs(change[3]))
    turns.q5, turns.q6 = max(turns.q5, abs(change[4])), max(turns.q6, abs(change[5]))
    turns.q23 = max(turns.q23, abs(change[1] + change[2]))
    turns.q34 = max(turns.q34, abs(change[2] + change[3]))
    turns.q234 = max(turns.q234, abs(change[1] + change[2] + change[3]))


@kernel
def held_turns(arm: Arm, q: Joints, flange: FlangeMotion, turns: Turns) -> bool:
    """How far joints turn on their way from the middle of an interval to its ends.

    Parameters
    ----------
    arm
        The arm.
    q
        Joint angles in the middle [rad].
    flange
        How the flange moves on the way to either end.
    turns
        Filled.

    Returns
    -------
    bool
        Whether this can be told: the limb stays on its branch, and no joint turns by half a turn.
    """
    d, a, w = flange
    c2, c23, s234 = np.cos(q[1]), np.cos(q[1] + q[2]), np.sin(q[1] + q[2] + q[3])
    u, links = abs(arm.a2 * c2 + arm.a3 * c23 + arm.d5 * s234), abs(arm.a2 * arm.a3)
    rho = np.sqrt(u * u + arm.d4 * arm.d4) - d
    u2 = rho * rho - arm.d4 * arm.d4
    if rho <= 0.0 or u2 <= 0.0:
        return False
    b1 = d / np.sqrt(u2)
    s5 = abs(np.sin(q[4])) - (a + b1)
    if s5 <= 0.0:
        return False
    b4 = (a + b1) / s5
    e, k2 = d + abs(arm.d4) * b1 + abs(arm.d5) * b4, arm.a2 * arm.a2 + arm.a3 * arm.a3
    distance = np.sqrt(max(k2 + 2.0 * arm.a2 * arm.a3 * np.cos(q[2]), 0.0))
    farthest, closest = distance + e, max(distance - e, 0.0)
    c3 = max(abs(farthest * farthest - k2), abs(closest * closest - k2)) / (2.0 * links)
    if c3 >= 1.0:
        return False
    s3 = np.sqrt(1.0 - c3 * c3)
    turns.q1, turns.q234, turns.q5, turns.q6 = b1, b4, a + b1, w + b1 + b4
    turns.q2, turns.q23 = e / (abs(arm.a2) * s3), e / (abs(arm.a3) * s3)
    turns.q3 = min(e * farthest / (links * s3), turns.q2 + turns.q23)
    turns.q34, turns.q4 = b4 + turns.q2, b4 + turns.q23
    most = max(turns.q2, turns.q23, turns.q34, turns.q4, turns.q6)
    return bool(most < np.pi)


@kernel
def come_back(minus: Joints, plus: Joints, turns: Turns) -> None:
    """Lower the turns on the way by the changes from the middle to both ends [rad]."""
    turns.q1 = _between(turns.q1, minus[0], plus[0])
    turns.q2 = _between(turns.q2, minus[1], plus[1])
    turns.q3 = _between(turns.q3, minus[2], plus[2])
    turns.q4 = _between(turns.q4, minus[3], plus[3])
    turns.q5 = _between(turns.q5, minus[4], plus[4])
    turns.q6 = _between(turns.q6, minus[5], plus[5])
    turns.q23 = _between(turns.q23, minus[1] + minus[2], plus[1] + plus[2])
    turns.q34 = _between(turns.q34, minus[2] + minus[3], plus[2] + plus[3])
    back, forth = minus[1] + minus[2] + minus[3], plus[1] + plus[2] + plus[3]
    turns.q234 = _between(turns.q234, back, forth)


@kernel
def _between(most: float, minus: float, plus: float) -> float:
    """Half the way and the larger change."""
    return 0.5 * (most + min(max(abs(minus), abs(plus)), most))
