"""Closed-form kinematics of UR arms (compiled).

Frames: the limb base is the DH base frame (z along the first joint axis). The
flange is frame 6. Lengths come as `lengths = (d1, a2, a3, d4, d5, d6)`.

With the wrist point `w = p - d6 z6` and the axis of joints 2 to 4,
`y1 = (s1, -c1, 0)`, every quantity follows without forming a joint angle:
`w . y1 = d4` gives joint 1, `z6 . y1 = c5` gives joint 5, the distance from
shoulder to forearm end gives joint 3. The eight solutions are labelled by

    branch = 4 * shoulder + 2 * wrist + elbow

where `shoulder` is 1 if the wrist lies behind the shoulder (`u < 0`), `wrist`
is 1 if `s5 < 0`, `elbow` is 1 if `s3 < 0`. Labels change only where
`det J = -+ a2 a3 s3 s5 u` is zero. A half turn of the tool about its axis is a
half turn of joint 6 and changes nothing else.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel

BRANCHES = 8
"""Number of closed-form solutions."""

SINGULAR = 1e-9
"""Squared sines and lengths [m^2] within this of zero count as zero."""

STRETCHED = 1e-7
"""Share of `c3^2` by which a stretched arm may fall short, about 1e-8 m.

Noise of the wrist position is magnified there.
"""

WRIST_SINGULAR = 1e-9
"""Least |s5| at which joints 4 and 6 are not taken as in line; the error is no larger [rad]."""


@kernel
def branch_terms(p: Array, z: Array, lengths: Array, out: Array) -> None:
    """Squares that decide reach and singularity of the four shoulder and wrist choices.

    Args:
        p: Flange position in the limb base frame [m], shape (3,).
        z: Flange axis in the limb base frame, shape (3,).
        lengths: Shape (6,).
        out: Shape (4, 4), filled with `u^2` [m^2], `s5^2`, `c3` and `(s3 s5 u)^2` [m^2] for choice
            `2 * shoulder + wrist`. The last is `(det J / (a2 a3))^2`, and not above zero out of
            reach.
    """
    d1, a2, a3, d4, d5, d6 = lengths
    wx, wy, wz = p[0] - d6 * z[0], p[1] - d6 * z[1], p[2] - d6 * z[2]
    rho2 = wx * wx + wy * wy
    u2 = rho2 - d4 * d4
    if u2 <= 0.0:
        for row in range(4):
            out[row, 0], out[row, 1], out[row, 2], out[row, 3] = u2, 0.0, 2.0, -1.0
        return
    u_abs = np.sqrt(u2)
    for shoulder in range(2):
        u = u_abs if shoulder == 0 else -u_abs
        c1 = (u * wx - d4 * wy) / rho2
        s1 = (u * wy + d4 * wx) / rho2
        zr = c1 * z[0] + s1 * z[1]
        s5_2 = zr * zr + z[2] * z[2]
        s5_abs = np.sqrt(s5_2)
        for wrist in range(2):
            row = 2 * shoulder + wrist
            out[row, 0] = u2
            out[row, 1] = s5_2
            if s5_2 < SINGULAR:
                out[row, 2], out[row, 3] = 2.0, -1.0
                continue
            s5 = s5_abs if wrist == 0 else -s5_abs
            px = u + d5 * z[2] / s5
            pz = wz - d1 - d5 * zr / s5
            c3 = (px * px + pz * pz - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
            out[row, 2] = c3
            out[row, 3] = (1.0 - c3 * c3) * s5_2 * u2


@kernel
def limb_axes(p: Array, z: Array, lengths: Array, branch: int, axes: Array, origins: Array) -> bool:
    """Joint axes of one branch, without forming joint angles.

    Args:
        p: Flange position in the limb base frame [m], shape (3,).
        z: Flange axis in the limb base frame, shape (3,).
        lengths: Shape (6,).
        branch: Branch label.
        axes: Shape (6, 3), filled with the unit axes of the joints in the limb base frame.
        origins: Shape (6, 3), filled with a point on each axis there [m].

    Returns:
        Whether the pose is within reach and away from the wrist singularity.
    """
    d1, a2, a3, d4, d5, d6 = lengths
    wx, wy, wz = p[0] - d6 * z[0], p[1] - d6 * z[1], p[2] - d6 * z[2]
    rho2 = wx * wx + wy * wy
    u2 = rho2 - d4 * d4
    if u2 < 0.0:
        return False
    u = -np.sqrt(u2) if branch & 4 else np.sqrt(u2)
    c1 = (u * wx - d4 * wy) / rho2
    s1 = (u * wy + d4 * wx) / rho2
    zr = c1 * z[0] + s1 * z[1]
    s5 = np.sqrt(zr * zr + z[2] * z[2])
    if s5 * s5 < SINGULAR:
        return False
    if branch & 2:
        s5 = -s5
    cos_theta, sin_theta = -zr / s5, -z[2] / s5
    px = u - d5 * sin_theta
    pz = wz - d1 + d5 * cos_theta
    dist2 = px * px + pz * pz
    c3 = (dist2 - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
    if c3 * c3 > 1.0 or dist2 < SINGULAR:
        return False
    s3 = np.sqrt(1.0 - c3 * c3)
    if branch & 1:
        s3 = -s3
    along, across = a2 + a3 * c3, a3 * s3
    c2 = (along * px + across * pz) / dist2
    s2 = (along * pz - across * px) / dist2
    axes[0, 0], axes[0, 1], axes[0, 2] = 0.0, 0.0, 1.0
    origins[0, 0], origins[0, 1], origins[0, 2] = 0.0, 0.0, 0.0
    for k in range(1, 4):
        axes[k, 0], axes[k, 1], axes[k, 2] = s1, -c1, 0.0
    origins[1, 0], origins[1, 1], origins[1, 2] = 0.0, 0.0, d1
    origins[2, 0], origins[2, 1], origins[2, 2] = a2 * c2 * c1, a2 * c2 * s1, d1 + a2 * s2
    origins[3, 0], origins[3, 1], origins[3, 2] = px * c1, px * s1, d1 + pz
    axes[4, 0], axes[4, 1], axes[4, 2] = sin_theta * c1, sin_theta * s1, -cos_theta
    axes[5, 0], axes[5, 1], axes[5, 2] = z[0], z[1], z[2]
    for row in range(4, 6):
        origins[row, 0], origins[row, 1], origins[row, 2] = wx, wy, wz
    return True


@kernel
def wrap(angle: float) -> float:
    """The angle plus whole turns that lies nearest to zero [rad]."""
    wrapped: float = angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))
    return wrapped


@kernel
def inverse_kinematics(p: Array, r: Array, lengths: Array, out: Array) -> int:
    """All closed-form joint solutions of a flange pose.

    At the wrist singularity (joints 4 and 6 in line) only their sum or difference is
    given; the solution with the forearm end nearest to the shoulder is returned.

    Args:
        p: Flange position in the limb base frame [m], shape (3,).
        r: Flange rotation in the limb base frame, shape (3, 3).
        lengths: Shape (6,).
        out: Shape (8, 6), row `branch` filled with joint angles in (-pi, pi], NaN if there are
            none.

    Returns:
        Bit mask of the branches that exist.
    """
    d1, a2, a3, d4, d5, d6 = lengths
    for branch in range(BRANCHES):
        for joint in range(6):
            out[branch, joint] = np.nan
    z = r[0, 2], r[1, 2], r[2, 2]
    wx, wy, wz = p[0] - d6 * z[0], p[1] - d6 * z[1], p[2] - d6 * z[2]
    rho2 = wx * wx + wy * wy
    u2 = rho2 - d4 * d4
    if u2 < -SINGULAR:
        return 0
    u_abs = np.sqrt(max(u2, 0.0))
    mask = 0
    for branch in range(BRANCHES):
        u = -u_abs if branch & 4 else u_abs
        c1 = (u * wx - d4 * wy) / rho2
        s1 = (u * wy + d4 * wx) / rho2
        zr = c1 * z[0] + s1 * z[1]
        c5 = s1 * z[0] - c1 * z[1]
        s5 = np.sqrt(zr * zr + z[2] * z[2])
        if s5 < WRIST_SINGULAR:
            theta = np.arctan2(u, d1 - wz)
            closest = np.hypot(u, wz - d1) - abs(d5)
            if abs(closest) < abs(abs(a2) - abs(a3)):
                theta += np.pi
            s5 = 0.0
        else:
            if branch & 2:
                s5 = -s5
            theta = np.arctan2(-z[2] / s5, -zr / s5)
        sin_theta, cos_theta = np.sin(theta), np.cos(theta)
        px = u - d5 * sin_theta
        pz = wz - d1 + d5 * cos_theta
        c3 = (px * px + pz * pz - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
        if c3 * c3 > 1.0 + STRETCHED:
            continue
        s3 = np.sqrt(max(0.0, 1.0 - c3 * c3))
        if branch & 1:
            s3 = -s3
        q2 = np.arctan2(pz, px) - np.arctan2(a3 * s3, a2 + a3 * c3)
        q3 = np.arctan2(s3, c3)
        x5 = c5 * cos_theta * c1 + s5 * s1, c5 * cos_theta * s1 - s5 * c1, c5 * sin_theta
        z4 = sin_theta * c1, sin_theta * s1, -cos_theta
        c6 = r[0, 0] * x5[0] + r[1, 0] * x5[1] + r[2, 0] * x5[2]
        s6 = -(r[0, 0] * z4[0] + r[1, 0] * z4[1] + r[2, 0] * z4[2])
        out[branch, 0] = np.arctan2(s1, c1)
        out[branch, 1] = wrap(q2)
        out[branch, 2] = q3
        out[branch, 3] = wrap(theta - q2 - q3)
        out[branch, 4] = np.arctan2(s5, c5)
        out[branch, 5] = np.arctan2(s6, c6)
        mask |= 1 << branch
    return mask


@kernel
def branch_angles(p: Array, x: Array, z: Array, lengths: Array, branch: int, q: Array) -> bool:
    """Joint angles of one branch away from singularities.

    Args:
        p: Flange position in the limb base frame [m], shape (3,).
        x: First axis of the flange in the limb base frame, shape (3,).
        z: Flange axis in the limb base frame, shape (3,).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        branch: Branch label.
        q: Filled with joint angles [rad], shape (6,), on no particular winding.

    Returns:
        Whether the pose is within reach and away from the wrist singularity.
    """
    d1, a2, a3, d4, d5, d6 = lengths
    wx, wy, wz = p[0] - d6 * z[0], p[1] - d6 * z[1], p[2] - d6 * z[2]
    rho2 = wx * wx + wy * wy
    u2 = rho2 - d4 * d4
    if u2 <= 0.0:
        return False
    u = -np.sqrt(u2) if branch & 4 else np.sqrt(u2)
    c1 = (u * wx - d4 * wy) / rho2
    s1 = (u * wy + d4 * wx) / rho2
    zr = c1 * z[0] + s1 * z[1]
    c5 = s1 * z[0] - c1 * z[1]
    s5 = np.sqrt(zr * zr + z[2] * z[2])
    if s5 * s5 < SINGULAR:
        return False
    if branch & 2:
        s5 = -s5
    sin_theta, cos_theta = -z[2] / s5, -zr / s5
    px = u - d5 * sin_theta
    pz = wz - d1 + d5 * cos_theta
    c3 = (px * px + pz * pz - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
    if c3 * c3 > 1.0:
        return False
    s3 = np.sqrt(1.0 - c3 * c3)
    if branch & 1:
        s3 = -s3
    q[0] = np.arctan2(s1, c1)
    q[1] = np.arctan2(pz, px) - np.arctan2(a3 * s3, a2 + a3 * c3)
    q[2] = np.arctan2(s3, c3)
    q[3] = np.arctan2(sin_theta, cos_theta) - q[1] - q[2]
    q[4] = np.arctan2(s5, c5)
    x5 = c5 * cos_theta * c1 + s5 * s1, c5 * cos_theta * s1 - s5 * c1, c5 * sin_theta
    c6 = x[0] * x5[0] + x[1] * x5[1] + x[2] * x5[2]
    s6 = -(x[0] * sin_theta * c1 + x[1] * sin_theta * s1 - x[2] * cos_theta)
    q[5] = np.arctan2(s6, c6)
    return True


def forward_kinematics(q: Array, lengths: Array) -> Array:
    """Frames 0 to 6 of a UR arm in the limb base frame.

    Args:
        q: Joint angles [rad], shape (6,).
        lengths: d1, a2, a3, d4, d5, d6 [m], shape (6,).

    Returns:
        Homogeneous transforms, shape (7, 4, 4); frame 6 is the flange.
    """
    d1, a2, a3, d4, d5, d6 = lengths
    rows = ((d1, 0.0, 1), (0.0, a2, 0), (0.0, a3, 0), (d4, 0.0, 1), (d5, 0.0, -1), (d6, 0.0, 0))
    frames = np.empty((7, 4, 4))
    frames[0] = np.eye(4)
    for k, (d, a, quarter) in enumerate(rows):
        c, s = np.cos(q[k]), np.sin(q[k])
        ca, sa = 1.0 - abs(quarter), float(quarter)
        step = np.array(
            [
                [c, -s * ca, s * sa, a * c],
                [s, c * ca, -c * sa, a * s],
                [0.0, sa, ca, d],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
        frames[k + 1] = frames[k] @ step
    return frames


def jacobian(q: Array, lengths: Array) -> Array:
    """Geometric Jacobian of the flange in the limb base frame, shape (6, 6) [m, 1].

    Linear rows come first.
    """
    frames = forward_kinematics(q, lengths)
    axes, origins = frames[:6, :3, 2], frames[:6, :3, 3]
    return np.vstack([np.cross(axes, frames[6, :3, 3] - origins).T, axes.T])
