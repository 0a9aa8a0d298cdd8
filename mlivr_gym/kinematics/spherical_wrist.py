"""Closed-form kinematics of arms with a spherical wrist (compiled).

Axes 4, 5 and 6 meet in the wrist point W. Two kinds of arms have this form: six-joint arms whose
axis 2 is at right angles to axis 1 and parallel to axis 3 (most industrial robots), and seven-joint
arms with a spherical shoulder (KUKA iiwa and others) of which one of the first three joints is
held. For them axis 2 is turned by the twist `r` from axis 1, and the elbow axis 3 by `t` from axis
2: `r` is a right angle and `t` the held angle if the third joint is held, the roll of the upper
arm; `t` is a right angle if another one is, and `r` the held angle of the second.

Frames: z of each link is its joint axis, y of the links 2, 3 and 5 points along the arm. At zero
angles the arm stands upright along z of the limb base. The link frames follow from each other by

    Rz(q1), z by d1 | x by a1, Rx(r), Rz(q2) | y by a2, Ry(t), (b2, 0, d2), Rz(q3) | (a3, d4, 0),
    Rx(-90), Rz(q4) | Rx(90), Rz(q5) | y by d6, Rx(-90), Rz(q6)

With `U^2 = a2^2 + b2^2`, `L^2 = a3^2 + d4^2`, the angles `p = atan2(b2, a2)` and
`g = q3 - atan2(a3, d4)` and W seen from the height of the shoulder at `(x, y, h)`, the distance of
W from the shoulder gives the cosine of the elbow angle `f = g + p`, as in a triangle of sides U and
L, at right angles to the offset `d2` along axis 3. Along axis 2 the point W lies at
`k = cos(t) d2 - sin(t) (b2 - L sin g)`, across axis 1 towards axis 2 therefore at
`o = (k - cos(r) h) / sin(r)`; at right angles to both axes it lies off axis 1 by `u`, with
`u^2 + o^2 = x^2 + y^2`. The offset `a1` must be zero if `t` is not: then the shoulder is one point,
and the elbow follows before `u`. Otherwise `r` is a right angle, `k = d2`, and `u` comes first. The
eight solutions are numbered by

    branch = 4 * shoulder + 2 * elbow + wrist

where `shoulder` is 1 if `u < 0`, `elbow` is 1 if `sin f < 0`, `wrist` is 1 if `s5 < 0`. Labels
change only where `|det J| = U L |sin(r) sin f  s5  u|` is zero (Pieper 1968; Siciliano et al. 2009,
section 3.3): the positions of W and the directions of the flange separate. A half turn of the tool
about its axis is a half turn of joint 6 and changes nothing else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.bit_sets import CLASSES, class_of
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.arm import form_angle

if TYPE_CHECKING:
    from mlivr_gym.kinematics.arm import Arm, FlangeAxis
    from mlivr_gym.values import Triple

SINGULAR = 1e-9
"""Squared sines and lengths [m^2] within this of zero count as zero."""

ON_AXIS = 1e-12
"""Length within which a point counts as lying on an axis [m]; its angle about it is then 0."""


class Elbow(NamedTuple):
    """Shoulder and elbow of one branch, as far as distances determine them."""

    u2: float
    """Squared distance `u^2` [m^2]; below zero out of reach."""
    u: float
    """Distance of W from joint 1's axis at right angles to axis 2, signed [m]."""
    offset: float
    """Distance of W from joint 1's axis towards axis 2, signed [m]."""
    cosine: float
    """Cosine of the elbow angle; beyond -1 or 1 out of reach."""
    sine: float
    """Its sine; 0 out of reach."""


class Bend(NamedTuple):
    """Cosines and sines of joints 1 to 5."""

    c1: float
    s1: float
    c2: float
    s2: float
    c3: float
    s3: float
    c4: float
    s4: float
    c5: float
    s5: float


@kernel
def in_elbow_plane(arm: Arm, cosine: float, sine: float) -> tuple[float, float]:
    """Return W seen from the shoulder in the plane across axis 3, along `b2` and `a2` [m].

    Parameters are cosine and sine of the elbow angle.
    """
    c, s = cosine * arm.c_fold + sine * arm.s_fold, sine * arm.c_fold - cosine * arm.s_fold
    return arm.b2 - arm.forearm * s, arm.a2 + arm.forearm * c


