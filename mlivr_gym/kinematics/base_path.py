"""Base paths between two postures, and the proof that a holding limb can follow one.

The base moves on `t(s)`, `R(s)`, `s` in [0, 1]; timing is a matter of the trajectory.
Rotation is slerp. Translation is a straight line, or, where that fails, an arc about
a pivot (the held grasp): the distance to the pivot changes linearly while the
direction turns by slerp.

**Certificate.** A holding limb stays on its branch as long as `u`, `s5` and `s3` keep
their signs. `certify` proves that `w_m` stays at or above a floor over the whole
path, not merely at samples. On an interval of half length `delta` about a midpoint the wrist
moves at most `d = sigma delta` in the limb frame and the flange axis turns at most
`a = omega delta`, hence

    u^2    >= (rho - d)^2 - d4^2
    q1     changes by at most b1 = d / u_min            (|dq1/dw| = 1/u exactly)
    |s5|   >= |s5| - (a + b1)
    z4     turns by at most b4 = (a + b1) / s5_min      (z4 = +-(y1 x z6) / |s5|)
    D      changes by at most d + |d4| b1 + |d5| b4     (shoulder to forearm end)

and the range of D bounds `s3^2`. If the product of the bounds reaches the floor the interval
is certified, if the midpoint itself is below the floor the path fails, otherwise the
interval is halved. An interval shorter than `2^-DEPTH` of the path counts as failed, so the
answer errs on the safe side only.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.kinematics.ur import branch_terms, inverse_kinematics

STRAIGHT, ARC = 0, 1
PATH_KINDS = ("straight", "arc")
"""Names of the path kinds, by number."""

DEPTH = 12
"""Number of halvings after which an interval counts as failed."""

FIRST_INTERVAL = 0.2
"""Wrist travel that an interval of the first division covers [m]; a matter of speed only."""

LIMIT_TOLERANCE = 1e-6
"""How far a joint may pass its limits [rad]: postures are rounded, and a joint often lies exactly on a half turn."""

SAMPLES = 16
"""Intervals over which joint angles are followed along a path."""


@kernel
def relative_rotation(r0, r1, axis):
    """Angle of `r0^T r1` in [0, pi] [rad]; its unit axis (in frame 0) is written into `axis`."""
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
    angle = np.arctan2(sine2, m00 + m11 + m22 - 1.0)
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
def position_on_path(t0, t1, kind, pivot, s, out):
    """Base position at `s`, written into `out`, shape (3,) [m]."""
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
def angle_about(t0, t1, pivot):
    """Angle between `t0` and `t1` seen from `pivot` [rad]."""
    ax, ay, az = t0[0] - pivot[0], t0[1] - pivot[1], t0[2] - pivot[2]
    bx, by, bz = t1[0] - pivot[0], t1[1] - pivot[1], t1[2] - pivot[2]
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return np.arctan2(np.sqrt(cx * cx + cy * cy + cz * cz), ax * bx + ay * by + az * bz)


@kernel
def turn(axis, c, s, x, y, z):
    """A vector turned about the unit `axis` by an angle of cosine `c` and sine `s` (Rodrigues)."""
    kx, ky, kz = axis[0], axis[1], axis[2]
    dot = (kx * x + ky * y + kz * z) * (1.0 - c)
    return (
        x * c + (ky * z - kz * y) * s + kx * dot,
        y * c + (kz * x - kx * z) * s + ky * dot,
        z * c + (kx * y - ky * x) * s + kz * dot,
    )


@kernel
def flange_in_limb(grip, approach, position, r0, axis, angle, mount_rotation, mount_position, p, z):
    """Flange pose in the limb base frame for a base at `position`, turned by `angle` about `axis` from `r0`.

    Args:
        grip: Flange position in the world [m], shape (3,).
        approach: Flange axis in the world, shape (3,).
        position: Base position [m], shape (3,).
        r0: Base rotation at the path's start, shape (3, 3).
        axis: Rotation axis in the base frame at the start.
        angle: Rotation so far [rad].
        mount_rotation: Shape (3, 3).
        mount_position: Shape (3,) [m].
        p: Filled with the flange position [m].
        z: Filled with the flange axis.
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
def certify(
    grip,
    approach,
    t0,
    r0,
    t1,
    r1,
    kind,
    pivot,
    mount_rotation,
    mount_position,
    lengths,
    determinant_floor,
    classes,
):
    """Shoulder and wrist choices on which a holding limb can follow a base path.

    Args:
        grip: Flange position in the world [m], shape (3,).
        approach: Flange axis in the world, shape (3,).
        t0: Base position at the start [m]; `r0` its rotation.
        r0: Shape (3, 3).
        t1: Base position at the end [m]; `r1` its rotation.
        r1: Shape (3, 3).
        kind: `STRAIGHT` or `ARC`.
        pivot: Centre of the arc [m], shape (3,).
        mount_rotation: Shape (3, 3).
        mount_position: Shape (3,) [m].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        determinant_floor: Least `|det J|` on the path [m^3].
        classes: Bit mask of the choices `2 * shoulder + wrist` to look at.

    Returns:
        Bit mask of the choices that are certified.
    """
    d1, a2, a3, d4, d5, d6 = lengths
    axis = floats(3)
    omega = relative_rotation(r0, r1, axis)
    arm0 = arm1 = arm_pivot = rho0 = rho1 = shift = 0.0
    for k in range(3):
        wrist = grip[k] - d6 * approach[k]
        arm0 += (wrist - t0[k]) ** 2
        arm1 += (wrist - t1[k]) ** 2
        arm_pivot += (wrist - pivot[k]) ** 2
        rho0 += (t0[k] - pivot[k]) ** 2
        rho1 += (t1[k] - pivot[k]) ** 2
        shift += (t1[k] - t0[k]) ** 2
    if kind == STRAIGHT:
        speed = np.sqrt(shift)
        arm = np.sqrt(max(arm0, arm1))
    else:
        if min(rho0, rho1) < 1e-6:
            return 0
        far = np.sqrt(max(rho0, rho1))
        speed = np.hypot(np.sqrt(rho1) - np.sqrt(rho0), far * angle_about(t0, t1, pivot))
        arm = np.sqrt(arm_pivot) + far
    sigma = speed + omega * arm
    floor = (determinant_floor / (a2 * a3)) ** 2
    k2 = a2 * a2 + a3 * a3
    terms = floats(4, 4)
    position, p, z = floats(3), floats(3), floats(3)
    # The first intervals are about as long as the bounds can usually settle.
    pieces = min(max(int(np.ceil(sigma / FIRST_INTERVAL)), 1), 1 << DEPTH)
    shortest = 0.5 ** (DEPTH + 1)
    stack_s = floats(DEPTH + 2)
    stack_half = floats(DEPTH + 2)
    piece = top = 0
    alive = classes
    while alive and (top > 0 or piece < pieces):
        if top > 0:
            top -= 1
            s, half = stack_s[top], stack_half[top]
        else:
            half = 0.5 / pieces
            s = (2 * piece + 1) * half
            piece += 1
        position_on_path(t0, t1, kind, pivot, s, position)
        flange_in_limb(
            grip, approach, position, r0, axis, s * omega, mount_rotation, mount_position, p, z
        )
        branch_terms(p, z, lengths, terms)
        d, a = sigma * half, omega * half
        undecided = 0
        rho = np.sqrt(terms[0, 0] + d4 * d4)
        u2_min = (rho - d) ** 2 - d4 * d4 if rho > d else -1.0
        b1 = d / np.sqrt(u2_min) if u2_min > 0.0 else np.inf
        for c in range(4):
            if not alive >> c & 1:
                continue
            if not terms[c, 3] >= floor or terms[c, 3] <= 0.0:
                alive &= ~(1 << c)
                continue
            s5_min = np.sqrt(terms[c, 1]) - (a + b1)
            if not s5_min > 0.0:
                undecided |= 1 << c
                continue
            dist = np.sqrt(k2 + 2.0 * a2 * a3 * terms[c, 2])
            change = d + abs(d4) * b1 + abs(d5) * (a + b1) / s5_min
            near = dist - change if dist > change else 0.0
            low = (near * near - k2) / (2.0 * a2 * a3)
            high = ((dist + change) ** 2 - k2) / (2.0 * a2 * a3)
            s3_2_min = 1.0 - max(low * low, high * high)
            if not (s3_2_min > 0.0 and u2_min * s5_min * s5_min * s3_2_min >= floor):
                undecided |= 1 << c
        if undecided:
            if half < shortest:
                alive &= ~undecided
                continue
            for side in (-0.5, 0.5):
                stack_s[top] = s + side * half
                stack_half[top] = 0.5 * half
                top += 1
    return alive


