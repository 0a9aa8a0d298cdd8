"""Compiled kernels that evaluate base paths and the limbs that hold, at many places at once."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.kinematics.base_path import position_on_path, relative_rotation, turn
from mlivr_gym.kinematics.ur import inverse_kinematics


@kernel
def poses_along(
    t0: Array, r0: Array, t1: Array, r1: Array, kind: int, pivot: Array, s: Array, positions: Array,
    rotations: Array,
) -> None:  # fmt: skip
    """Base poses in the world along a path.

    Args:
        t0: Base position in the world at the start [m], shape (3,).
        r0: Base rotation in the world at the start, shape (3, 3).
        t1: Base position in the world at the end [m], shape (3,).
        r1: Base rotation in the world at the end, shape (3, 3).
        kind: `STRAIGHT` or `ARC`.
        pivot: Centre of the arc in the world [m], shape (3,).
        s: Path parameters from 0 to 1, shape (k,).
        positions: Filled, shape (k, 3) [m].
        rotations: Filled, shape (k, 3, 3).
    """
    axis, unit = floats(3), floats(3)
    angle = relative_rotation(r0, r1, axis)
    for i in range(len(s)):
        position_on_path(t0, t1, kind, pivot, s[i], positions[i])
        cosine, sine = np.cos(s[i] * angle), np.sin(s[i] * angle)
        for column in range(3):
            unit[:] = 0.0
            unit[column] = 1.0
            x, y, z = turn(axis, cosine, sine, unit[0], unit[1], unit[2])
            for row in range(3):
                rotations[i, row, column] = r0[row, 0] * x + r0[row, 1] * y + r0[row, 2] * z


@kernel
def joints_along(
    flange_positions: Array, flange_rotations: Array, positions: Array, rotations: Array,
    mount_rotation: Array, mount_position: Array, lengths: Array, branch: int,
    reference: Array, out: Array,
) -> int:  # fmt: skip
    """Joint angles of a limb on one branch at many poses, continuous from given ones.

    Args:
        flange_positions: Flange positions in the world [m], shape (k, 3), or (1, 3) for one that
            stays.
        flange_rotations: Flange rotations in the world up to a half turn about their z axes, shape
            (k, 3, 3) or (1, 3, 3).
        positions: Base positions in the world [m], shape (k, 3), or (1, 3).
        rotations: Base rotations in the world, shape (k, 3, 3), or (1, 3, 3).
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        branch: Branch label.
        reference: Angles close to those at the first pose, shape (6,) [rad]; they tell the
            windings and the half turn of the tool.
        out: Filled, shape (k, 6) [rad].

    Returns:
        Number of poses from the first on at which the branch exists.
    """
    solutions, p, r = floats(8, 6), floats(3), floats(3, 3)
    limb_rotation, offset, q = floats(3, 3), floats(3), floats(6)
    half_turn = 0.0
    for joint in range(6):
        q[joint] = reference[joint]
    for i in range(len(out)):
        flange, tool = (
            flange_positions[min(i, len(flange_positions) - 1)],
            flange_rotations[min(i, len(flange_rotations) - 1)],
        )
        position, rotation = (
            positions[min(i, len(positions) - 1)],
            rotations[min(i, len(rotations) - 1)],
        )
        for row in range(3):
            offset[row] = flange[row] - position[row]
            for column in range(3):
                limb_rotation[row, column] = 0.0
                for k in range(3):
                    limb_rotation[row, column] += rotation[row, k] * mount_rotation[k, column]
                    offset[row] -= rotation[row, k] * mount_position[k] if column == 0 else 0.0
        for row in range(3):
            p[row] = 0.0
            for k in range(3):
                p[row] += limb_rotation[k, row] * offset[k]
            for column in range(3):
                r[row, column] = 0.0
                for k in range(3):
                    r[row, column] += limb_rotation[k, row] * tool[k, column]
        if not inverse_kinematics(p, r, lengths, solutions) >> branch & 1:
            return i
        if i == 0 and np.cos(reference[5] - solutions[branch, 5]) < 0.0:
            half_turn = np.pi
        for joint in range(6):
            angle = solutions[branch, joint] + (half_turn if joint == 5 else 0.0)
            q[joint] = angle + 2.0 * np.pi * np.round((q[joint] - angle) / (2.0 * np.pi))
            out[i, joint] = q[joint]
    return len(out)
