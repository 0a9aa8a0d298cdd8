"""How the joints and links of an arm with a spherical wrist move at most, proved (compiled).

For the notation see `spherical_wrist`. On an interval let the wrist point W travel at most `d` in
the limb base frame from the middle to either end, the flange axis turn at most `a` and the flange
at most `w`. Let `D` be the distance of W from the shoulder, across axis 2 if the upper arm is not
held at an angle, and let least and largest values be those on the interval. Velocities are taken
per unit of the path of W, `e` is the travel of W that moves the triangle of shoulder, elbow and W.

    u      u^2 >= (rho - d)^2 - k_max^2,  rho^2 = x^2 + y^2
    e      d sqrt(1 + (d2 / u)^2)  for t = 0: the part across axis 2 is
           (v_x - (d2 / u) v_y, v_z) of a velocity v;  d  for a spherical shoulder
    cos f  from D - e and D + e by the triangle; it bounds sin f and cos f
    q3     D dD = -a2 L sin f df:  at most e D / (a2 L |sin f|), or the two next ones together
    plane  the triangle is a planar arm of two links, which turn in its plane at most
           e / (a2 |sin f|)  (upper arm)  and  e / (L |sin f|)  (forearm)
    q1     y1 . v = u q1' - k', k' = sin(t) L cos f f':  at most (d + sin(t) L |cos f| q3) / u
    q2     the upper arm turns in the plane by q2' cos(t) + q1' z.z3, |z.z3| <= |sin t|:
           at most (e / (a2 |sin f|) + |sin t| q1) / |cos t|; and, as the velocity that is left
           without q3 is at most d D / (a2 |sin f|), at most that + q1 k over sqrt(D^2 - k^2)
    link 3 turns along its axis z3 by at most e / (L |sin f|), across it by q1 + |sin t| q2:
           b3, the root of the sum of the squares
    s5     |s5| >= |s5| - (a + b3), since it is the sine of the angle between axes 4 and 6
    q5     a + b3
    q4     (a + b3) / |s5|: axis 6 seen from link 3 goes round axis 4
    q6     w + (a + b3) / |s5|: axis 4 goes round axis 6, which fixes axis 5

The bounds of `cos(t) q2 + q3` are those of link 3 in the plane plus `|sin t| q1`. As scalars that
are linear in the joint angles they come back, see `turns`. Between any two postures link 3 turns
at most as far as on the line in joint space between them: along z3 by that scalar and
`|sin t| q1`, across it by `q1 + |sin t| q2`; link 4 by q4 more across it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Joints
from mlivr_gym.kinematics.arm import Arm
from mlivr_gym.kinematics.turns import FlangeMotion, GraspMotion, Turns


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
def _arm_motion(arm: Arm, u2: float, cosine: float, d: float) -> ArmMotion:
    """Bound the motion of the first three joints by the travel of the wrist point.

    Parameters
    ----------
    arm
        The arm.
    u2
        Squared `u` in the middle [m^2].
    cosine
        Cosine of the elbow angle in the middle.
    d
        Travel of the wrist point [m].
    """
    held, upper, fore = abs(arm.s_held), arm.a2, arm.forearm
    none = ArmMotion(False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    k2 = upper * upper + fore * fore
    offset = arm.d2 if held == 0.0 else held * fore * np.sqrt(max(1.0 - cosine * cosine, 0.0))
    rho = np.sqrt(u2 + offset * offset) - d
    if rho <= 0.0:
        return none
    e, u2_min = d, rho * rho - offset * offset
    if held == 0.0:
        if u2_min <= 0.0:
            return none
        e = d * np.sqrt(1.0 + offset * offset / u2_min)
    distance = np.sqrt(max(k2 + 2.0 * arm.links * cosine, 0.0))
    farthest, closest = distance + e, max(distance - e, 0.0)
    low = (closest * closest - k2) / (2.0 * arm.links)
    high = (farthest * farthest - k2) / (2.0 * arm.links)
    most = max(abs(low), abs(high))
    if most >= 1.0:
        return none
    sine = np.sqrt(1.0 - most * most)
    if held != 0.0:
        least = 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))
        offset = held * fore * np.sqrt(1.0 - least * least)
        u2_min = rho * rho - offset * offset
        if u2_min <= 0.0:
            return none
    u = np.sqrt(u2_min)
    in_upper, plane = e / (upper * sine), e / (fore * sine)
    q3 = min(in_upper * farthest / fore, in_upper + plane)
    q1 = (d + held * fore * most * q3) / u
    q2 = in_upper
    if held != 0.0:
        across = max(u2_min, closest * closest - offset * offset)
        q2 = (in_upper * farthest + q1 * offset) / np.sqrt(across)
        if arm.c_held != 0.0:
            q2 = min(q2, (in_upper + held * q1) / abs(arm.c_held))
    return ArmMotion(True, u, sine, q1, q2, q3, plane, np.hypot(plane, q1 + held * q2))


@kernel
def stays_above(
    arm: Arm, terms: Array, choice: int, change: tuple[float, float], square_floor: float
) -> bool:
    """Return whether the bounds keep a class of branches above the floor on an interval."""
    d, a = change
    moved = _arm_motion(arm, terms[choice, 0], terms[choice, 2], d)
    s5 = np.sqrt(terms[choice, 1]) - (a + moved.spin)
    least = moved.u * moved.sine * s5
    return bool(moved.proved and s5 > 0.0 and least * least >= square_floor)


@kernel
def held_turns(arm: Arm, q: Joints, flange: FlangeMotion, turns: Turns) -> bool:
    """Bound how far joints turn on their path from the middle of an interval to its ends."""
    d, a, w = flange
    c3, s3 = np.cos(q[2]), np.sin(q[2])
    cosine, sine = c3 * arm.c_bend + s3 * arm.s_bend, s3 * arm.c_bend - c3 * arm.s_bend
    x, y = -arm.c_held * arm.forearm * sine, arm.a2 + arm.forearm * cosine
    u = arm.a1 + np.cos(q[1]) * x - np.sin(q[1]) * y
    moved = _arm_motion(arm, u * u, cosine, d)
    s5 = abs(np.sin(q[4])) - (a + moved.spin)
    if not moved.proved or s5 <= 0.0:
        return False
    turns.q1, turns.q2, turns.q3 = moved.q1, moved.q2, moved.q3
    turns.q23 = moved.plane + abs(arm.s_held) * moved.q1
    turns.q5, turns.q4 = a + moved.spin, (a + moved.spin) / s5
    turns.q6 = w + turns.q4
    return bool(max(turns.q1, turns.q2, turns.q3, turns.q5, turns.q6) < np.pi)


@kernel
def link_motion(arm: Arm, turns: Turns, shift: Array, spin: Array) -> None:
    """Bound how far links turn and anchors move, seen from the links 0 to 4."""
    held, upper = abs(arm.s_held), np.hypot(arm.a2, arm.d2)
    for row in range(5):
        for link in range(7):
            spin[row, link] = 0.0
    for row in range(2):
        first = turns.q1 if row == 0 else 0.0
        along, across = turns.q23 + held * first, first + held * turns.q2
        spin[row, 1], spin[row, 2] = first, np.hypot(first, turns.q2)
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