@kernel
def follow(
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
    samples,
    first,
    q,
    low,
    high,
):
    """Joint angles of a holding limb along a base path, continuous from `q`.

    Args:
        grip: Flange position in the world [m], shape (3,).
        tool: Flange rotation in the world, shape (3, 3).
        t0: Base position at the start [m].
        r0: Base rotation at the start, shape (3, 3).
        t1: Base position at the end [m].
        r1: Base rotation at the end, shape (3, 3).
        kind: `STRAIGHT` or `ARC`.
        pivot: Centre of the arc [m], shape (3,).
        mount_rotation: Shape (3, 3).
        mount_position: Shape (3,) [m].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        branch: Branch label.
        samples: Intervals, or 0 for the start alone.
        first: Filled with the angles at the start, shape (6,) [rad].
        q: Angles near the start, shape (6,), moved to the end; NaN at first to start in (-pi, pi]
            [rad].
        low: Least angles so far, shape (6,), lowered.
        high: Largest angles so far, shape (6,), raised.

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
    grip, tool, t0, r0, t1, r1, kind, pivot, mount_rotation, mount_position, lengths, limits, mask
):
    """Those of the branches and flips in `mask` whose joint angles stay inside the limits along a path.

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


@kernel
def expand_classes(classes):
    """16-bit mask of branches and flips that share the shoulder and wrist choices in `classes`."""
    mask = 0
    for c in range(4):
        if classes >> c & 1:
            mask |= 0x0303 << (2 * c)
    return mask
