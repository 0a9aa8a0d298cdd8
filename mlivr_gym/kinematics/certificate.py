"""The proof that a limb that holds can follow a base path (compiled).

A holding limb stays on its branch as long as `u`, `s5` and `s3` keep
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

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.kinematics.base_path import (
    STRAIGHT,
    angle_about,
    flange_in_limb,
    position_on_path,
    relative_rotation,
)
from mlivr_gym.kinematics.ur import branch_terms

DEPTH = 12
"""Number of halvings after which an interval counts as failed."""

FIRST_INTERVAL = 0.2
"""Wrist travel that an interval of the first division covers [m]; a matter of speed only."""


@kernel
def certify(
    grip: Array, approach: Array, t0: Array, r0: Array, t1: Array, r1: Array, kind: int,
    pivot: Array, mount_rotation: Array, mount_position: Array, lengths: Array,
    determinant_floor: float, classes: int,
) -> int:  # fmt: skip
    """Shoulder and wrist choices on which a holding limb can follow a base path.

    Args:
        grip: Flange position in the world [m], shape (3,).
        approach: Flange axis in the world, shape (3,).
        t0: Base position in the world at the start [m], shape (3,).
        r0: Base rotation in the world at the start, shape (3, 3).
        t1: Base position in the world at the end [m], shape (3,).
        r1: Base rotation in the world at the end, shape (3, 3).
        kind: `STRAIGHT` or `ARC`.
        pivot: Centre of the arc in the world [m], shape (3,).
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        determinant_floor: Least `|det J|` on the path [m^3].
        classes: Bit mask of the choices `2 * shoulder + wrist` to look at.

    Returns:
        Bit mask of the choices that are certified.
    """
    _, a2, a3, d4, d5, d6 = lengths
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
    # The first intervals are about as long as the bounds can usually decide.
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
            closest = dist - change if dist > change else 0.0
            low = (closest * closest - k2) / (2.0 * a2 * a3)
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
def expand_classes(classes: int) -> int:
    """16-bit mask of branches and flips that share the shoulder and wrist choices in `classes`."""
    mask = 0
    for c in range(4):
        if classes >> c & 1:
            mask |= 0x0303 << (2 * c)
    return mask
