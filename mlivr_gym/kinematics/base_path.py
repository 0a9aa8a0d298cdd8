"""Base paths between two postures, and the joint angles of a limb that holds along one.

The base moves on `t(s)`, `R(s)`, `s` in [0, 1]; timing is a matter of the trajectory.
Rotation is slerp. Translation is a straight line, or, where that fails, an arc about
a pivot (the held grasp): the distance to the pivot changes linearly while the
direction turns by slerp.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.kinematics.ur import inverse_kinematics

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

STRAIGHT, ARC = 0, 1
PATH_KINDS = ("straight", "arc")
"""Names of the path kinds, by number."""

LIMIT_TOLERANCE = 1e-6
"""How far a joint may pass its limits [rad].

Postures are rounded, and a joint often lies exactly on a half turn.
"""

SAMPLES = 16
"""Intervals over which joint angles are followed along a path."""


@kernel
def relative_rotation(r0: Array, r1: Array, axis: Array) -> float:
    """Angle of the rotation from `r0` to `r1` in [0, pi] [rad].

    Args:
        r0: First rotation in the world, shape (3, 3).
        r1: Second rotation in the world, shape (3, 3).
        axis: Filled with the unit axis of `r0^T r1` in the first frame, shape (3,).
    """
    a, b, c = r0[0, 0], r0[1, 0], r0[2, 0]
    d, e, f = r0[0, 1], r0[1, 1], r0[2, 1]
    g, h, i = r0[0, 2], r0[1, 2], r0[2, 2]
    p, q, r = r1[0, 0], r1[1, 0], r1[2, 0]
    s, t, u = r1[0, 1], r1[1, 1], r1[2, 1]
    v, w, k = r1[0, 2], r1[1, 2], r1[2, 2]
    m00, m11, m22 = a * p + b * q + c * r, d * s + e * t + f * u, g * v + h * w + i * k
    m01, m10 = a * s + b * t + c * u, d * p + e * q + f * r
    m02, m20 = a * v + b * w + c * k, g * p + h * q + i * r
    m12, m21 = d * v + e * w + f * k, g * s + h * t + i * u
    x, y, z = m21 - m12, m02 - m20, m10 - m01
    sine2 = np.sqrt(x * x + y * y + z * z)
    angle: float = np.arctan2(sine2, m00 + m11 + m22 - 1.0)
    if sine2 < 1e-7:
        x, y, z = 1.0, 0.0, 0.0
        if angle > 1.0:
            # A half turn is 2 a a^T - 1: its longest column plus the unit vector is parallel to a.
            x, y, z = m00 + 1.0, m10, m20
            if m11 > m00:
                x, y, z = m01, m11 + 1.0, m21
            if m22 > m00 and m22 > m11:
                x, y, z = m02, m12, m22 + 1.0
        sine2 = np.sqrt(x * x + y * y + z * z)
    axis[0], axis[1], axis[2] = x / sine2, y / sine2, z / sine2
    return angle


@kernel
def position_on_path(t0: Array, t1: Array, kind: int, pivot: Array, s: float, out: Array) -> None:
    """Base position in the world at `s` on a path, written into `out`.

    Args:
        t0: Base position in the world at the start [m], shape (3,).
        t1: Base position in the world at the end [m], shape (3,).
        kind: `STRAIGHT` or `ARC`.
        pivot: Centre of the arc in the world [m], shape (3,).
        s: Path parameter from 0 to 1.
        out: Filled, shape (3,) [m].
    """
    if kind == STRAIGHT:
        for k in range(3):
            out[k] = t0[k] + s * (t1[k] - t0[k])
        return
    len0 = len1 = 0.0
    for k in range(3):
        len0 += (t0[k] - pivot[k]) ** 2
        len1 += (t1[k] - pivot[k]) ** 2
    len0, len1 = np.sqrt(len0), np.sqrt(len1)
    angle = angle_about(t0, t1, pivot)
    length = len0 + s * (len1 - len0)
    if angle < 1e-6:
        f0, f1 = 1.0 - s, s
    else:
        f0 = np.sin((1.0 - s) * angle) / np.sin(angle)
        f1 = np.sin(s * angle) / np.sin(angle)
    for k in range(3):
        out[k] = pivot[k] + length * (
            f0 * (t0[k] - pivot[k]) / len0 + f1 * (t1[k] - pivot[k]) / len1
        )


@kernel
def angle_about(t0: Array, t1: Array, pivot: Array) -> float:
    """Angle between the points `t0` and `t1` seen from `pivot`, all of shape (3,) [m], in [rad]."""
    ax, ay, az = t0[0] - pivot[0], t0[1] - pivot[1], t0[2] - pivot[2]
    bx, by, bz = t1[0] - pivot[0], t1[1] - pivot[1], t1[2] - pivot[2]
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    angle: float = np.arctan2(np.sqrt(cx * cx + cy * cy + cz * cz), ax * bx + ay * by + az * bz)
    return angle


@kernel
def turn(axis: Array, c: float, s: float, x: float, y: float, z: float) -> Triple:
    """A vector turned about the unit `axis` by an angle of cosine `c` and sine `s` (Rodrigues)."""
    kx, ky, kz = axis[0], axis[1], axis[2]
    dot = (kx * x + ky * y + kz * z) * (1.0 - c)
    return (
        x * c + (ky * z - kz * y) * s + kx * dot,
        y * c + (kz * x - kx * z) * s + ky * dot,
        z * c + (kx * y - ky * x) * s + kz * dot,
    )


@kernel
def flange_in_limb(
    grip: Array, approach: Array, position: Array, r0: Array, axis: Array, angle: float,
    mount_rotation: Array, mount_position: Array, p: Array, z: Array,
) -> None:  # fmt: skip
    """Flange pose in the limb base frame for a base that has turned away from `r0`.

    Args:
        grip: Flange position in the world [m], shape (3,).
        approach: Flange axis in the world, shape (3,).
        position: Base position in the world [m], shape (3,).
        r0: Base rotation in the world at the path's start, shape (3, 3).
        axis: Rotation axis in the body frame at the start, shape (3,).
        angle: How far the base has turned about it [rad].
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        p: Filled with the flange position in the limb base frame [m], shape (3,).
        z: Filled with the flange axis in the limb base frame, shape (3,).
    """
    dx, dy, dz = grip[0] - position[0], grip[1] - position[1], grip[2] - position[2]
    bx = r0[0, 0] * dx + r0[1, 0] * dy + r0[2, 0] * dz
    by = r0[0, 1] * dx + r0[1, 1] * dy + r0[2, 1] * dz
    bz = r0[0, 2] * dx + r0[1, 2] * dy + r0[2, 2] * dz
    cx = r0[0, 0] * approach[0] + r0[1, 0] * approach[1] + r0[2, 0] * approach[2]
    cy = r0[0, 1] * approach[0] + r0[1, 1] * approach[1] + r0[2, 1] * approach[2]
    cz = r0[0, 2] * approach[0] + r0[1, 2] * approach[1] + r0[2, 2] * approach[2]
    if angle != 0.0:
        c, s = np.cos(angle), -np.sin(angle)
        bx, by, bz = turn(axis, c, s, bx, by, bz)
        cx, cy, cz = turn(axis, c, s, cx, cy, cz)
    bx -= mount_position[0]
    by -= mount_position[1]
    bz -= mount_position[2]
    for k in range(3):
        p[k] = mount_rotation[0, k] * bx + mount_rotation[1, k] * by + mount_rotation[2, k] * bz
        z[k] = mount_rotation[0, k] * cx + mount_rotation[1, k] * cy + mount_rotation[2, k] * cz


@kernel
def follow(
    grip: Array, tool: Array, t0: Array, r0: Array, t1: Array, r1: Array, kind: int, pivot: Array,
    mount_rotation: Array, mount_position: Array, lengths: Array, branch: int, samples: int,
    first: Array, q: Array, low: Array, high: Array,
) -> bool:  # fmt: skip
    """Joint angles of a holding limb along a base path, continuous from `q`.

    Args:
        grip: Flange position in the world [m], shape (3,).
        tool: Flange rotation in the world, shape (3, 3).
        t0: Base position in the world at the start [m], shape (3,).
        r0: Base rotation in the world at the start, shape (3, 3).
        t1: Base position in the world at the end [m], shape (3,).
        r1: Base rotation in the world at the end, shape (3, 3).
        kind: `STRAIGHT` or `ARC`.
        pivot: Centre of the arc in the world [m], shape (3,).
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        branch: Branch label.
        samples: Intervals, or 0 for the start alone.
        first: Filled with the angles at the start, shape (6,) [rad].
        q: Angles close to those at the start, moved to the end, shape (6,) [rad]; NaN to start in
            (-pi, pi].
        low: Least angles so far, shape (6,) [rad], updated.
        high: Largest angles so far, shape (6,) [rad], updated.

    Returns:
        Whether the branch exists all along.
    """
    axis = floats(3)
    omega = relative_rotation(r0, r1, axis)
    position, p, column, z = floats(3), floats(3), floats(3), floats(3)
    rotation, solutions = floats(3, 3), floats(8, 6)
    for sample in range(samples + 1):
        s = sample / samples if samples else 0.0
        position_on_path(t0, t1, kind, pivot, s, position)
        for c in range(3):
            for k in range(3):
                column[k] = tool[k, c]
            flange_in_limb(
                grip, column, position, r0, axis, s * omega, mount_rotation, mount_position, p, z
            )
            for k in range(3):
                rotation[k, c] = z[k]
        if not inverse_kinematics(p, rotation, lengths, solutions) >> branch & 1:
            return False
        for joint in range(6):
            angle = solutions[branch, joint]
            if q[joint] == q[joint]:
                angle += 2.0 * np.pi * np.round((q[joint] - angle) / (2.0 * np.pi))
            q[joint] = angle
            if sample == 0:
                first[joint] = angle
            low[joint] = min(low[joint], angle)
            high[joint] = max(high[joint], angle)
    return True


@kernel
def within_limits(
    grip: Array, tool: Array, t0: Array, r0: Array, t1: Array, r1: Array, kind: int, pivot: Array,
    mount_rotation: Array, mount_position: Array, lengths: Array, limits: Array, mask: int,
) -> int:  # fmt: skip
    """Branches and flips in `mask` on which the joint angles stay inside the limits along a path.

    A joint may start on any winding. Bit `branch + 8 * flip`; the flip is a half turn of joint 6.
    Other arguments as in `follow`; `limits` has shape (6, 2) [rad].
    """
    first, q, low, high = floats(6), floats(6), floats(6), floats(6)
    for branch in range(8):
        both = 0x0101 << branch
        if not mask & both:
            continue
        for joint in range(6):
            q[joint], low[joint], high[joint] = np.nan, np.inf, -np.inf
        if not follow(
            grip,
            tool,
            t0,
            r0,
            t1,
            r1,
            kind,
            pivot,
            mount_rotation,
            mount_position,
            lengths,
            branch,
            SAMPLES,
            first,
            q,
            low,
            high,
        ):
            mask &= ~both
            continue
        for flip in range(2):
            for joint in range(6):
                shift = np.pi if flip == 1 and joint == 5 else 0.0
                turns = np.ceil(
                    (limits[joint, 0] - LIMIT_TOLERANCE - low[joint] - shift) / (2.0 * np.pi)
                )
                if high[joint] + shift + 2.0 * np.pi * turns > limits[joint, 1] + LIMIT_TOLERANCE:
                    mask &= ~(1 << (branch + 8 * flip))
                    break
    return mask