@kernel
def along_axis_2(arm: Arm, cosine: float, sine: float) -> float:
    """Return how far W lies along axis 2 [m], by cosine and sine of the elbow angle."""
    along: float = arm.c_held * arm.d2 - arm.s_held * in_elbow_plane(arm, cosine, sine)[0]
    return along


@kernel
def wrist_seen(arm: Arm, flange: FlangeAxis) -> Triple:
    """Return the wrist point seen from the height of the shoulder on joint 1's axis [m]."""
    p, z = flange.p, flange.z
    return p[0] - arm.d6 * z[0], p[1] - arm.d6 * z[1], p[2] - arm.d6 * z[2] - arm.d1


@kernel
def elbow_at(arm: Arm, wrist: Triple, choice: int) -> Elbow:
    """Return shoulder and elbow of a class of branches at a wrist point."""
    x, y, h = wrist
    square, k2 = x * x + y * y, arm.upper * arm.upper + arm.forearm * arm.forearm
    offset, u2, u = arm.d2, 0.0, 0.0
    if arm.s_held == 0.0:
        u2 = square - offset * offset
        u = np.sqrt(max(u2, 0.0))
        if choice & 2:
            u = -u
        square = (u - arm.a1) * (u - arm.a1)
    if arm.s_held != 0.0:
        k2 += arm.d2 * arm.d2
    cosine = (square + h * h - k2) / (2.0 * arm.upper * arm.forearm)
    sine = np.sqrt(max(1.0 - cosine * cosine, 0.0))
    if choice & 1:
        sine = -sine
    if arm.s_held != 0.0:
        offset = (along_axis_2(arm, cosine, sine) - arm.c_twist * h) / arm.s_twist
        u2 = square - offset * offset
        u = np.sqrt(max(u2, 0.0))
        if choice & 2:
            u = -u
    return Elbow(u2, u, offset, cosine, sine)


@kernel
def _unit(x: float, y: float) -> tuple[float, float]:
    """Return a pair of products of lengths divided by its size, (1, 0) of one that has none."""
    size = np.sqrt(x * x + y * y)
    if size < ON_AXIS * ON_AXIS:
        return 1.0, 0.0
    return x / size, y / size


@kernel
def _arm_at(arm: Arm, wrist: Triple, elbow: Elbow) -> Bend:
    """Return cosines and sines of joints 1 to 3; joints 4 and 5 are 0."""
    x, y, h = wrist
    c1, s1 = _unit(elbow.u * x - elbow.offset * y, elbow.u * y + elbow.offset * x)
    # W in the plane across axis 2, seen from there: before joint 2 turns, and after.
    before_x, before_y = in_elbow_plane(arm, elbow.cosine, elbow.sine)
    before_x = arm.c_held * before_x + arm.s_held * arm.d2
    after_x, after_y = elbow.u - arm.a1, arm.s_twist * h - arm.c_twist * elbow.offset
    c2, s2 = _unit(after_x * before_x + after_y * before_y, after_y * before_x - after_x * before_y)
    cosine, sine = _unit(elbow.cosine, elbow.sine)
    c3 = cosine * arm.c_bend - sine * arm.s_bend
    s3 = sine * arm.c_bend + cosine * arm.s_bend
    return Bend(c1, s1, c2, s2, c3, s3, 1.0, 0.0, 1.0, 0.0)


@kernel
def seen_from_forearm(arm: Arm, bend: Bend, v: Triple) -> Triple:
    """Return a direction in the axes of link 3, given in those of the limb base."""
    radial, side = bend.c1 * v[0] + bend.s1 * v[1], bend.s1 * v[0] - bend.c1 * v[1]
    up = arm.s_twist * v[2] - arm.c_twist * side
    across = arm.s_twist * side + arm.c_twist * v[2]
    x, y = bend.c2 * radial + bend.s2 * up, bend.c2 * up - bend.s2 * radial
    rolled, z = arm.c_held * x - arm.s_held * across, arm.s_held * x + arm.c_held * across
    return bend.c3 * rolled + bend.s3 * y, bend.c3 * y - bend.s3 * rolled, z


