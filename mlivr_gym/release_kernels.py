"""Compiled checks that a limb can let go of a point and be folded, and that the robot can then be moved.

Every step is shown to be possible in the same way: the limb departs along the surface normal, folds at the body, the base
moves while the limb stays folded, the limb unfolds and approaches. A limb may be folded in several ways (`RobotSpec.folds`);
those among which it can change where the base stands count as one. Since folding belongs to a stance and not to a
step, a limb that can fold on a branch may land on any other from which it can: branches need not be looked at in pairs.
A plan takes a shorter way where there is one, see `planners.swing`.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.base_path import STRAIGHT, flange_in_limb
from mlivr_gym.collision_kernels import CLEAR, frames_of_branch, place
from mlivr_gym.compiled import kernel
from mlivr_gym.swept_kernels import departure_free, hold_free, holds_apart, swing_free
from mlivr_gym.ur_kinematics import branch_angles, wrap

TOGETHER, ROOT, VIA = 16, 20, 24
"""First bits of the parts of an answer of `release`, which has room for four folds."""


@kernel
def nearest_turn(angle, q, low, high):
    """The winding of a joint angle inside its limits that is nearest to `q`; NaN if there is none [rad]."""
    out = q + wrap(angle - q)
    if out < low:
        out += 2.0 * np.pi * np.ceil((low - out) / (2.0 * np.pi))
    if out > high:
        out -= 2.0 * np.pi * np.ceil((out - high) / (2.0 * np.pi))
    return out if low <= out <= high else np.nan


@kernel
def fold_near(fold, q, limits, out):
    """A fold on the windings nearest to `q`, joint 6 as in `q`; whether it lies inside the limits."""
    inside = True
    for joint in range(5):
        out[joint] = nearest_turn(fold[joint], q[joint], limits[joint, 0], limits[joint, 1])
        inside = inside and out[joint] == out[joint]
    out[5] = q[5]
    return inside


@kernel
def flange_at(point, normal, rail, tool_length, position, rotation, mount_rotation, mount_position, p, x, z, away):
    """Flange pose that grasps a point, in the limb base frame: position [m], axes x and z, and the surface normal."""
    grip, axis = np.empty(3), np.empty(3)
    for k in range(3):
        grip[k] = point[k] + tool_length * normal[k]
        axis[k] = rail[k]
    flange_in_limb(grip, axis, position, rotation, axis, 0.0, mount_rotation, mount_position, p, x)
    for k in range(3):
        axis[k] = normal[k]
    flange_in_limb(grip, axis, position, rotation, axis, 0.0, mount_rotation, mount_position, p, away)
    for k in range(3):
        z[k] = -away[k]


@kernel
def raised(
    limb, mask, point, normal, tool_length, position, rotation, mount_rotations, mount_positions, lengths, shapes
):  # fmt: skip
    """The branches of a mask without those whose twin, with the elbow on the other side, is raised farther from the surface.

    Twins have equal `w_m` and the same hand; to keep one of each halves the work and costs few steps.
    """
    p, x, z, away = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    frames, ends = np.empty((7, 4, 3)), np.empty((len(shapes[0]), 2, 3))
    height = np.zeros(8)
    flange_at(
        point,
        normal,
        normal,
        tool_length,
        position,
        rotation,
        mount_rotations[limb],
        mount_positions[limb],
        p,
        x,
        z,
        away,
    )
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
    limb,
    mask,
    point,
    normal,
    tool_length,
    position,
    rotation,
    mount_rotations,
    mount_positions,
    lengths,
    shapes,
    first,
    ends,
):
    """Put a limb in place at a grasp on each branch of a mask, from row `first` of `ends`; returns the next free row."""
    p, x, z, away = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    frames = np.empty((7, 4, 3))
    flange_at(
        point,
        normal,
        normal,
        tool_length,
        position,
        rotation,
        mount_rotations[limb],
        mount_positions[limb],
        p,
        x,
        z,
        away,
    )
    for b in range(8):
        if mask & (0x0101 << b) and frames_of_branch(p, z, lengths, b, frames):
            place(frames, shapes, mount_rotations[limb], mount_positions[limb], ends[first])
            first += 1
    return first


@kernel
def release(
    limb, mask, point, normal, rail, tool_length, lift, position, rotation, others, folds, limits, mount_rotations,
    mount_positions, lengths, bodies, inside, before,
):  # fmt: skip
    """`release_on` with raised elbows, and only if no branch of these serves, with the others; arguments as there."""
    if before >= 0:
        first = mask
    else:
        first = raised(
            limb,
            mask,
            point,
            normal,
            tool_length,
            position,
            rotation,
            mount_rotations,
            mount_positions,
            lengths,
            bodies[0],
        )
    answer = np.int64(0)
    for rest in (first, mask & ~first):
        if rest and not answer:
            answer = release_on(
                limb, rest, point, normal, rail, tool_length, lift, position, rotation, others, folds, limits, mount_rotations,
                mount_positions, lengths, bodies, inside, before,
            )  # fmt: skip
    return answer


@kernel
def release_on(
    limb, mask, point, normal, rail, tool_length, lift, position, rotation, others, folds, limits, mount_rotations,
    mount_positions, lengths, bodies, inside, before,
):  # fmt: skip
    """On which branches a limb can depart and fold at a stance, all else at rest.

    The answer packs the branches and flips (bits 0 to 15, some of `mask`), the folds among which the limb can change (4
    bits from `TOGETHER`), the one through which it does (2 bits from `ROOT`) and, for each branch, the one that is
    reached first (2 bits each from `VIA`).

    Args:
        limb: Index of the limb.
        mask: Branches and flips to look at.
        point: The grasp [m].
        normal: Surface normal there.
        rail: Rail direction there.
        tool_length: Flange to grasp [m].
        lift: Departure along the normal [m].
        position: Base position [m].
        rotation: Base rotation.
        others: Capsule ends of the other limbs in the body frame, one set for each branch, shape (k, c, 2, 3).
        folds: Joint angles of the folds [rad], shape (f, 5).
        limits: Joint limits [rad], shape (6, 2).
        mount_rotations: Shape (N, 3, 3).
        mount_positions: Shape (N, 3) [m].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        bodies: `Bodies.arrays`.
        inside: Whether the robot's own shapes are looked at, not the boxes alone.
        before: An answer in another world, whose ways alone are looked at, or -1.

    Returns:
        The answer, 0 if no branch is left.
    """
    shapes, gripper, _, fixed, world, clearance, _ = bodies
    p, x, z, away, up = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    q, start, target = np.empty((8, 6)), np.empty(6), np.empty(6)
    mount_rotation, mount_position = mount_rotations[limb], mount_positions[limb]
    path = (position, rotation, position, rotation, np.int64(STRAIGHT), position)
    flange_at(
        point, normal, rail, tool_length, position, rotation, mount_rotation, mount_position, p, x, z, away
    )  # fmt: skip
    for k in range(3):
        up[k] = p[k] + lift * away[k]
    free = np.int64(0)
    for b in range(8):
        if not mask & (0x0101 << b):
            continue
        if not branch_angles(up, x, z, lengths, b, q[b]):
            continue
        for joint in range(6):
            q[b, joint] = nearest_turn(q[b, joint], 0.0, limits[joint, 0], limits[joint, 1])
        found = departure_free(
            limb, p, x, z, away, lift, lengths, b, mount_rotation, mount_position, position, rotation, others, shapes, gripper,
            fixed, world, point, normal, clearance, inside,
        )  # fmt: skip
        if found == CLEAR:
            free |= 0x0101 << b
    free &= mask
    for root in range(len(folds)):
        if not free:
            break
        if before >= 0 and before >> ROOT & 3 != root:
            continue
        together = np.int64(1) << root
        for k in range(6):
            start[k] = folds[root, k] if k < 5 else 0.0
        if not fold_near(folds[root], start, limits, start):
            continue
        for other in range(len(folds)):
            if other == root or (before >= 0 and not before >> (TOGETHER + other) & 1):
                continue
            if fold_near(folds[other], start, limits, target):
                found = swing_free(
                    limb, path, 0.0, 0.0, start, target, lengths, mount_rotation, mount_position, others, shapes, fixed,
                    world, clearance, inside, 0.0,
                )  # fmt: skip
                if found == CLEAR:
                    together |= np.int64(1) << other
        folded = via = np.int64(0)
        for b in range(8):
            if not free & (0x0101 << b):
                continue
            for fold in range(len(folds)):
                if not together >> fold & 1 or (before >= 0 and before >> (VIA + 2 * b) & 3 != fold):
                    continue
                if fold_near(folds[fold], q[b], limits, target):
                    found = swing_free(
                        limb, path, 0.0, 0.0, q[b], target, lengths, mount_rotation, mount_position, others, shapes, fixed,
                        world, clearance, inside, 0.0,
                    )  # fmt: skip
                    if found == CLEAR:
                        folded |= 0x0101 << b
                        via |= np.int64(fold) << (2 * b)
                        break
        if folded & free:
            return folded & free | together << TOGETHER | np.int64(root) << ROOT | via << VIA
    return np.int64(0)


@kernel
def carried(
    limb, together, path, folds, mount_rotations, mount_positions, lengths, bodies, inside
):  # fmt: skip
    """The first fold of a set in which a limb can be carried along a base path, -1 if there is none."""
    shapes, _, _, fixed, world, clearance, body = bodies
    q, none = np.zeros(6), np.empty((0, len(shapes[0]), 2, 3))
    for fold in range(len(folds)):
        if together >> fold & 1:
            for joint in range(5):
                q[joint] = folds[fold, joint]
            found = swing_free(
                limb, path, 0.0, 1.0, q, q, lengths, mount_rotations[limb], mount_positions[limb], none, shapes, fixed, world,
                clearance, inside, body,
            )  # fmt: skip
            if found == CLEAR:
                return fold
    return -1


@kernel
def holding(
    limb, mask, grip, tool, point, normal, path, mover, fold, folds, mount_rotations, mount_positions, lengths, bodies, inside,
):  # fmt: skip
    """Those of the branches in `mask` on which a limb can hold along a base path while `mover` is carried in a fold."""
    shapes, gripper, _, fixed, world, clearance, _ = bodies
    q = np.zeros(6)
    for joint in range(5):
        q[joint] = folds[fold, joint]
    for b in range(8):
        if mask & (0x0101 << b):
            found = hold_free(
                limb, grip, tool, path, 0.0, 1.0, b, lengths, mount_rotations[limb], mount_positions[limb], q, q,
                mount_rotations[mover], mount_positions[mover], shapes, gripper, fixed, world, point, normal, clearance, inside,
            )  # fmt: skip
            if found != CLEAR:
                mask &= ~(0x0101 << b)
    return mask


@kernel
def together_apart(
    i, j, first, second, grip_i, tool_i, grip_j, tool_j, path, mount_rotations, mount_positions, lengths, bodies
):  # fmt: skip
    """Branches of two limbs that hold, none of which come near each other along a base path.

    A branch of the second that comes near any of the first is dropped, unless that leaves none; then those of the first
    that come near the second's first branch are.
    """
    shapes, clearance = bodies[0], bodies[5]
    for turn in range(2):
        kept = second
        for c in range(8):
            for b in range(8):
                if kept & (0x0101 << c) and first & (0x0101 << b):
                    found = holds_apart(
                        grip_i, tool_i, b, mount_rotations[i], mount_positions[i], grip_j, tool_j, c, mount_rotations[j],
                        mount_positions[j], path, lengths, shapes, clearance,
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
                    grip_i, tool_i, b, mount_rotations[i], mount_positions[i], grip_j, tool_j, chosen, mount_rotations[j],
                    mount_positions[j], path, lengths, shapes, clearance,
                )  # fmt: skip
                if found != CLEAR:
                    first &= ~(0x0101 << b)
    return first, second
