"""Closed-form kinematics of arms with a spherical shoulder (compiled).

Axes 1, 2 and 3 meet in the shoulder S. Seen from the flange such an arm is one with a spherical
wrist, see `spherical_wrist`: its joints are those of that form in the opposite order, its wrist
point W is S, and its shoulder is the point P of the flange axis in which axes 5 and 6 meet. Arms of
seven joints have this form where one of the last three is held and the others are in line with the
conditions there: a KUKA iiwa with joint 5 or 6 held, a Franka with joint 6.

Each axis points against that of the form, so that angles keep their signs: `q_i` is joint `7 - i`
of the form. Frame i, fixed to link i, is that of joint `7 - i` of the form before it turns, with y
and z reversed. The lengths are those of the form but for `d1`, from the base to S along axis 1, and
`d6`, from P to the flange along axis 6. The form is given a base and a flange that are shifted on
these axes such that the same two lengths serve. Branches are those of the form. The determinant of
the Jacobian is the form's, since twists of base and flange differ by a transform of determinant 1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics import spherical_wrist
from mlivr_gym.kinematics.arm import FlangeAxis, form_angle
from mlivr_gym.kinematics.poses import cross, dot
from mlivr_gym.kinematics.spherical_wrist import Bend, bend_at, set_frames, turned_by

if TYPE_CHECKING:
    from mlivr_gym.kinematics.arm import Arm
    from mlivr_gym.values import Triple

FLANGE = 6
"""Number of the last link."""


class SeenBase(NamedTuple):
    """The limb base as the form sees it, which begins at the flange."""

    origin: Triple
    """Its origin [m]."""
    x: Triple
    """Its axes, as are the next ones."""
    y: Triple
    z: Triple


@kernel
def _across(z: Triple) -> Triple:
    """Return a unit vector across another one."""
    if abs(z[2]) < 0.9:
        size = np.sqrt(z[0] * z[0] + z[1] * z[1])
        return z[1] / size, -z[0] / size, 0.0
    size = np.sqrt(z[1] * z[1] + z[2] * z[2])
    return 0.0, z[2] / size, -z[1] / size


@kernel
def seen_base(arm: Arm, flange: FlangeAxis, x: Triple) -> SeenBase:
    """Return the limb base seen from a flange whose first axis is `x`."""
    p, z = flange.p, flange.z
    y, shift = cross(z, x), arm.d1 - arm.d6
    start = p[0] + shift * z[0], p[1] + shift * z[1], p[2] + shift * z[2]
    return SeenBase(
        (-dot(start, x), dot(start, y), dot(start, z)),
        (x[0], -y[0], -z[0]),
        (x[1], -y[1], -z[1]),
        (x[2], -y[2], -z[2]),
    )


@kernel
def flange_of_form(arm: Arm, base: SeenBase) -> FlangeAxis:
    """Return the flange of the form, which is fixed to the limb base."""
    shift, (x, y, z) = arm.d1 - arm.d6, base.z
    a, b, c = base.origin
    return FlangeAxis((a + shift * x, b + shift * y, c + shift * z), (-x, -y, -z))


@kernel
def branch_terms(arm: Arm, flange: FlangeAxis, out: Array) -> None:
    """Fill in `u^2`, `s5^2`, `cos f` and `(sin f s5 u)^2` of the form for each class."""
    base = seen_base(arm, flange, _across(flange.z))
    spherical_wrist.branch_terms(arm, flange_of_form(arm, base), out)


@kernel
def _in_base(base: SeenBase, a: float, b: float, c: float) -> Triple:
    """Return a direction in the axes of the limb base."""
    x, y, z = base.x, base.y, base.z
    return (
        x[0] * a + x[1] * b + x[2] * c,
        y[0] * a + y[1] * b + y[2] * c,
        z[0] * a + z[1] * b + z[2] * c,
    )


@kernel
def joint_axes(arm: Arm, flange: FlangeAxis, branch: int, out: Any) -> bool:
    """Find the joint axes of one branch, without forming joint angles."""
    base = seen_base(arm, flange, _across(flange.z))
    if not spherical_wrist.joint_axes(arm, flange_of_form(arm, base), branch, out):
        return False
    axis, point, o = out.axis, out.point, base.origin
    for k in range(3):
        m = 5 - k
        first = _in_base(base, -axis[k, 0], -axis[k, 1], -axis[k, 2])
        last = _in_base(base, -axis[m, 0], -axis[m, 1], -axis[m, 2])
        here = _in_base(base, point[k, 0] - o[0], point[k, 1] - o[1], point[k, 2] - o[2])
        there = _in_base(base, point[m, 0] - o[0], point[m, 1] - o[1], point[m, 2] - o[2])
        axis[k, 0], axis[k, 1], axis[k, 2] = last
        axis[m, 0], axis[m, 1], axis[m, 2] = first
        point[k, 0], point[k, 1], point[k, 2] = there
        point[m, 0], point[m, 1], point[m, 2] = here
    return True


@kernel
def branch_angles(
    arm: Arm, flange: FlangeAxis, x: Triple, branch: int, slack: float, q: Array
) -> bool:
    """Compute the joint angles of one branch.

    At the shoulder singularity (joints 1 and 3 in line) joint 3 is 0; where S lies on the flange
    axis joint 6 is 0.
    """
    base = seen_base(arm, flange, x)
    seen = flange_of_form(arm, base)
    if not spherical_wrist.branch_angles(arm, seen, base.x, branch, slack, q):
        return False
    q[0], q[5] = q[5], q[0]
    q[1], q[4] = q[4], q[1]
    q[2], q[3] = q[3], q[2]
    return True


@kernel
def link_frames(arm: Arm, q: Array, frames: Array) -> None:
    """Compute the frames of the links in the limb base frame."""
    a, b, c = form_angle(arm, q, 5), form_angle(arm, q, 4), form_angle(arm, q, 3)
    bend = turned_by(a, b, c, form_angle(arm, q, 2), form_angle(arm, q, 1))
    set_frames(arm, bend, frames)
    first, last, shift = form_angle(arm, q, 0), frames[FLANGE], arm.d1 - arm.d6
    c, s = np.cos(first), np.sin(first)
    x = (
        c * last[1, 0] + s * last[2, 0],
        c * last[1, 1] + s * last[2, 1],
        c * last[1, 2] + s * last[2, 2],
    )
    z = -last[3, 0], -last[3, 1], -last[3, 2]
    o = last[0, 0] - shift * z[0], last[0, 1] - shift * z[1], last[0, 2] - shift * z[2]
    _set_reversed(arm, bend, SeenBase(o, x, cross(z, x), z), frames)


@kernel
def branch_frames(arm: Arm, flange: FlangeAxis, branch: int, frames: Array) -> bool:
    """Compute the frames of the links of one branch, without forming joint angles."""
    base = seen_base(arm, flange, _across(flange.z))
    elbow, bend = bend_at(arm, flange_of_form(arm, base), branch)
    if elbow.u2 < 0.0 or elbow.sine == 0.0 or bend.s5 * bend.s5 < spherical_wrist.SINGULAR:
        return False
    set_frames(arm, bend, frames)
    _set_reversed(arm, bend, base, frames)
    return True


@kernel
def _set_reversed(arm: Arm, bend: Bend, base: SeenBase, frames: Array) -> None:
    """Turn frames of the form into those of the links in the limb base frame."""
    c1, s1, c2, s2, c3, s3, c4, s4, c5, s5 = bend
    _turn_back(base, c1, s1, frames[1])
    _turn_back(base, c2, s2, frames[2])
    _turn_back(base, c3, s3, frames[3])
    _turn_back(base, c4, s4, frames[4])
    _turn_back(base, c5, s5, frames[5])
    _turn_back(base, 1.0, 0.0, frames[FLANGE])
    for link in range(1, 4):
        for row in range(4):
            for k in range(3):
                other = frames[7 - link, row, k]
                frames[7 - link, row, k] = frames[link, row, k]
                frames[link, row, k] = other
    for k in range(3):
        frames[1, 0, k] = arm.d1 if k == 2 else 0.0
        frames[FLANGE, 0, k] += arm.d6 * frames[FLANGE, 3, k]


@kernel
def _turn_back(base: SeenBase, c: float, s: float, frame: Array) -> None:
    """Move a frame of the form to the limb base frame, from after its joint turns to before it."""
    o = base.origin
    a, b, d = frame[0, 0] - o[0], frame[0, 1] - o[1], frame[0, 2] - o[2]
    frame[0, 0], frame[0, 1], frame[0, 2] = _in_base(base, a, b, d)
    x = _in_base(base, frame[1, 0], frame[1, 1], frame[1, 2])
    y = _in_base(base, frame[2, 0], frame[2, 1], frame[2, 2])
    z = _in_base(base, frame[3, 0], frame[3, 1], frame[3, 2])
    for k in range(3):
        frame[1, k] = c * x[k] - s * y[k]
        frame[2, k] = -(s * x[k] + c * y[k])
        frame[3, k] = -z[k]
