"""The operations on an arm, each behind one name; every other module asks here (compiled).

They say which branches reach a flange pose and how far they are from singular, which joint angles
they have, and where their joints and links are. There are two closed
forms, that of the UR arms (`ur`), which arms of space stations share once their first joint is
locked, and that of arms with a spherical wrist (`spherical_wrist`), which seen from the flange
serves arms with a spherical shoulder (`spherical_shoulder`). Other arms of six joints are solved
numerically (`numeric`). Each kernel calls one of them by the field `family` of `Arm`.

All of them take the `Arm`; `flange` is position and axis of its flange in the limb base frame,
`branch` the number of a branch.

A further closed form is a module with these functions, a value of `family`, and a case in each
kernel here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics import numeric, spherical_shoulder, spherical_wrist, ur
from mlivr_gym.kinematics.arm import NUMERIC, SPHERICAL_SHOULDER, UR, Arm, form_angle
from mlivr_gym.kinematics.ur import SINGULAR as SINGULAR
from mlivr_gym.kinematics.ur import SINGULAR_TOO as SINGULAR_TOO

if TYPE_CHECKING:
    from mlivr_gym.kinematics.arm import FlangeAxis
    from mlivr_gym.values import Triple


@kernel
def branch_terms(arm: Arm, flange: FlangeAxis, out: Array) -> None:
    """Fill in the squares that decide reach and singularity of the four classes of branches.

    `out`, shape (4, 4): squared `u` [m^2], squared sine of joint 5, cosine of the elbow angle, and
    the square of `det J / arm.links` [m^2], which is not above zero out of reach.
    """
    if arm.family == UR:
        ur.branch_terms(arm, flange, out)
    elif arm.family == SPHERICAL_SHOULDER:
        spherical_shoulder.branch_terms(arm, flange, out)
    elif arm.family == NUMERIC:
        numeric.branch_terms(arm, flange, out)
    else:
        spherical_wrist.branch_terms(arm, flange, out)


@kernel
def joint_axes(arm: Arm, flange: FlangeAxis, branch: int, out: Any) -> bool:
    """Find the joint axes of one branch, without forming joint angles, and fill `JointAxes`.

    Returned is whether the pose is within reach and away from the singularities of elbow and wrist.
    """
    if arm.family == UR:
        return ur.joint_axes(arm, flange, branch, out)
    if arm.family == SPHERICAL_SHOULDER:
        return spherical_shoulder.joint_axes(arm, flange, branch, out)
    if arm.family == NUMERIC:
        return numeric.joint_axes(arm, flange, branch, out)
    return spherical_wrist.joint_axes(arm, flange, branch, out)


@kernel
def branch_angles(
    arm: Arm, flange: FlangeAxis, x: Triple, branch: int, slack: float, q: Array
) -> bool:
    """Compute the joint angles of one branch; return whether the pose is within reach.

    `x` is the first axis of the flange in the limb base frame; `slack` is 0, or `SINGULAR_TOO` if
    poses at a singularity count, the stretched arm among them. `q`, shape (6,), is filled with
    joint angles [rad] on no particular winding.
    """
    if arm.family == UR:
        there = ur.branch_angles(arm, flange, x, branch, slack, q)
    elif arm.family == SPHERICAL_SHOULDER:
        there = spherical_shoulder.branch_angles(arm, flange, x, branch, slack, q)
    elif arm.family == NUMERIC:
        there = numeric.branch_angles(arm, flange, x, branch, q)
    else:
        there = spherical_wrist.branch_angles(arm, flange, x, branch, slack, q)
    if there and arm.deviates:
        there = numeric.refined(arm, flange, x, q)
    if there:
        for k in range(6):
            q[k] = arm.sign[k] * (q[k] - arm.zero[k])
    return there


@kernel
def link_frames(arm: Arm, q: Array, frames: Array) -> None:
    """Compute the frames of the links in the limb base frame by joint angles [rad], shape (6,).

    `frames`, shape (7, 4, 3): of links 0 (fixed) to 6 the origin [m] and axes x, y, z, z along the
    joint; x and y of link 6 are any pair across the flange axis.
    """
    if arm.deviates or arm.family == NUMERIC:
        numeric.link_frames(arm, q, frames)
    elif arm.family == UR:
        ur.link_frames(arm, q, frames)
    elif arm.family == SPHERICAL_SHOULDER:
        spherical_shoulder.link_frames(arm, q, frames)
    else:
        spherical_wrist.link_frames(arm, q, frames)


@kernel
def turn_flange(arm: Arm, q: Array, frames: Array) -> None:
    """Turn axes x and y of link 6, as `link_frames` gives them, to those of the flange."""
    if arm.deviates or arm.family == SPHERICAL_SHOULDER or arm.family == NUMERIC:
        return
    # The other closed forms leave out joint 6, which turns the flange about its axis.
    angle = form_angle(arm, q, 5)
    c, s = np.cos(angle), np.sin(angle)
    for k in range(3):
        x, y = frames[6, 1, k], frames[6, 2, k]
        frames[6, 1, k], frames[6, 2, k] = c * x + s * y, c * y - s * x


@kernel
def branch_frames(arm: Arm, flange: FlangeAxis, branch: int, axes: Any, frames: Array) -> bool:
    """Compute the link frames of one branch as `link_frames` does, without forming joint angles.

    `axes` is a `JointAxes` for scratch. Returned is whether the pose is within reach and away from
    the singularities of elbow and wrist.
    """
    if arm.family == UR:
        return ur.branch_frames(arm, flange, branch, axes, frames)
    if arm.family == SPHERICAL_SHOULDER:
        return spherical_shoulder.branch_frames(arm, flange, branch, frames)
    if arm.family == NUMERIC:
        return numeric.branch_frames(arm, flange, branch, frames)
    return spherical_wrist.branch_frames(arm, flange, branch, frames)
