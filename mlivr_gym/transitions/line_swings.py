"""Checks of swings along a line in joint space, for steps no folded limb can make (compiled).

Where a limb cannot stay folded while the base moves, the line in joint space from above one point
to above the other is checked instead, for pairs of branches in order of travel. Both branches come
from the masks of their stances, among whose branches the limb can change at rest
(`release.release`): one pair that is free serves them all, and the search need not know which it
was.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.swept_swing import swing_free
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.transitions.grasp_poses import flange_at, lifted_branches, line_end

TRIES = 8
"""Pairs of branches that are checked for one base path."""


@kernel
def lifted_at(
    limb: int, mask: int, point: Array, normal: Array, rail: Array, tool_length: float,
    lift: float, position: Array, rotation: Array, mount_rotations: Array,
    mount_positions: Array, lengths: Array, limits: Array, q: Array,
) -> int:  # fmt: skip
    """Joint angles of a limb that has departed from a point at a stance.

    Arguments as in `grasp_poses.flange_at` and `grasp_poses.lifted_branches`, mounts of all limbs;
    returns what the latter does.
    """
    p, x, z, away = floats(3), floats(3), floats(3), floats(3)
    flange_at(
        point, normal, rail, tool_length, position, rotation, mount_rotations[limb],
        mount_positions[limb], p, x, z, away
    )  # fmt: skip
    return lifted_branches(limb, mask, p, x, z, away, lift, lengths, limits, q)


@kernel
def pairs_by_travel(
    mask0: int, q0: Array, mask1: int, q1: Array, limits: Array, order: IntArray
) -> int:
    """Pairs of branches of two masks, those with the shortest line first.

    Args:
        mask0: Branches at the start.
        q0: Joint angles on each branch at the start [rad], shape (8, 6).
        mask1: Branches at the end.
        q1: Joint angles on each branch at the end [rad], shape (8, 6).
        limits: Joint limits [rad], shape (6, 2).
        order: Filled with the pairs, `8 * b0 + b1`, shape (64,).

    Returns:
        The number of pairs.
    """
    travel, end, count = floats(64), floats(6), 0
    for b0 in range(8):
        for b1 in range(8):
            if mask0 & (0x0101 << b0) and mask1 & (0x0101 << b1):
                length = line_end(q0[b0], q1[b1], limits, end)
                if length < np.inf:
                    place = count
                    while place > 0 and travel[place - 1] > length:
                        travel[place], order[place] = travel[place - 1], order[place - 1]
                        place -= 1
                    travel[place], order[place] = length, 8 * b0 + b1
                    count += 1
    return count


@kernel
def line_free(
    limb: int, start: Array, goal: Array, path: tuple[Any, ...], limits: Array,
    mount_rotations: Array, mount_positions: Array, lengths: Array,
    collision_model: tuple[Any, ...], inside: bool, end: Array,
) -> bool:  # fmt: skip
    """Whether a limb can swing along a line in joint space while the base follows a path.

    Args:
        limb: Index of the limb.
        start: Joint angles at the start [rad], shape (6,).
        goal: Joint angles at the end up to whole turns [rad], shape (6,).
        path: Base path (t0, r0, t1, r1, kind, pivot).
        limits: Joint limits [rad], shape (6, 2).
        mount_rotations: Limb base axes in the body frame, shape (N, 3, 3).
        mount_positions: Limb base origins in the body frame [m], shape (N, 3).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        collision_model: `CollisionModel.arrays`.
        inside: Whether the robot's shapes are compared with each other too, not with boxes alone.
        end: Filled with the joint angles at the end [rad], shape (6,).
    """
    if line_end(start, goal, limits, end) == np.inf:
        return False
    shapes, _, _, fixed, world, clearance, body = collision_model
    none = floats(0, len(shapes[0]), 2, 3)
    found = swing_free(
        limb, path, 0.0, 1.0, start, end, lengths, mount_rotations[limb], mount_positions[limb],
        none, shapes, fixed, world, clearance, inside, body,
    )  # fmt: skip
    return found == CLEAR
