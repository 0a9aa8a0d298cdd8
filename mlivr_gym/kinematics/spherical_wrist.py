"""Closed form of arms with a spherical wrist (compiled).

Axes 4, 5 and 6 meet in the wrist point W, successive ones at right angles, and axis 4 is at right
angles to axis 3. Either axes 2 and 3 are parallel and axis 2 is at right angles to axis 1 (most
industrial robots); or axes 1 and 2 meet in a point, the shoulder, at any angle but 0 (arms of seven
joints of which one of the first three is locked). `r` is the angle from axis 1 to axis 2, `t` that
from axis 2 to axis 3.

Frames: z of each link is its joint axis, y of the links 2, 3 and 5 points along the arm. At zero
angles the arm stands upright along z of the mount. The link frames follow from each other by

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

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.bit_sets import CLASSES, class_of
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.chain import Bend

if TYPE_CHECKING:
    from mlivr_gym.kinematics.chain import FlangeAxis, Form
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


@kernel
def unit_pair(x: float, y: float) -> tuple[float, float]:
    """Return a pair of products of lengths divided by its size, (1, 0) of one that has none."""
    size = np.sqrt(x * x + y * y)
    if size < ON_AXIS * ON_AXIS:
        return 1.0, 0.0
    return x / size, y / size


@kernel
def in_elbow_plane(form: Form, cosine: float, sine: float) -> tuple[float, float]:
    """Return W seen from the shoulder in the plane across axis 3, along `b2` and `a2` [m].

    Parameters are cosine and sine of the elbow angle.
    """
    c, s = cosine * form.c_fold + sine * form.s_fold, sine * form.c_fold - cosine * form.s_fold
    return form.b2 - form.forearm * s, form.a2 + form.forearm * c


@kernel
def wrist_seen(form: Form, flange: FlangeAxis) -> Triple:
    """Return the wrist point seen from the height of the shoulder on joint 1's axis [m]."""
    p, z = flange.p, flange.z
    return p[0] - form.d6 * z[0], p[1] - form.d6 * z[1], p[2] - form.d6 * z[2] - form.d1


@kernel
def elbow_at(form: Form, wrist: Triple, choice: int) -> Elbow:
    """Return shoulder and elbow of a class of branches at a wrist point."""
    x, y, h = wrist
    square, k2 = x * x + y * y, form.upper * form.upper + form.forearm * form.forearm
    offset, u2, u = form.d2, 0.0, 0.0
    if form.s_lean == 0.0:
        u2 = square - offset * offset
        u = np.sqrt(max(u2, 0.0))
        if choice & 2:
            u = -u
        square = (u - form.a1) * (u - form.a1)
    else:
        k2 += form.d2 * form.d2
    cosine = (square + h * h - k2) / (2.0 * form.upper * form.forearm)
    sine = np.sqrt(max(1.0 - cosine * cosine, 0.0))
    if choice & 1:
        sine = -sine
    if form.s_lean != 0.0:
        beside, _ = in_elbow_plane(form, cosine, sine)
        along_axis_2 = form.c_lean * form.d2 - form.s_lean * beside
        offset = (along_axis_2 - form.c_twist * h) / form.s_twist
        u2 = square - offset * offset
        u = np.sqrt(max(u2, 0.0))
        if choice & 2:
            u = -u
    return Elbow(u2, u, offset, cosine, sine)


@kernel
def _arm_at(form: Form, wrist: Triple, elbow: Elbow) -> Bend:
    """Return cosines and sines of joints 1 to 3; joints 4 and 5 are 0."""
    x, y, h = wrist
    c1, s1 = unit_pair(elbow.u * x - elbow.offset * y, elbow.u * y + elbow.offset * x)
    # W in the plane across axis 2, seen from there: before joint 2 turns, and after.
    before_x, before_y = in_elbow_plane(form, elbow.cosine, elbow.sine)
    before_x = form.c_lean * before_x + form.s_lean * form.d2
    after_x, after_y = elbow.u - form.a1, form.s_twist * h - form.c_twist * elbow.offset
    c2, s2 = unit_pair(
        after_x * before_x + after_y * before_y, after_y * before_x - after_x * before_y
    )
    cosine, sine = unit_pair(elbow.cosine, elbow.sine)
    c3 = cosine * form.c_bend - sine * form.s_bend
    s3 = sine * form.c_bend + cosine * form.s_bend
    return Bend(c1, s1, c2, s2, c3, s3, 1.0, 0.0, 1.0, 0.0)


@kernel
def seen_from_forearm(form: Form, bend: Bend, v: Triple) -> Triple:
    """Return a direction in the axes of link 3, given in those of the mount."""
    radial, side = bend.c1 * v[0] + bend.s1 * v[1], bend.s1 * v[0] - bend.c1 * v[1]
    up = form.s_twist * v[2] - form.c_twist * side
    across = form.s_twist * side + form.c_twist * v[2]
    x, y = bend.c2 * radial + bend.s2 * up, bend.c2 * up - bend.s2 * radial
    rolled, z = form.c_lean * x - form.s_lean * across, form.s_lean * x + form.c_lean * across
    return bend.c3 * rolled + bend.s3 * y, bend.c3 * y - bend.s3 * rolled, z


@kernel
def set_sizes(form: Form, flange: FlangeAxis, out: Array) -> None:
    """Fill in `|det J|` of each class `2 * shoulder + elbow` [m^3], shape (4,)."""
    wrist, links = wrist_seen(form, flange), form.upper * form.forearm * form.s_twist
    for row in range(CLASSES):
        out[row], elbow = 0.0, elbow_at(form, wrist, row)
        if elbow.u2 > 0.0 and elbow.sine != 0.0:
            x, _, z = seen_from_forearm(form, _arm_at(form, wrist, elbow), flange.z)
            square = elbow.sine * elbow.sine * (x * x + z * z) * elbow.u2
            if square > SINGULAR * SINGULAR:
                out[row] = links * np.sqrt(square)


@kernel
def form_bend(form: Form, flange: FlangeAxis, branch: int, slack: float) -> tuple[bool, Bend]:
    """Return whether a branch of the form reaches a flange, and the angles of its joints.

    At the wrist singularity (joints 4 and 6 in line) joint 4 is 0; where W lies on joint 1's axis
    joint 1 is 0.
    """
    wrist = wrist_seen(form, flange)
    elbow = elbow_at(form, wrist, class_of(branch))
    bend = _arm_at(form, wrist, elbow)
    x, c5, z = seen_from_forearm(form, bend, flange.z)
    s5, c4, s4 = np.sqrt(x * x + z * z), 1.0, 0.0
    # Of a singular wrist both signs are one solution, of which joint 4 is taken as 0.
    if s5 < ON_AXIS:
        s5 = 0.0
    else:
        c4, s4 = -x / s5, z / s5
        if branch & 1:
            c4, s4, s5 = -c4, -s4, -s5
    there = elbow.u2 >= -SINGULAR and elbow.cosine * elbow.cosine <= 1.0 + slack
    if slack == 0.0:
        there = there and elbow.u2 > 0.0 and elbow.sine != 0.0 and s5 * s5 >= SINGULAR
    return there, Bend(bend.c1, bend.s1, bend.c2, bend.s2, bend.c3, bend.s3, c4, s4, c5, s5)
