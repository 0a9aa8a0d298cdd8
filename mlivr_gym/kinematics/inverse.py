"""Inverse kinematics of a chain, behind one name for each question (compiled).

At most eight **branches** reach a flange pose. There are two closed forms: `three_parallel`, and
`spherical_wrist`, which serves arms with a spherical shoulder too, since these are the same seen
from the flange. All other chains are solved numerically, see `numeric`. Which one serves is told by
`forms`, and nowhere else does it matter; nor do the angles of a closed form, whose joints may turn
the other way and be elsewhere at zero.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics import numeric, spherical_wrist, three_parallel
from mlivr_gym.kinematics.chain import (
    Bend,
    Chain,
    FlangeAxis,
    Frame,
    Links,
    links_at,
    set_frames,
    stepped,
)
from mlivr_gym.kinematics.forms import NUMERIC, THREE_PARALLEL
from mlivr_gym.kinematics.poses import cross, dot

if TYPE_CHECKING:
    from mlivr_gym.kinematics.chain import Form
    from mlivr_gym.values import Triple

SINGULAR_TOO = 1e-7
"""Share of the squared cosine of the elbow by which a stretched arm may fall short where that
counts, about 1e-8 m. Noise of the wrist position is magnified there."""


@kernel
def branch_sizes(arm: Chain, flange: FlangeAxis, out: Array) -> None:
    """Fill in `|det J|` of the four classes of branches [m^3], shape (4,), 0 out of reach."""
    form = arm.form
    if form.kind == THREE_PARALLEL:
        three_parallel.set_sizes(form, flange, out)
    elif form.kind == NUMERIC:
        numeric.set_sizes(arm, flange, out)
    elif form.from_flange:
        spherical_wrist.set_sizes(form, _mount_seen(flange, _across(flange.z)), out)
    else:
        spherical_wrist.set_sizes(form, flange, out)


@kernel
def branch_angles(
    arm: Chain, flange: FlangeAxis, x: Triple, branch: int, slack: float, q: Array
) -> bool:
    """Compute the joint angles of one branch; return whether the pose is within reach.

    `flange` is position and axis of the flange in the mount, `x` its first axis there; `slack` is
    0, or `SINGULAR_TOO` if poses at a singularity count, the stretched arm among them. `q`, shape
    (6,), is filled with joint angles [rad] on no particular winding.
    """
    there, bend = _solution(arm, flange, branch, slack)
    if there:
        _set_angles(arm, bend, x, stepped(arm, 5, links_at(arm, bend).f5), q)
    return there


@kernel
def branch_posture(
    arm: Chain, flange: FlangeAxis, x: Triple, branch: int, slack: float, q: Array, frames: Array
) -> bool:
    """Compute joint angles as `branch_angles` does, and the frames of the links there."""
    there, bend = _solution(arm, flange, branch, slack)
    if there:
        links = links_at(arm, bend)
        last = stepped(arm, 5, links.f5)
        _set_angles(arm, bend, x, last, q)
        set_frames(links, Frame(last.o, x, cross(last.z, x), last.z), frames)
    return there


@kernel
def _set_angles(arm: Chain, b: Bend, x: Triple, last: Frame, q: Array) -> None:
    """Write joint angles by the flange's first axis, and its frame where joint 6 is not turned."""
    q[0], q[1], q[2] = math.atan2(b.s1, b.c1), math.atan2(b.s2, b.c2), math.atan2(b.s3, b.c3)
    q[3], q[4] = math.atan2(b.s4, b.c4), math.atan2(b.s5, b.c5)
    q[5] = math.atan2(dot(x, last.y), dot(x, last.x))
    for joint in range(6):
        q[joint] *= arm.sense[joint]


@kernel
def branch_frames(arm: Chain, flange: FlangeAxis, branch: int, frames: Array) -> bool:
    """Compute the frames of the links of one branch, as `link_frames` does.

    The flange may be turned about its axis. Returned is whether the pose is within reach and away
    from the singularities of elbow and wrist.
    """
    there, links = branch_links(arm, flange, branch)
    if there:
        set_frames(links, stepped(arm, 5, links.f5), frames)
    return there


