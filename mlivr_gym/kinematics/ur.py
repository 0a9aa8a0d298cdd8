"""Closed-form kinematics of the UR family of arms (compiled).

Frames: the limb base is the DH base frame (z along the first joint axis). The flange is frame 6.

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

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.arm import form_angle

if TYPE_CHECKING:
    from mlivr_gym.kinematics.arm import Arm, FlangeAxis
    from mlivr_gym.values import Triple

SINGULAR = 1e-9
"""Squared sines and lengths [m^2] within this of zero count as zero."""

SINGULAR_TOO = 1e-7
"""Share of `c3^2` by which a stretched arm may fall short where that counts, about 1e-8 m.

Noise of the wrist position is magnified there.
"""

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
def squared_u(arm: Arm, flange: FlangeAxis) -> float:
    """Return `u^2` of a flange position and axis [m^2]; below zero out of reach of joint 1."""
    p, z = flange.p, flange.z
    x, y = p[0] - arm.d6 * z[0], p[1] - arm.d6 * z[1]
    return x * x + y * y - arm.d4 * arm.d4


@kernel
def wrist_at(arm: Arm, flange: FlangeAxis, u: float) -> Wrist:
    """Return the wrist at a flange position and axis, for one sign of `u`."""
    p, z = flange.p, flange.z
    x, y, height = p[0] - arm.d6 * z[0], p[1] - arm.d6 * z[1], p[2] - arm.d6 * z[2] - arm.d1
    square = x * x + y * y
    c1, s1 = (u * x - arm.d4 * y) / square, (u * y + arm.d4 * x) / square
    radial = c1 * z[0] + s1 * z[1]
    return Wrist(u, height, c1, s1, radial, np.sqrt(radial * radial + z[2] * z[2]))


@kernel
def forearm_end(
    arm: Arm, wrist: Wrist, sin_theta: float, cos_theta: float
) -> tuple[float, float, float]:
    """Return the forearm end in the arm's plane, from the shoulder, and the cosine of joint 3.

    `theta` is the angle of joints 2 to 4 together: axis 5 points along (sin, -cos) of it.
    """
    x = wrist.u - arm.d5 * sin_theta
    y = wrist.height + arm.d5 * cos_theta
    square = x * x + y * y
    return x, y, (square - arm.a2 * arm.a2 - arm.a3 * arm.a3) / (2.0 * arm.a2 * arm.a3)


@kernel
def branch_terms(arm: Arm, flange: FlangeAxis, out: Array) -> None:
    """Fill in `u^2`, `s5^2`, `c3` and `(s3 s5 u)^2` of each class `2 * shoulder + wrist`."""
    z, u2 = flange.z, squared_u(arm, flange)
    if u2 <= 0.0:
        for row in range(4):
            out[row, 0], out[row, 1], out[row, 2], out[row, 3] = u2, 0.0, 2.0, -1.0
        return
    size = np.sqrt(u2)
    for shoulder in range(2):
        wrist = wrist_at(arm, flange, -size if shoulder else size)
        s5_2 = wrist.s5 * wrist.s5
        for side in range(2):
            row = 2 * shoulder + side
            out[row, 0], out[row, 1], out[row, 2], out[row, 3] = u2, s5_2, 2.0, -1.0
            if s5_2 >= SINGULAR:
                s5 = -wrist.s5 if side else wrist.s5
                _, _, c3 = forearm_end(arm, wrist, -z[2] / s5, -wrist.radial / s5)
                out[row, 2], out[row, 3] = c3, (1.0 - c3 * c3) * s5_2 * u2


@kernel
def joint_axes(arm: Arm, flange: FlangeAxis, branch: int, out: Any) -> bool:
    """Find the joint axes of one branch, without forming joint angles."""
    p, z, u2 = flange.p, flange.z, squared_u(arm, flange)
    if u2 < 0.0:
        return False
    size = np.sqrt(u2)
    wrist = wrist_at(arm, flange, -size if branch & 4 else size)
    if wrist.s5 * wrist.s5 < SINGULAR:
        return False
    s5 = -wrist.s5 if branch & 2 else wrist.s5
    sin_theta, cos_theta = -z[2] / s5, -wrist.radial / s5
    x, y, c3 = forearm_end(arm, wrist, sin_theta, cos_theta)
    square = x * x + y * y
    if c3 * c3 > 1.0 or square < SINGULAR:
        return False
    s3 = -np.sqrt(1.0 - c3 * c3) if branch & 1 else np.sqrt(1.0 - c3 * c3)
    forth, across = arm.a2 + arm.a3 * c3, arm.a3 * s3
    c2, s2 = (forth * x + across * y) / square, (forth * y - across * x) / square
    c1, s1 = wrist.c1, wrist.s1
    axis, point = out.axis, out.point
    axis[0, 0], axis[0, 1], axis[0, 2] = 0.0, 0.0, 1.0
    point[0, 0], point[0, 1], point[0, 2] = 0.0, 0.0, 0.0
    for k in range(1, 4):
        axis[k, 0], axis[k, 1], axis[k, 2] = s1, -c1, 0.0
    point[1, 0], point[1, 1], point[1, 2] = 0.0, 0.0, arm.d1
    point[2, 0], point[2, 1] = arm.a2 * c2 * c1, arm.a2 * c2 * s1
    point[2, 2] = arm.d1 + arm.a2 * s2
    point[3, 0], point[3, 1], point[3, 2] = x * c1, x * s1, arm.d1 + y
    axis[4, 0], axis[4, 1], axis[4, 2] = sin_theta * c1, sin_theta * s1, -cos_theta
    for k in range(3):
        axis[5, k] = z[k]
        point[4, k] = point[5, k] = p[k] - arm.d6 * z[k]
    return True


@kernel
def branch_angles(
    arm: Arm, flange: FlangeAxis, x: Triple, branch: int, slack: float, q: Array
) -> bool:
    """Compute the joint angles of one branch.

    At the wrist singularity (joints 4 and 6 in line) only their sum or difference is given; the
    solution with the forearm end nearest to the shoulder is taken.
    """
    z, u2 = flange.z, squared_u(arm, flange)
    if u2 < -SINGULAR or (slack == 0.0 and u2 <= 0.0):
        return False
    size = np.sqrt(max(u2, 0.0))
    wrist = wrist_at(arm, flange, -size if branch & 4 else size)
    c1, s1 = wrist.c1, wrist.s1
    s5 = -wrist.s5 if branch & 2 else wrist.s5
    if slack == 0.0 and s5 * s5 < SINGULAR:
        return False
    if wrist.s5 < WRIST_SINGULAR:
        theta = np.arctan2(wrist.u, -wrist.height)
        closest = np.hypot(wrist.u, wrist.height) - abs(arm.d5)
        if abs(closest) < abs(abs(arm.a2) - abs(arm.a3)):
            theta += np.pi
        s5, sin_theta, cos_theta = 0.0, np.sin(theta), np.cos(theta)
    else:
        sin_theta, cos_theta = -z[2] / s5, -wrist.radial / s5
        theta = np.arctan2(sin_theta, cos_theta)
    end_x, end_y, c3 = forearm_end(arm, wrist, sin_theta, cos_theta)
    if c3 * c3 > 1.0 + slack:
        return False
    s3 = np.sqrt(max(0.0, 1.0 - c3 * c3))
    if branch & 1:
        s3 = -s3
    c5 = s1 * z[0] - c1 * z[1]
    q[0] = np.arctan2(s1, c1)
    q[1] = np.arctan2(end_y, end_x) - np.arctan2(arm.a3 * s3, arm.a2 + arm.a3 * c3)
    q[2] = np.arctan2(s3, c3)
    q[3] = theta - q[1] - q[2]
    q[4] = np.arctan2(s5, c5)
    # Axes x and y of the fifth frame, and the flange's x axis in them.
    x5 = c5 * cos_theta * c1 + s5 * s1, c5 * cos_theta * s1 - s5 * c1, c5 * sin_theta
    c6 = x[0] * x5[0] + x[1] * x5[1] + x[2] * x5[2]
    s6 = -(x[0] * sin_theta * c1 + x[1] * sin_theta * s1 - x[2] * cos_theta)
    q[5] = np.arctan2(s6, c6)
    return True


@kernel
def link_frames(arm: Arm, q: Array, frames: Array) -> None:
    """Compute the frames of the links in the limb base frame."""
    angle = form_angle(arm, q, 0)
    c1, s1 = np.cos(angle), np.sin(angle)
    _fixed_frames(arm, c1, s1, frames)
    angle = 0.0
    for link in range(2, 5):
        angle += form_angle(arm, q, link - 1)
        c, s = np.cos(angle), np.sin(angle)
        frames[link, 1, 0], frames[link, 1, 1], frames[link, 1, 2] = c * c1, c * s1, s
        frames[link, 2, 0], frames[link, 2, 1], frames[link, 2, 2] = -s * c1, -s * s1, c
        frames[link, 3, 0], frames[link, 3, 1], frames[link, 3, 2] = s1, -c1, 0.0
    angle = form_angle(arm, q, 4)
    c5, s5 = np.cos(angle), np.sin(angle)
    a2, a3, d4, d5, d6 = arm.a2, arm.a3, arm.d4, arm.d5, arm.d6
    for k in range(3):
        frames[2, 0, k] = frames[1, 0, k]
        frames[3, 0, k] = frames[2, 0, k] + a2 * frames[2, 1, k]
        frames[4, 0, k] = frames[3, 0, k] + a3 * frames[3, 1, k] + d4 * frames[4, 3, k]
        frames[5, 0, k] = frames[4, 0, k] - d5 * frames[4, 2, k]
        frames[5, 1, k] = c5 * frames[4, 1, k] + s5 * frames[4, 3, k]
        frames[5, 2, k] = c5 * frames[4, 3, k] - s5 * frames[4, 1, k]
        frames[5, 3, k] = -frames[4, 2, k]
        frames[6, 0, k] = frames[5, 0, k] + d6 * frames[5, 2, k]
        frames[6, 1, k] = frames[5, 1, k]
        frames[6, 2, k] = -frames[5, 3, k]
        frames[6, 3, k] = frames[5, 2, k]


@kernel
def branch_frames(arm: Arm, flange: FlangeAxis, branch: int, axes: Any, frames: Array) -> bool:
    """Compute the frames of the links of one branch, without forming joint angles."""
    if not joint_axes(arm, flange, branch, axes):
        return False
    axis, point = axes.axis, axes.point
    _fixed_frames(arm, -axis[1, 1], axis[1, 0], frames)
    for k in range(3):
        frames[2, 0, k] = point[1, k]
        frames[2, 1, k] = (point[2, k] - point[1, k]) / arm.a2
        frames[3, 0, k] = point[2, k]
        frames[3, 1, k] = (point[3, k] - point[2, k]) / arm.a3
        frames[4, 0, k] = point[3, k] + arm.d4 * axis[1, k]
        frames[4, 2, k] = -axis[4, k]
        frames[5, 0, k] = point[4, k]
        frames[5, 2, k] = axis[5, k]
        frames[5, 3, k] = axis[4, k]
        frames[6, 0, k] = flange.p[k]
        frames[6, 3, k] = flange.z[k]
        for link in range(2, 5):
            frames[link, 3, k] = axis[1, k]
    for link in range(2, 7):
        if link == 6:
            for k in range(3):
                frames[6, 1, k] = frames[5, 1, k]
        # Which axis is left depends on the two that were set.
        _complete(frames, link, 1 * (link < 4 or link == 6))
    return True


@kernel
def _fixed_frames(arm: Arm, c1: float, s1: float, frames: Array) -> None:
    """Fill in the frames of limb base and shoulder by cosine and sine of joint 1."""
    for link in range(2):
        for row in range(4):
            for k in range(3):
                frames[link, row, k] = 1.0 if row == k + 1 else 0.0
    frames[1, 0, 2] = arm.d1
    frames[1, 1, 0], frames[1, 1, 1] = c1, s1
    frames[1, 2, 0], frames[1, 2, 1] = -s1, c1


@kernel
def _complete(frames: Array, link: int, axis: int) -> None:
    """Set axis 0, 1 or 2 of a link's frame by the cross product of the next two."""
    a, b = (axis + 1) % 3 + 1, (axis + 2) % 3 + 1
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        frames[link, axis + 1, k] = (
            frames[link, a, i] * frames[link, b, j] - frames[link, a, j] * frames[link, b, i]
        )
