"""How the joints and links of an arm with a spherical wrist move at most, proved (compiled).

For the notation see `spherical_wrist`. On an interval let the wrist point W travel at most `d` in
the limb base frame from the middle to either end, the flange axis turn at most `a` and the flange
at most `w`. Let `D` be the distance of W from the shoulder, across axis 2 if `t = 0`, and let least
and largest values be those on the interval. Velocities are taken per unit of the path of W, `e` is
the travel of W that moves the triangle of shoulder, elbow and W.

    u      u^2 >= (rho - d)^2 - o_max^2,  rho^2 = x^2 + y^2, o as in `spherical_wrist`
    e      d sqrt(1 + (d2 / u)^2)  for t = 0: the part across axis 2 is
           (v_x - (d2 / u) v_y, v_z) of a velocity v;  d  for a spherical shoulder
    cos f  from D - e and D + e by the triangle; it bounds sin f and cos f
    q3     D dD = -U L sin f df:  at most e D / (U L |sin f|), or the two next ones together
    plane  the triangle is a planar arm of two links, which turn in its plane at most
           e / (U |sin f|)  (upper arm)  and  e / (L |sin f|)  (forearm)
    k      |k'| <= m q3, m = |sin t| L (|cos p cos f| + |sin p sin f|)
    o      if r is a right angle as far as k, at most m q3 from where it is in the middle; else at
           most (m q3 + |cos r| d) / |sin r| from there
    q1     z2 . v = k' - sin(r) u q1':  at most (d + m q3) / (|sin r| u), and if t is not 0 at most
           d D / (U |sin f|), the velocity that is left without q3, over |sin r| u
    q2     the upper arm turns in the plane by q2' cos(t) + q1' z.z3, |z.z3| <= n:
           n = |sin t sin r| + |cos t cos r|, at most (e / (U |sin f|) + n q1) / |cos t|; and, by
           the velocity that is left without q3, at most that
           velocity + |sin r| q1 k over sqrt(D^2 - k^2), + |cos r| q1
    link 3 turns along its axis z3 by at most e / (L |sin f|), across it by the parts of axes 1 and
           2 across z3, whose product is cos(r) - z.z3 cos(t): with c the smaller one of
           |cos r| + n |cos t| and |sin t|, by the root of q1^2 + (sin(t) q2)^2 + 2 c q1 q2; b3 is
           the root of the sum of the squares of both
    s5     |s5| >= |s5| - (a + b3), since it is the sine of the angle between axes 4 and 6
    q5     a + b3
    q4     (a + b3) / |s5|: axis 6 seen from link 3 goes round axis 4
    q6     w + (a + b3) / |s5|: axis 4 goes round axis 6, which fixes axis 5

The bounds of `cos(t) q2 + q3` are those of link 3 in the plane plus `n q1`. As scalars that are
linear in the joint angles they come back, see `turns`. Between any two postures link 3 turns at
most as far as on the line in joint space between them: along z3 by that scalar and `n q1`, across
it as above; link 4 by q4 more across it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Joints
from mlivr_gym.kinematics.arm import Arm
from mlivr_gym.kinematics.spherical_wrist import along_axis_2, in_elbow_plane
from mlivr_gym.kinematics.turns import FlangeMotion, GraspMotion, Turns

if TYPE_CHECKING:
    from mlivr_gym.values import Triple


class ArmMotion(NamedTuple):
    """Bounds of the first three joints on an interval."""

    proved: bool
    """Whether W stays within reach and neither shoulder nor elbow becomes singular."""
    u: float
    """Least `|u|` [m]."""
    sine: float
    """Least sine of the elbow angle."""
    q1: float
    """Turn of joint 1 [rad]."""
    q2: float
    """Turn of joint 2 [rad]."""
    q3: float
    """Turn of joint 3 [rad]."""
    plane: float
    """Turn of the forearm in the plane of upper arm and forearm [rad]."""
    spin: float
    """Turn of the forearm [rad]."""


@kernel
def _lean(arm: Arm) -> float:
    """Return the largest cosine of the angle between axes 1 and 3."""
    largest: float = abs(arm.s_held * arm.s_twist) + abs(arm.c_held * arm.c_twist)
    return largest


@kernel
def _across(arm: Arm, q1: float, q2: float) -> float:
    """Return how far link 3 turns across its joint axis by turns of joints 1 and 2 [rad]."""
    held = abs(arm.s_held)
    between = min(abs(arm.c_twist) + _lean(arm) * abs(arm.c_held), held)
    turn: float = np.sqrt(q1 * q1 + held * held * q2 * q2 + 2.0 * between * q1 * q2)
    return turn


@kernel
def _arm_motion(arm: Arm, u2: float, offset: float, cosine: float, d: float) -> ArmMotion:
    """Bound the motion of the first three joints by the travel `d` of the wrist point [m].

    In the middle, `u2` is the squared `u` [m^2], `offset` the size of `o`, or more [m], and
    `cosine` that of the elbow angle.
    """
    held, upper, fore = abs(arm.s_held), arm.upper, arm.forearm
    none = ArmMotion(False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    k2, links = upper * upper + fore * fore, upper * fore
    # Whether the shoulder lies beside the plane of the triangle.
    beside = held != 0.0 and arm.d2 != 0.0
    if beside:
        k2 += arm.d2 * arm.d2
    rho = np.sqrt(u2 + offset * offset) - d
    if rho <= 0.0 or (arm.c_twist != 0.0 and u2 <= d * d):
        return none
    e, u2_min = d, rho * rho - offset * offset
    if held == 0.0:
        if u2_min <= 0.0:
            return none
        e = d * np.sqrt(1.0 + offset * offset / u2_min)
    distance = np.sqrt(max(k2 + 2.0 * links * cosine, 0.0))
    farthest, closest = distance + e, max(distance - e, 0.0)
    low = (closest * closest - k2) / (2.0 * links)
    high = (farthest * farthest - k2) / (2.0 * links)
    most = max(abs(low), abs(high))
    if most >= 1.0:
        return none
    sine = np.sqrt(1.0 - most * most)
    in_upper, plane = e / (upper * sine), e / (fore * sine)
    q3, rest = in_upper * farthest / fore, in_upper * farthest
    if beside:
        rest = e + fore * q3
    else:
        q3 = min(q3, in_upper + plane)
    least = 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))
    widest = np.sqrt(1.0 - least * least)
    k_change = held * fore * (abs(arm.c_fold) * most + abs(arm.s_fold) * widest) * q3
    k_most = offset
    if held != 0.0:
        folded = max(abs(upper + fore * low), abs(upper + fore * high))
        k_most = abs(arm.c_fold) * fore * widest + abs(arm.s_fold) * folded
        k_most = held * k_most + abs(arm.c_held * arm.d2)
        if arm.c_twist == 0.0:
            k_most = min(k_most, offset + k_change)
        o_most = k_most
        if arm.c_twist != 0.0:
            o_most = offset + (k_change + abs(arm.c_twist) * d) / abs(arm.s_twist)
        u2_min = rho * rho - o_most * o_most
        if u2_min <= 0.0:
            return none
    u = np.sqrt(u2_min)
    q1 = (d + k_change) / (abs(arm.s_twist) * u)
    q2 = in_upper
    if held != 0.0:
        q1 = min(q1, rest / (abs(arm.s_twist) * u))
        across = max(u2_min, closest * closest - k_most * k_most)
        q2 = (rest + abs(arm.s_twist) * q1 * k_most) / np.sqrt(across)
        q2 += abs(arm.c_twist) * q1
        if beside:
            plane = q3 + abs(arm.c_held) * q2 + _lean(arm) * q1
        elif arm.c_held != 0.0:
            q2 = min(q2, (in_upper + _lean(arm) * q1) / abs(arm.c_held))
    return ArmMotion(True, u, sine, q1, q2, q3, plane, np.hypot(plane, _across(arm, q1, q2)))


@kernel
def stays_above(
    arm: Arm, terms: Array, choice: int, change: tuple[float, float], square_floor: float
) -> bool:
    """Return whether the bounds keep a class of branches above the floor on an interval."""
    d, a = change
    u2, cosine = terms[choice, 0], terms[choice, 2]
    sine = np.sqrt(max(1.0 - cosine * cosine, 0.0))
    k = along_axis_2(arm, cosine, -sine if choice & 1 else sine)
    offset = abs(k)
    if arm.c_twist != 0.0:
        square = arm.upper * arm.upper + arm.forearm * arm.forearm
        square += arm.d2 * arm.d2 + 2.0 * arm.upper * arm.forearm * cosine - u2 - k * k
        offset = abs(arm.s_twist * k) + abs(arm.c_twist) * np.sqrt(max(square, 0.0))
    moved = _arm_motion(arm, u2, offset, cosine, d)
    s5 = np.sqrt(terms[choice, 1]) - (a + moved.spin)
    least = moved.u * moved.sine * s5
    return bool(moved.proved and s5 > 0.0 and least * least >= square_floor)


@kernel
def held_turns(arm: Arm, q: Joints, flange: FlangeMotion, turns: Turns) -> bool:
    """Bound how far joints turn on their path from the middle of an interval to its ends."""
    return bent_turns(arm, (q[1], q[2], q[4]), flange, turns)


@kernel
def bent_turns(arm: Arm, angles: Triple, flange: FlangeMotion, turns: Turns) -> bool:
    """Bound the turns of joints by the angles of joints 2, 3 and 5, see `held_turns`."""
    q2, q3, q5 = angles
    d, a, w = flange
    c3, s3 = np.cos(q3), np.sin(q3)
    cosine, sine = c3 * arm.c_bend + s3 * arm.s_bend, s3 * arm.c_bend - c3 * arm.s_bend
    x, y = in_elbow_plane(arm, cosine, sine)
    c2, s2, k = np.cos(q2), np.sin(q2), arm.c_held * arm.d2 - arm.s_held * x
    x = arm.c_held * x + arm.s_held * arm.d2
    u = arm.a1 + c2 * x - s2 * y
    offset = arm.s_twist * k - arm.c_twist * (s2 * x + c2 * y)
    moved = _arm_motion(arm, u * u, abs(offset), cosine, d)
    s5 = abs(np.sin(q5)) - (a + moved.spin)
    if not moved.proved or s5 <= 0.0:
        return False
    turns.q1, turns.q2, turns.q3 = moved.q1, moved.q2, moved.q3
    turns.q23 = min(moved.plane + _lean(arm) * moved.q1, abs(arm.c_held) * moved.q2 + moved.q3)
    turns.q5, turns.q4 = a + moved.spin, (a + moved.spin) / s5
    turns.q6 = w + turns.q4
    return bool(max(turns.q1, turns.q2, turns.q3, turns.q5, turns.q6) < np.pi)


@kernel
def link_motion(arm: Arm, turns: Turns, shift: Array, spin: Array) -> None:
    """Bound how far links turn and anchors move, seen from the links 0 to 4."""
    upper, lean = np.hypot(arm.upper, arm.d2), _lean(arm)
    for row in range(5):
        for link in range(7):
            spin[row, link] = 0.0
    for row in range(2):
        first = turns.q1 if row == 0 else 0.0
        along, across = turns.q23 + lean * first, _across(arm, first, turns.q2)
        both = first * first + turns.q2 * turns.q2
        spin[row, 1] = first
        spin[row, 2] = np.sqrt(both + 2.0 * abs(arm.c_twist) * first * turns.q2)
        spin[row, 3], spin[row, 4] = np.hypot(along, across), np.hypot(along, across + turns.q4)
    spin[2, 3], spin[2, 4], spin[3, 4] = turns.q3, np.hypot(turns.q3, turns.q4), turns.q4
    for row in range(5):
        spin[row, 5] = spin[row, 6] = spin[row, 4] + turns.q5
        shift[row, 0] = abs(arm.a1) * spin[row, 1]
        shift[row, 1] = shift[row, 0] + upper * spin[row, 2]
        shift[row, 2] = shift[row, 3] = shift[row, 1] + arm.forearm * spin[row, 3]


@kernel
def grasp_motion(arm: Arm, turns: Turns) -> GraspMotion:
    """Bound how far the links of a limb that holds move in the world, followed from its grasp."""
    wrist_2 = turns.q6
    wrist_1 = wrist_2 + turns.q5
    fore = wrist_1 + turns.q4
    # Joint 4 moves the elbow about its axis alone, off which it lies by a3.
    elbow = arm.forearm * wrist_1 + abs(arm.a3) * turns.q4
    return GraspMotion(wrist_2, wrist_1, fore, fore + turns.q3, 0.0, elbow)