@kernel
def bend_at(arm: Arm, flange: FlangeAxis, branch: int) -> tuple[Elbow, Bend]:
    """Return a branch at a flange position and axis; joint 4 is 0 where the wrist is singular."""
    wrist = wrist_seen(arm, flange)
    elbow = elbow_at(arm, wrist, class_of(branch))
    bend = _arm_at(arm, wrist, elbow)
    x, c5, z = seen_from_forearm(arm, bend, flange.z)
    s5, c4, s4 = np.sqrt(x * x + z * z), 1.0, 0.0
    if s5 >= ON_AXIS:
        c4, s4 = -x / s5, z / s5
    else:
        s5 = 0.0
    if branch & 1:
        c4, s4, s5 = -c4, -s4, -s5
    # Of a singular wrist both signs are one solution, of which joint 4 is taken as 0.
    if s5 == 0.0:
        c4, s4 = 1.0, 0.0
    return elbow, Bend(bend.c1, bend.s1, bend.c2, bend.s2, bend.c3, bend.s3, c4, s4, c5, s5)


@kernel
def branch_terms(arm: Arm, flange: FlangeAxis, out: Array) -> None:
    """Fill in `u^2`, `s5^2`, `cos f` and `(sin f s5 u)^2` of each class `2 * shoulder + elbow`."""
    wrist = wrist_seen(arm, flange)
    for row in range(CLASSES):
        elbow = elbow_at(arm, wrist, row)
        out[row, 0], out[row, 1], out[row, 2], out[row, 3] = elbow.u2, 0.0, elbow.cosine, -1.0
        if elbow.u2 > 0.0 and elbow.sine != 0.0:
            x, _, z = seen_from_forearm(arm, _arm_at(arm, wrist, elbow), flange.z)
            s5_2 = x * x + z * z
            out[row, 1], out[row, 3] = s5_2, elbow.sine * elbow.sine * s5_2 * elbow.u2


@kernel
def joint_axes(arm: Arm, flange: FlangeAxis, branch: int, out: Any) -> bool:
    """Find the joint axes of one branch, without forming joint angles."""
    elbow, bend = bend_at(arm, flange, branch)
    if elbow.u2 < 0.0 or elbow.sine == 0.0 or bend.s5 * bend.s5 < SINGULAR:
        return False
    c1, s1, axis, point = bend.c1, bend.s1, out.axis, out.point
    c_twist, s_twist = arm.c_twist, arm.s_twist
    x1, up = (c1, s1, 0.0), (-c_twist * s1, c_twist * c1, s_twist)
    z2 = (s_twist * s1, -s_twist * c1, c_twist)
    for k in range(3):
        x2, y2 = bend.c2 * x1[k] + bend.s2 * up[k], bend.c2 * up[k] - bend.s2 * x1[k]
        axis[0, k], point[0, k] = 0.0, 0.0
        axis[1, k] = z2[k]
        rolled = arm.c_held * x2 - arm.s_held * z2[k]
        axis[2, k] = arm.s_held * x2 + arm.c_held * z2[k]
        axis[3, k] = bend.c3 * y2 - bend.s3 * rolled
        x3 = bend.c3 * rolled + bend.s3 * y2
        axis[4, k] = bend.s4 * x3 + bend.c4 * axis[2, k]
        axis[5, k] = flange.z[k]
        point[1, k] = arm.a1 * x1[k] + (arm.d1 if k == 2 else 0.0)
        point[2, k] = point[1, k] + arm.a2 * y2 + arm.d2 * axis[2, k] + arm.b2 * rolled
        point[3, k] = point[4, k] = point[5, k] = flange.p[k] - arm.d6 * flange.z[k]
    axis[0, 2] = 1.0
    return True


@kernel
def branch_angles(
    arm: Arm, flange: FlangeAxis, x: Triple, branch: int, slack: float, q: Array
) -> bool:
    """Compute the joint angles of one branch.

    At the wrist singularity (joints 4 and 6 in line) joint 4 is 0; where W lies on joint 1's axis
    joint 1 is 0.
    """
    elbow, bend = bend_at(arm, flange, branch)
    if elbow.u2 < -SINGULAR or elbow.cosine * elbow.cosine > 1.0 + slack:
        return False
    if slack == 0.0 and (elbow.u2 <= 0.0 or bend.s5 * bend.s5 < SINGULAR):
        return False
    q[0] = np.arctan2(bend.s1, bend.c1)
    q[1] = np.arctan2(bend.s2, bend.c2)
    q[2] = np.arctan2(bend.s3, bend.c3)
    q[3] = np.arctan2(bend.s4, bend.c4)
    q[4] = np.arctan2(bend.s5, bend.c5)
    x3, y3, z3 = seen_from_forearm(arm, bend, x)
    along_x4, along_y4 = bend.c4 * x3 - bend.s4 * z3, -bend.s4 * x3 - bend.c4 * z3
    q[5] = np.arctan2(along_y4, bend.c5 * along_x4 + bend.s5 * y3)
    return True


