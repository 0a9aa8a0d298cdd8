"""Arithmetic of a limb at a grasp: windings, flange pose, branches above the point (compiled)."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.link_frames import frames_of_branch, place
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats, zeros
from mlivr_gym.kinematics.base_path import flange_in_limb
from mlivr_gym.kinematics.ur import branch_angles, wrap


@kernel
def nearest_turn(angle: float, q: float, low: float, high: float) -> float:
    """The winding of a joint angle inside its limits that is nearest to `q` [rad], NaN if none."""
    out = q + wrap(angle - q)
    if out < low:
        out += 2.0 * np.pi * np.ceil((low - out) / (2.0 * np.pi))
    if out > high:
        out -= 2.0 * np.pi * np.ceil((out - high) / (2.0 * np.pi))
    return out if low <= out <= high else np.nan


@kernel
def fold_nearest_to(fold: Array, q: Array, limits: Array, out: Array) -> bool:
    """A fold on the windings nearest to `q`, into `out`; whether it lies inside the limits.

    Shapes: fold (5,), `q` and `out` (6,), limits (6, 2), all [rad]. Joint 6 is as in `q`.
    """
    inside = True
    for joint in range(5):
        out[joint] = nearest_turn(fold[joint], q[joint], limits[joint, 0], limits[joint, 1])
        inside = inside and out[joint] == out[joint]
    out[5] = q[5]
    return inside


@kernel
def line_end(q0: Array, q1: Array, limits: Array, out: Array) -> float:
    """Where a line in joint space from `q0` to `q1` ends, on the windings nearest to `q0`.

    Joint 6 goes to the nearest half turn: a grasp is the same with the tool turned by it.

    Args:
        q0: Joint angles at the start [rad], shape (6,).
        q1: Joint angles at the end up to whole turns [rad], shape (6,).
        limits: Joint limits [rad], shape (6, 2).
        out: Filled with the angles at the end [rad], shape (6,).

    Returns:
        The length of the line, the largest of the turns of joints 1 to 5 [rad]; inf if it ends
        outside the limits.
    """
    length = 0.0
    for joint in range(5):
        out[joint] = nearest_turn(q1[joint], q0[joint], limits[joint, 0], limits[joint, 1])
        length = max(length, abs(out[joint] - q0[joint]))
        if out[joint] != out[joint]:
            return np.inf
    out[5] = q0[5] + 0.5 * wrap(2.0 * (q1[5] - q0[5]))
    return length if limits[5, 0] <= out[5] <= limits[5, 1] else np.inf


@kernel
def flange_at(
    point: Array, normal: Array, rail: Array, tool_length: float, position: Array, rotation: Array,
    mount_rotation: Array, mount_position: Array, p: Array, x: Array, z: Array, away: Array,
) -> None:  # fmt: skip
    """Flange pose that grasps a point, in the limb base frame.

    Args:
        point: The grasp in the world [m], shape (3,).
        normal: Surface normal there, shape (3,).
        rail: Rail direction there, shape (3,).
        tool_length: Flange to grasp [m].
        position: Base position in the world [m], shape (3,).
        rotation: Base rotation in the world, shape (3, 3).
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        p: Filled with the flange position [m], shape (3,).
        x: Filled with the first axis of the flange, shape (3,).
        z: Filled with the flange axis, shape (3,).
        away: Filled with the surface normal, shape (3,).
    """
    grip, axis = floats(3), floats(3)
    for k in range(3):
        grip[k] = point[k] + tool_length * normal[k]
        axis[k] = rail[k]
    flange_in_limb(grip, axis, position, rotation, axis, 0.0, mount_rotation, mount_position, p, x)
    for k in range(3):
        axis[k] = normal[k]
    flange_in_limb(
        grip, axis, position, rotation, axis, 0.0, mount_rotation, mount_position, p, away
    )
    for k in range(3):
        z[k] = -away[k]


@kernel
def elbow_up(
    limb: int, mask: int, point: Array, normal: Array, tool_length: float, position: Array,
    rotation: Array, mount_rotations: Array, mount_positions: Array, lengths: Array,
    shapes: tuple[Any, ...],
) -> int:  # fmt: skip
    """The branches of a mask with the elbow up.

    A branch is dropped if the mask has its twin, with the elbow on the other side, and that keeps
    the limb farther from the surface. Twins have equal `w_m` and the same hand; to keep one of each
    halves the work and costs few steps. Arguments as in `place_branches`.
    """
    p, x, z, away = floats(3), floats(3), floats(3), floats(3)
    frames, ends = floats(7, 4, 3), floats(len(shapes[0]), 2, 3)
    height = zeros(8)
    flange_at(
        point, normal, normal, tool_length, position, rotation, mount_rotations[limb],
        mount_positions[limb], p, x, z, away
    )  # fmt: skip
    for b in range(8):
        twins = 0x0101 << b, 0x0101 << (b ^ 1)
        if mask & twins[0] and mask & twins[1] and frames_of_branch(p, z, lengths, b, frames):
            place(frames, shapes, mount_rotations[limb], mount_positions[limb], ends)
            for c in range(len(shapes[0])):
                height[b] += ends[c, 0, 2] + ends[c, 1, 2]
    for b in range(0, 8, 2):
        if mask & (0x0101 << b) and mask & (0x0202 << b):
            mask &= ~(0x0101 << b) if height[b + 1] > height[b] else ~(0x0202 << b)
    return mask


@kernel
def place_branches(
    limb: int, mask: int, point: Array, normal: Array, tool_length: float, position: Array,
    rotation: Array, mount_rotations: Array, mount_positions: Array, lengths: Array,
    shapes: tuple[Any, ...], first: int, ends: Array,
) -> int:  # fmt: skip
    """Put a limb in place at a grasp, on each branch of a mask.

    Args:
        limb: Index of the limb.
        mask: Branches and flips.
        point: The grasp in the world [m], shape (3,).
        normal: Surface normal there, shape (3,).
        tool_length: Flange to grasp [m].
        position: Base position in the world [m], shape (3,).
        rotation: Base rotation in the world, shape (3, 3).
        mount_rotations: Limb base axes in the body frame, shape (N, 3, 3).
        mount_positions: Limb base origins in the body frame [m], shape (N, 3).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        shapes: `LimbShapes.arrays`.
        first: First free row of `ends`.
        ends: Capsule ends in the body frame [m], shape (k, c, 2, 3), one row for each branch.

    Returns:
        The next free row.
    """
    p, x, z, away = floats(3), floats(3), floats(3), floats(3)
    frames = floats(7, 4, 3)
    flange_at(
        point, normal, normal, tool_length, position, rotation, mount_rotations[limb],
        mount_positions[limb], p, x, z, away
    )  # fmt: skip
    for b in range(8):
        if mask & (0x0101 << b) and frames_of_branch(p, z, lengths, b, frames):
            place(frames, shapes, mount_rotations[limb], mount_positions[limb], ends[first])
            first += 1
    return first


@kernel
def lifted_branches(
    limb: int, mask: int, p: Array, x: Array, z: Array, away: Array, lift: float, lengths: Array,
    limits: Array, q: Array,
) -> int:  # fmt: skip
    """Joint angles of a limb that has departed from a grasp, on each branch of a mask.

    Args:
        limb: Index of the limb.
        mask: Branches and flips.
        p: Flange position at the grasp in the limb base frame [m], shape (3,).
        x: First axis of the flange there.
        z: Flange axis there.
        away: Surface normal there.
        lift: How far it has departed [m].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        limits: Joint limits [rad], shape (6, 2).
        q: Shape (8, 6), row `branch` filled with angles on the windings nearest to zero [rad].

    Returns:
        The branches and flips of the mask that exist there.
    """
    up, found = floats(3), 0
    for k in range(3):
        up[k] = p[k] + lift * away[k]
    for b in range(8):
        if mask & (0x0101 << b) and branch_angles(up, x, z, lengths, b, q[b]):
            for joint in range(6):
                q[b, joint] = nearest_turn(q[b, joint], 0.0, limits[joint, 0], limits[joint, 1])
            found |= 0x0101 << b
    return found & mask
