"""Checks that a limb can be released from a point and folded while the base moves (compiled).

A step is shown to be possible by one of two motions. In the first the limb departs along the
surface normal, folds at the body, the base moves while the limb stays folded, the limb unfolds and
approaches. A robot may have several folds (`RobotSpec.folds`); those among which a limb can change
where the base stands count as one. In the second, for steps that the first cannot show, it swings
along a line in joint space while the base moves, see `line_swings`.

The branches in an answer of `release` are those among which the limb can change at rest, through a
fold or, where it cannot fold, along lines from branch to branch. A limb that can depart from or
reach one of them can depart from or reach all: branches need not be checked in pairs. A plan takes
a shorter swing where there is one, see `motion.swings`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.swept_hold import hold_free, holds_apart
from mlivr_gym.collisions.swept_swing import departure_free, swing_free
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats, integers
from mlivr_gym.kinematics.base_path import STRAIGHT
from mlivr_gym.transitions.grasp_poses import (
    elbow_up,
    flange_at,
    fold_nearest_to,
    lifted_branches,
    line_end,
)

FOLDS_AT, ROOT, VIA = 16, 20, 24
"""First bits of the parts of an answer of `release`, which has room for four folds."""


@kernel
def release(
    limb: int, mask: int, point: Array, normal: Array, rail: Array, tool_length: float,
    lift: float, position: Array, rotation: Array, others: Array, folds: Array, limits: Array,
    mount_rotations: Array, mount_positions: Array, lengths: Array,
    collision_model: tuple[Any, ...], inside: bool, before: int,
) -> int:  # fmt: skip
    """On which branches a limb can be released at a stance and change from one to the other.

    All else is at rest.

    The answer packs the branches and flips (bits 0 to 15, some of `mask`), the folds among which
    the limb can change (4 bits from `FOLDS_AT`), the one through which it does (2 bits from `ROOT`)
    and, for each branch, the one that is reached first (2 bits each from `VIA`). A limb that cannot
    fold has no bits from `FOLDS_AT` on. Branches with the elbow up are preferred: of twins that
    differ in the elbow alone the other one is checked if none with the elbow up can fold.

    Args:
        limb: Index of the limb.
        mask: Branches and flips to check.
        point: The grasp in the world [m], shape (3,).
        normal: Surface normal there, shape (3,).
        rail: Rail direction there, shape (3,).
        tool_length: Flange to grasp [m].
        lift: Departure along the normal [m].
        position: Base position in the world [m], shape (3,).
        rotation: Base rotation in the world, shape (3, 3).
        others: Capsule ends of the other limbs in the body frame, one set for each branch, shape
            (k, c, 2, 3).
        folds: Joint angles of the folds [rad], shape (f, 5).
        limits: Joint limits [rad], shape (6, 2).
        mount_rotations: Limb base axes in the body frame, shape (N, 3, 3).
        mount_positions: Limb base origins in the body frame [m], shape (N, 3).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        collision_model: `CollisionModel.arrays`.
        inside: Whether the robot's shapes are compared with each other too, not with boxes alone.
        before: An answer in another world, whose motions alone are checked, or -1.

    Returns:
        The answer, 0 if the limb can be released on no branch.
    """
    shapes, gripper, _, fixed, world, clearance, _ = collision_model
    p, x, z, away = floats(3), floats(3), floats(3), floats(3)
    q = floats(8, 6)
    mount_rotation, mount_position = mount_rotations[limb], mount_positions[limb]
    flange_at(
        point, normal, rail, tool_length, position, rotation, mount_rotation, mount_position, p, x,
        z, away
    )  # fmt: skip
    first = mask
    if before < 0:
        first = elbow_up(
            limb, mask, point, normal, tool_length, position, rotation, mount_rotations,
            mount_positions, lengths, shapes
        )  # fmt: skip
    free = 0
    for turn in range(2):
        rest = first if turn == 0 else mask & ~first
        if not rest:
            continue
        rest = lifted_branches(limb, rest, p, x, z, away, lift, lengths, limits, q)
        for b in range(8):
            if rest & (0x0101 << b):
                found = departure_free(
                    limb, p, x, z, away, lift, lengths, b, mount_rotation, mount_position, position,
                    rotation, others, shapes,
                    gripper, fixed, world, point, normal, clearance, inside,
                )  # fmt: skip
                if found != CLEAR:
                    rest &= ~(0x0101 << b)
        free |= rest
        if rest and before >> FOLDS_AT & 15:
            answer = folding(
                limb, rest, q, position, rotation, others, folds, limits, mount_rotation,
                mount_position, lengths, collision_model, inside, before,
            )  # fmt: skip
            if answer:
                return answer
    if not free:
        return free
    return joined_by_lines(
        limb, free, q, position, rotation, others, limits, mount_rotation, mount_position, lengths,
        collision_model, inside, before >= 0
    )  # fmt: skip


@kernel
def folding(
    limb: int, free: int, q: Array, position: Array, rotation: Array, others: Array, folds: Array,
    limits: Array, mount_rotation: Array, mount_position: Array, lengths: Array,
    collision_model: tuple[Any, ...], inside: bool, before: int,
) -> int:  # fmt: skip
    """The answer of `release` from those of the branches in `free` that can fold; 0 if none can.

    The joint angles on each branch are `q`, shape (8, 6) [rad]; other arguments as in `release`,
    the mount that of the limb.
    """
    shapes, _, _, fixed, world, clearance, body = collision_model
    start, target = floats(6), floats(6)
    path = (position, rotation, position, rotation, np.int64(STRAIGHT), position)
    for root in range(len(folds)):
        if before >= 0 and before >> ROOT & 3 != root:
            continue
        changeable = 1 << root
        for k in range(6):
            start[k] = folds[root, k] if k < 5 else 0.0
        if not fold_nearest_to(folds[root], start, limits, start):
            continue
        for other in range(len(folds)):
            if other == root or (before >= 0 and not before >> (FOLDS_AT + other) & 1):
                continue
            if fold_nearest_to(folds[other], start, limits, target):
                found = swing_free(
                    limb, path, 0.0, 0.0, start, target, lengths, mount_rotation, mount_position,
                    others, shapes, fixed, world, clearance, inside, body,
                )  # fmt: skip
                if found == CLEAR:
                    changeable |= 1 << other
        folded = via = 0
        for b in range(8):
            if not free & (0x0101 << b):
                continue
            for fold in range(len(folds)):
                if not changeable >> fold & 1 or (
                    before >= 0 and before >> (VIA + 2 * b) & 3 != fold
                ):
                    continue
                if fold_nearest_to(folds[fold], q[b], limits, target):
                    found = swing_free(
                        limb, path, 0.0, 0.0, q[b], target, lengths, mount_rotation, mount_position,
                        others, shapes, fixed, world, clearance, inside, body,
                    )  # fmt: skip
                    if found == CLEAR:
                        folded |= 0x0101 << b
                        via |= fold << (2 * b)
                        break
        if folded & free:
            return folded & free | changeable << FOLDS_AT | root << ROOT | via << VIA
    return 0


@kernel
def joined_by_lines(
    limb: int, free: int, q: Array, position: Array, rotation: Array, others: Array, limits: Array,
    mount_rotation: Array, mount_position: Array, lengths: Array,
    collision_model: tuple[Any, ...], inside: bool, single: bool,
) -> int:  # fmt: skip
    """The most branches of `free` among which a limb can change along lines at rest.

    If `single`, the first branch alone. Arguments as in `folding`.
    """
    shapes, _, _, fixed, world, clearance, body = collision_model
    target, group = floats(6), integers(8)
    for a in range(8):
        group[a] = a
    path = (position, rotation, position, rotation, np.int64(STRAIGHT), position)
    for a in range(8):
        if not free & (0x0101 << a):
            continue
        if single:
            return free & (0x0101 << a)
        for b in range(a + 1, 8):
            if (
                free & (0x0101 << b)
                and group[a] != group[b]
                and line_end(q[a], q[b], limits, target) < np.inf
            ):
                found = swing_free(
                    limb, path, 0.0, 0.0, q[a], target, lengths, mount_rotation, mount_position,
                    others, shapes, fixed, world, clearance, inside, body,
                )  # fmt: skip
                if found == CLEAR:
                    gone = group[b]
                    for c in range(8):
                        if group[c] == gone:
                            group[c] = group[a]
    best, most = 0, 0
    for a in range(8):
        here, count = 0, 0
        for b in range(8):
            if group[b] == group[a] and free & (0x0101 << b):
                here |= 0x0101 << b
                count += 1
        if count > most and free & (0x0101 << a):
            best, most = here & free, count
    return best


@kernel
def folded_swing(
    limb: int, folds_at_both: int, path: tuple[Any, ...], folds: Array, mount_rotations: Array,
    mount_positions: Array, lengths: Array, collision_model: tuple[Any, ...], inside: bool,
    q: Array,
) -> int:  # fmt: skip
    """The first fold of a set in which a limb can stay along a base path, -1 if there is none.

    Args:
        limb: Index of the limb.
        folds_at_both: The set, as bits: the folds that the limb can take at both ends.
        path: Base path (t0, r0, t1, r1, kind, pivot).
        folds: Joint angles of the folds [rad], shape (f, 5).
        mount_rotations: Limb base axes in the body frame, shape (N, 3, 3).
        mount_positions: Limb base origins in the body frame [m], shape (N, 3).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        collision_model: `CollisionModel.arrays`.
        inside: Whether the robot's shapes are compared with each other too, not with boxes alone.
        q: Filled with the joint angles of the fold [rad], shape (6,).
    """
    shapes, _, _, fixed, world, clearance, body = collision_model
    none = floats(0, len(shapes[0]), 2, 3)
    q[5] = 0.0
    for fold in range(len(folds)):
        if folds_at_both >> fold & 1:
            for joint in range(5):
                q[joint] = folds[fold, joint]
            found = swing_free(
                limb, path, 0.0, 1.0, q, q, lengths, mount_rotations[limb], mount_positions[limb],
                none, shapes, fixed, world, clearance, inside, body,
            )  # fmt: skip
            if found == CLEAR:
                return fold
    return -1


@kernel
def holding(
    limb: int, mask: int, grip: Array, tool: Array, path: tuple[Any, ...], mover: int,
    start: Array, end: Array, mount_rotations: Array, mount_positions: Array, lengths: Array,
    collision_model: tuple[Any, ...], inside: bool, parts: int,
) -> int:  # fmt: skip
    """Those of the branches in `mask` on which a limb can hold along a base path.

    Meanwhile limb `mover` goes along a line from `start` to `end`, shape (6,) [rad]. Other
    arguments as in `folded_swing` and `swept_hold.hold_free`.
    """
    shapes, _, hand, fixed, world, clearance, _ = collision_model
    for b in range(8):
        if mask & (0x0101 << b):
            found = hold_free(
                limb, grip, tool, path, 0.0, 1.0, b, lengths, mount_rotations[limb],
                mount_positions[limb], start, end, mount_rotations[mover], mount_positions[mover],
                shapes, hand, fixed, world, clearance, inside, parts,
            )  # fmt: skip
            if found != CLEAR:
                mask &= ~(0x0101 << b)
    return mask


@kernel
def both_apart(
    i: int, j: int, first: int, second: int, grip_i: Array, tool_i: Array, grip_j: Array,
    tool_j: Array, path: tuple[Any, ...], mount_rotations: Array, mount_positions: Array,
    lengths: Array, collision_model: tuple[Any, ...],
) -> tuple[int, int]:  # fmt: skip
    """Branches of two limbs that hold, all of which keep clear of each other along a base path.

    A branch of the second that comes too close to any of the first is dropped, unless none would
    be kept; then those of the first that come too close to the second's first branch are.

    Args:
        i: Index of the first limb.
        j: Index of the second limb.
        first: Branches of the first limb.
        second: Branches of the second limb.
        grip_i: Flange position of the first limb in the world [m], shape (3,).
        tool_i: Flange rotation of the first limb in the world, shape (3, 3).
        grip_j: Flange position of the second limb in the world [m], shape (3,).
        tool_j: Flange rotation of the second limb in the world, shape (3, 3).
        path: Base path (t0, r0, t1, r1, kind, pivot).
        mount_rotations: Limb base axes in the body frame, shape (N, 3, 3).
        mount_positions: Limb base origins in the body frame [m], shape (N, 3).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        collision_model: `CollisionModel.arrays`.

    Returns:
        The branches that are kept, of the first limb and of the second.
    """
    shapes, clearance = collision_model[0], collision_model[5]
    for turn in range(2):
        kept = second
        for c in range(8):
            for b in range(8):
                if kept & (0x0101 << c) and first & (0x0101 << b):
                    found = holds_apart(
                        grip_i, tool_i, b, mount_rotations[i], mount_positions[i], grip_j, tool_j,
                        c, mount_rotations[j], mount_positions[j], path, lengths, shapes, clearance,
                    )  # fmt: skip
                    if found != CLEAR:
                        kept &= ~(0x0101 << c)
        if kept or turn == 1:
            return first, kept
        chosen = 0
        while not second & (0x0101 << chosen):
            chosen += 1
        second &= 0x0101 << chosen
        for b in range(8):
            if first & (0x0101 << b):
                found = holds_apart(
                    grip_i, tool_i, b, mount_rotations[i], mount_positions[i], grip_j, tool_j,
                    chosen, mount_rotations[j],
                    mount_positions[j], path, lengths, shapes, clearance,
                )  # fmt: skip
                if found != CLEAR:
                    first &= ~(0x0101 << b)
    return first, second
