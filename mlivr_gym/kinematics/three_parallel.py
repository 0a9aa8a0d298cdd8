"""Closed form of arms whose axes 2, 3 and 4 are parallel, as those of UR (compiled).

Axes 1 and 2, 4 and 5, 5 and 6 cross at right angles. Standard DH convention, with the mount as
frame 0 and the flange as frame 6: lengths d1, a2, a3, d4, d5, d6, twists of a quarter turn at
joints 1 and 4, and of one back at joint 5.

With the wrist point `w = p - d6 z6` and the axis of joints 2 to 4, `y1 = (s1, -c1, 0)`, every
quantity follows without forming a joint angle: `w . y1 = d4` gives joint 1, `z6 . y1 = c5` gives
joint 5, the distance from shoulder to forearm end gives joint 3. The eight solutions are numbered
by

    branch = 4 * shoulder + 2 * wrist + elbow

where `shoulder` is 1 if the wrist lies behind the shoulder (`u < 0`), `wrist` is 1 if `s5 < 0`,
`elbow` is 1 if `s3 < 0`. The number changes only where `det J = -+ a2 a3 s3 s5 u` is zero. A half
turn of the tool about its axis is a half turn of joint 6 and changes nothing else.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.chain import Bend
from mlivr_gym.kinematics.spherical_wrist import SINGULAR, unit_pair, wrist_seen

if TYPE_CHECKING:
    from mlivr_gym.kinematics.chain import FlangeAxis, Form

WRIST_SINGULAR = 1e-9
"""Least |s5| at which joints 4 and 6 are not taken as in line; the error is no larger [rad]."""


class Wrist(NamedTuple):
    """Where the wrist is for one sign of `u`, and how the flange axis lies to joint 1."""

    u: float
    """Distance of the wrist point from joint 1's axis along the arm's plane, signed [m]."""
    height: float
    """Height of the wrist point over the shoulder [m]."""
    c1: float
    """Cosine of joint 1."""
    s1: float
    """Sine of joint 1."""
    radial: float
    """Part of the flange axis along the arm's plane, across joint 1."""
    s5: float
    """Size of the sine of joint 5."""


@kernel
def squared_u(form: Form, flange: FlangeAxis) -> float:
    """Return `u^2` of a flange position and axis [m^2]; below zero out of reach of joint 1."""
    x, y, _ = wrist_seen(form, flange)
    return x * x + y * y - form.d4 * form.d4


@kernel
def wrist_at(form: Form, flange: FlangeAxis, u: float) -> Wrist:
    """Return the wrist at a flange position and axis, for one sign of `u`."""
    z, (x, y, height) = flange.z, wrist_seen(form, flange)
    square = x * x + y * y
    c1, s1 = (u * x - form.d4 * y) / square, (u * y + form.d4 * x) / square
    radial = c1 * z[0] + s1 * z[1]
    return Wrist(u, height, c1, s1, radial, np.sqrt(radial * radial + z[2] * z[2]))


@kernel
def forearm_end(
    form: Form, wrist: Wrist, sin_theta: float, cos_theta: float
) -> tuple[float, float, float]:
    """Return the forearm end in the arm's plane, from the shoulder, and the cosine of joint 3.

    `theta` is the angle of joints 2 to 4 together: axis 5 points along (sin, -cos) of it.
    """
    x = wrist.u - form.d5 * sin_theta
    y = wrist.height + form.d5 * cos_theta
    square = x * x + y * y
    return x, y, (square - form.a2 * form.a2 - form.a3 * form.a3) / (2.0 * form.a2 * form.a3)


@kernel
def set_sizes(form: Form, flange: FlangeAxis, out: Array) -> None:
    """Fill in `|det J|` of each class `2 * shoulder + wrist` [m^3], shape (4,)."""
    z, u2 = flange.z, squared_u(form, flange)
    for row in range(4):
        out[row] = 0.0
    if u2 <= 0.0:
        return
    size, links = np.sqrt(u2), abs(form.a2 * form.a3)
    for shoulder in range(2):
        wrist = wrist_at(form, flange, -size if shoulder else size)
        s5_2 = wrist.s5 * wrist.s5
        for side in range(2):
            if s5_2 >= SINGULAR:
                s5 = -wrist.s5 if side else wrist.s5
                _, _, c3 = forearm_end(form, wrist, -z[2] / s5, -wrist.radial / s5)
                square = (1.0 - c3 * c3) * s5_2 * u2
                if square > SINGULAR * SINGULAR:
                    out[2 * shoulder + side] = links * np.sqrt(square)


@kernel
def form_bend(form: Form, flange: FlangeAxis, branch: int, slack: float) -> tuple[bool, Bend]:
    """Return whether a branch of the form reaches a flange, and the angles of its joints.

    At the wrist singularity (joints 4 and 6 in line) only their sum or difference is given; the
    solution with the forearm end closest to the shoulder is taken.
    """
    z, u2 = flange.z, squared_u(form, flange)
    none = Bend(1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0)
    if u2 < -SINGULAR or (slack == 0.0 and u2 <= 0.0):
        return False, none
    size = np.sqrt(max(u2, 0.0))
    wrist = wrist_at(form, flange, -size if branch & 4 else size)
    c1, s1 = wrist.c1, wrist.s1
    s5 = -wrist.s5 if branch & 2 else wrist.s5
    if slack == 0.0 and s5 * s5 < SINGULAR:
        return False, none
    if wrist.s5 < WRIST_SINGULAR:
        theta = math.atan2(wrist.u, -wrist.height)
        closest = np.sqrt(wrist.u * wrist.u + wrist.height * wrist.height) - abs(form.d5)
        if abs(closest) < abs(abs(form.a2) - abs(form.a3)):
            theta += np.pi
        s5, sin_theta, cos_theta = 0.0, math.sin(theta), math.cos(theta)
    else:
        sin_theta, cos_theta = -z[2] / s5, -wrist.radial / s5
    x, y, c3 = forearm_end(form, wrist, sin_theta, cos_theta)
    if c3 * c3 > 1.0 + slack:
        return False, none
    c3 = min(max(c3, -1.0), 1.0)
    s3 = np.sqrt(1.0 - c3 * c3)
    if branch & 1:
        s3 = -s3
    forth, across = form.a2 + form.a3 * c3, form.a3 * s3
    c2, s2 = unit_pair(forth * x + across * y, forth * y - across * x)
    # The angle of joints 2 and 3 together.
    c, s = c2 * c3 - s2 * s3, s2 * c3 + c2 * s3
    c4, s4 = cos_theta * c + sin_theta * s, sin_theta * c - cos_theta * s
    c5 = s1 * z[0] - c1 * z[1]
    return True, Bend(c1, s1, c2, s2, c3, s3, c4, s4, c5, s5)
