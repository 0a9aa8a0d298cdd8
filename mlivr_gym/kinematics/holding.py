"""Steps between stances: which branches a holding limb can keep, and the path of the base.

A step is an edge only if the limbs that hold can follow the base from the departing to the arriving
posture, on a straight line or on an arc about the held grasps, see `base_path`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.kinematics.base_path import (
    certify,
    expand_classes,
    position_on_path,
    relative_rotation,
    turn,
    within_limits,
)

Array = NDArray[np.float64]
IDENTITY = np.eye(3)


@kernel
def hold_mask(
    kind, pivot, grip, tool, t0, r0, t1, r1, mount_rotation, mount_position, lengths,
    determinant_floor, limits, full_turn,
    mask,
):  # fmt: skip
    """Those of the branches in `mask` on which one limb can hold along a base path.

    Args:
        kind: `STRAIGHT` or `ARC`.
        pivot: Centre of the arc [m], shape (3,).
        grip: Flange position in the world [m], shape (3,).
        tool: Flange rotation in the world, flip 0, shape (3, 3).
        t0: Base position at the start [m].
        r0: Base rotation at the start, shape (3, 3).
        t1: Base position at the end [m].
        r1: Base rotation at the end, shape (3, 3).
        mount_rotation: Shape (3, 3).
        mount_position: Shape (3,) [m].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        determinant_floor: Least `|det J|` [m^3].
        limits: Joint limits [rad], shape (6, 2).
        full_turn: Whether the limits rule out nothing.
        mask: 16-bit mask of branches and flips.
    """
    classes = np.int64(0)
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
    """Quaternion w, x, y, z with w >= 0 of a rotation matrix, shape (4,)."""
    axis = np.empty(3)
    half = 0.5 * relative_rotation(IDENTITY, np.ascontiguousarray(rotation), axis)
    return np.concatenate([[np.cos(half)], np.sin(half) * axis])


def base_path(
    t0: Array, r0: Array, t1: Array, r1: Array, kind: int, pivot: Array, s: Array
) -> tuple[Array, Array]:
    """Base poses along a transition.

    Args:
        t0: Base position at the start [m], shape (3,).
        r0: Rotation at the start, shape (3, 3).
        t1: Position at the end [m].
        r1: Rotation at the end.
        kind: `STRAIGHT` or `ARC`.
        pivot: Centre of the arc [m], shape (3,).
        s: Path parameters in [0, 1], shape (k,).

    Returns:
        Positions, shape (k, 3) [m], and rotations, shape (k, 3, 3).
    """
    axis = np.empty(3)
    angle = relative_rotation(r0, r1, axis)
    positions, rotations = np.empty((len(s), 3)), np.empty((len(s), 3, 3))
    for i, value in enumerate(s):
        position_on_path(t0, t1, kind, pivot, float(value), positions[i])
        c, sine = float(np.cos(value * angle)), float(np.sin(value * angle))
        local = np.column_stack([turn(axis, c, sine, *unit) for unit in np.eye(3)])
        rotations[i] = r0 @ local
    return positions, rotations