@kernel
def link_frames(arm: Arm, q: Array, frames: Array) -> None:
    """Compute the frames of the links in the limb base frame."""
    a, b, c = form_angle(arm, q, 0), form_angle(arm, q, 1), form_angle(arm, q, 2)
    d, e = form_angle(arm, q, 3), form_angle(arm, q, 4)
    set_frames(arm, turned_by(a, b, c, d, e), frames)


@kernel
def turned_by(q1: float, q2: float, q3: float, q4: float, q5: float) -> Bend:
    """Return cosines and sines of angles of the form [rad]."""
    c1, c2, c3, c4, c5 = np.cos(q1), np.cos(q2), np.cos(q3), np.cos(q4), np.cos(q5)
    s1, s2, s3, s4, s5 = np.sin(q1), np.sin(q2), np.sin(q3), np.sin(q4), np.sin(q5)
    return Bend(c1, s1, c2, s2, c3, s3, c4, s4, c5, s5)


@kernel
def branch_frames(arm: Arm, flange: FlangeAxis, branch: int, frames: Array) -> bool:
    """Compute the frames of the links of one branch, without forming joint angles."""
    elbow, bend = bend_at(arm, flange, branch)
    if elbow.u2 < 0.0 or elbow.sine == 0.0 or bend.s5 * bend.s5 < SINGULAR:
        return False
    set_frames(arm, bend, frames)
    return True


@kernel
def set_frames(arm: Arm, bend: Bend, frames: Array) -> None:
    """Compute the frames of the links by cosines and sines of joints 1 to 5."""
    c1, s1, c2, s2, c3, s3, c4, s4, c5, s5 = bend
    for row in range(4):
        for k in range(3):
            frames[0, row, k] = frames[1, row, k] = 1.0 if row == k + 1 else 0.0
    frames[1, 0, 2] = arm.d1
    frames[1, 1, 0], frames[1, 1, 1] = c1, s1
    frames[1, 2, 0], frames[1, 2, 1] = -s1, c1
    for k in range(3):
        x1, y1, z1 = frames[1, 1, k], frames[1, 2, k], frames[1, 3, k]
        up, z2 = arm.c_twist * y1 + arm.s_twist * z1, arm.c_twist * z1 - arm.s_twist * y1
        x2, y2 = c2 * x1 + s2 * up, c2 * up - s2 * x1
        frames[2, 0, k] = frames[1, 0, k] + arm.a1 * x1
        frames[2, 1, k], frames[2, 2, k], frames[2, 3, k] = x2, y2, z2
        rolled, z3 = arm.c_held * x2 - arm.s_held * z2, arm.s_held * x2 + arm.c_held * z2
        x3, y3 = c3 * rolled + s3 * y2, c3 * y2 - s3 * rolled
        frames[3, 0, k] = frames[2, 0, k] + arm.a2 * y2 + arm.d2 * z3 + arm.b2 * rolled
        frames[3, 1, k], frames[3, 2, k], frames[3, 3, k] = x3, y3, z3
        x4, y4 = c4 * x3 - s4 * z3, -s4 * x3 - c4 * z3
        frames[4, 0, k] = frames[5, 0, k] = frames[3, 0, k] + arm.a3 * x3 + arm.d4 * y3
        frames[4, 1, k], frames[4, 2, k], frames[4, 3, k] = x4, y4, y3
        x5, y5 = c5 * x4 + s5 * y3, c5 * y3 - s5 * x4
        frames[5, 1, k], frames[5, 2, k], frames[5, 3, k] = x5, y5, -y4
        frames[6, 0, k] = frames[5, 0, k] + arm.d6 * y5
        frames[6, 1, k], frames[6, 2, k], frames[6, 3, k] = x5, y4, y5
