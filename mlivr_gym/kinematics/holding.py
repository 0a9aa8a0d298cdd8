"""Which branches a limb that holds can keep while the base follows a path, and poses on that path.

A step is an edge of the stance graph only if the limbs that hold can follow the base from the first
to the second posture, on a straight line or on an arc about the held grasps, see `base_path`.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.kinematics.base_path import position_on_path, relative_rotation, turn, within_limits
from mlivr_gym.kinematics.certificate import certify, expand_classes

IDENTITY = np.eye(3)


@kernel
def hold_mask(
    kind: int, pivot: Array, grip: Array, tool: Array, t0: Array, r0: Array, t1: Array, r1: Array,
    mount_rotation: Array, mount_position: Array, lengths: Array, determinant_floor: float,
    limits: Array, full_turn: bool, mask: int,
) -> int:  # fmt: skip
    """Those of the branches in `mask` on which one limb can hold along a base path.

    Args:
        kind: `STRAIGHT` or `ARC`.
        pivot: Centre of the arc in the world [m], shape (3,).
        grip: Flange position in the world [m], shape (3,).
        tool: Flange rotation in the world, flip 0, shape (3, 3).
        t0: Base position in the world at the start [m], shape (3,).
        r0: Base rotation in the world at the start, shape (3, 3).
        t1: Base position in the world at the end [m], shape (3,).
        r1: Base rotation in the world at the end, shape (3, 3).
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        determinant_floor: Least `|det J|` [m^3].
        limits: Joint limits [rad], shape (6, 2).
        full_turn: Whether the limits rule out nothing.
        mask: 16-bit mask of branches and flips.
    """
    classes = 0
    for c in range(4):
        if mask >> (2 * c) & 0x0303:
            classes |= 1 << c
    if classes:
        approach = floats(3)
        for k in range(3):
            approach[k] = tool[k, 2]
        classes = certify(
            grip, approach, t0, r0, t1, r1, kind, pivot, mount_rotation, mount_position,
            lengths, determinant_floor, classes,
        )  # fmt: skip
    mask &= expand_classes(classes)
    if mask and not full_turn:
        mask = within_limits(
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
            limits,
            mask,
        )
    return mask


def quaternion(rotation: Array) -> Array:
    """Quaternion w, x, y, z with w >= 0, shape (4,), of a rotation matrix, shape (3, 3)."""
    axis = np.empty(3)
    half = 0.5 * relative_rotation(IDENTITY, np.ascontiguousarray(rotation), axis)
    return np.concatenate([[np.cos(half)], np.sin(half) * axis])


def base_path(path: tuple[Array, Array, Array, Array, int, Array], s: Array) -> tuple[Array, Array]:
    """Base poses in the world along a path.

    Args:
        path: Base position (3,) [m] and rotation (3, 3) at the start and the same at the end, in
            the world, then `STRAIGHT` or `ARC`, and the centre of the arc in the world (3,) [m].
        s: Path parameters from 0 to 1, shape (k,).

    Returns:
        Positions, shape (k, 3) [m], and rotations, shape (k, 3, 3).
    """
    t0, r0, t1, r1, kind, pivot = path
    axis = np.empty(3)
    angle = relative_rotation(r0, r1, axis)
    positions, rotations = np.empty((len(s), 3)), np.empty((len(s), 3, 3))
    for i, value in enumerate(s):
        position_on_path(t0, t1, kind, pivot, float(value), positions[i])
        c, sine = float(np.cos(value * angle)), float(np.sin(value * angle))
        turned = np.column_stack([turn(axis, c, sine, *unit) for unit in np.eye(3)])
        rotations[i] = r0 @ turned
    return positions, rotations