@kernel
def branch_links(arm: Chain, flange: FlangeAxis, branch: int) -> tuple[bool, Links]:
    """Return the frames of the links 1 to 5 on one branch; for the rest see `branch_frames`."""
    there, bend = _solution(arm, flange, branch, 0.0)
    return there, links_at(arm, bend)


@kernel
def _solution(arm: Chain, flange: FlangeAxis, branch: int, slack: float) -> tuple[bool, Bend]:
    """Return whether a branch reaches a flange, and how far joints 1 to 5 are turned."""
    form = arm.form
    if form.kind == NUMERIC:
        return numeric.solution(arm, flange, branch)
    if form.kind == THREE_PARALLEL:
        there, solution = three_parallel.form_bend(form, flange, branch, slack)
        bend = _of_arm(form, solution)
    elif form.from_flange:
        seen = _mount_seen(flange, _across(flange.z))
        there, solution = spherical_wrist.form_bend(form, seen, branch, slack)
        bend = _with_first(arm, flange, _of_arm(form, solution))
    else:
        there, solution = spherical_wrist.form_bend(form, flange, branch, slack)
        bend = _of_arm(form, solution)
    if there and form.deviates:
        return numeric.refined(arm, flange, bend)
    return there, bend


@kernel
def _turn(form: Form, joint: int, c: float, s: float) -> tuple[float, float]:
    """Return how far a joint of the arm is turned, by the angle of that of the form."""
    c_zero, s_zero = form.c_zero[joint], form.s_zero[joint]
    return c * c_zero + s * s_zero, form.sign[joint] * (s * c_zero - c * s_zero)


@kernel
def _of_arm(form: Form, b: Bend) -> Bend:
    """Return how far the joints are turned by the angles of the form, in its order."""
    c1, s1 = _turn(form, 0, b.c1, b.s1)
    c2, s2 = _turn(form, 1, b.c2, b.s2)
    c3, s3 = _turn(form, 2, b.c3, b.s3)
    c4, s4 = _turn(form, 3, b.c4, b.s4)
    c5, s5 = _turn(form, 4, b.c5, b.s5)
    return Bend(c1, s1, c2, s2, c3, s3, c4, s4, c5, s5)


@kernel
def _across(z: Triple) -> Triple:
    """Return a unit vector across another one."""
    if abs(z[2]) < 0.9:
        size = np.sqrt(z[0] * z[0] + z[1] * z[1])
        return z[1] / size, -z[0] / size, 0.0
    size = np.sqrt(z[1] * z[1] + z[2] * z[2])
    return 0.0, z[2] / size, -z[1] / size


@kernel
def _mount_seen(flange: FlangeAxis, x: Triple) -> FlangeAxis:
    """Return origin and z axis of the mount, turned back, as seen from a flange turned over."""
    p, z = flange.p, flange.z
    y = cross(z, x)
    return FlangeAxis((-dot(p, x), dot(p, y), dot(p, z)), (-x[2], y[2], z[2]))


@kernel
def _with_first(arm: Chain, flange: FlangeAxis, b: Bend) -> Bend:
    """Return the joints 1 to 5 of an arm by those that are 1 to 5 seen from the flange, 6 to 2.

    Joint 1 is what is left to be turned about the z axis of the mount.
    """
    bend = Bend(1.0, 0.0, b.c5, b.s5, b.c4, b.s4, b.c3, b.s3, b.c2, b.s2)
    tip, unit = stepped(arm, 5, links_at(arm, bend).f5), arm.form.unit
    (px, py, _), (zx, zy, _) = flange.p, flange.z
    ahead = tip.o[0] * px + tip.o[1] * py + unit * unit * (tip.z[0] * zx + tip.z[1] * zy)
    aside = tip.o[0] * py - tip.o[1] * px + unit * unit * (tip.z[0] * zy - tip.z[1] * zx)
    c, s = spherical_wrist.unit_pair(ahead, aside)
    return Bend(c, s, bend.c2, bend.s2, bend.c3, bend.s3, bend.c4, bend.s4, bend.c5, bend.s5)
