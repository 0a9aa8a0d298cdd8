"""The branches of one posture (compiled).

What they touch, `w_b` of a combination of them, and on which of them a limb may hold. Further
arguments are those of `selection.solve_geometries`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.distances import CLEAR, segment_box_apart, segments_apart
from mlivr_gym.collisions.link_capsules import (
    EVERY,
    against_body,
    against_boxes,
    against_limb,
    axis_of,
    boxes_apart,
)
from mlivr_gym.collisions.link_frames import frames_of_branch, place, to_world
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.kinematics.base_path import STRAIGHT, within_limits
from mlivr_gym.kinematics.certificate import certify, expand_classes
from mlivr_gym.kinematics.manipulability import inverse_root_determinant, limb_information


@kernel
def combined(information: Array, branch: IntArray, scratch: Array) -> float:
    """`w_b` of one branch for each limb.

    Args:
        information: `K^-1` of each branch of each limb, shape (N, 8, 6, 6).
        branch: Branch of each limb, shape (N,).
        scratch: Shape (2, 6, 6).
    """
    for row in range(6):
        for col in range(row + 1):
            total = 0.0
            for i in range(len(branch)):
                total += information[i, branch[i], row, col]
            scratch[0, row, col] = total
    return inverse_root_determinant(scratch[0], scratch[1])


@kernel
def limb_status(
    i: int, b: int, p: Array, z: Array, position: Array, rotation: Array, point: Array,
    normal: Array, mount_rotation: Array, mount_position: Array, lengths: Array,
    checker: tuple[Any, ...], status: IntArray, ends: Array,
) -> int:  # fmt: skip
    """What limb `i` on branch `b` touches at a posture, other limbs apart.

    Args:
        i: Limb.
        b: Branch.
        p: Flange position in the limb base frame [m], shape (3,).
        z: Flange axis in the limb base frame, shape (3,).
        position: Base position in the world [m], shape (3,).
        rotation: Base rotation in the world, shape (3, 3).
        point: The grasp in the world [m], shape (3,).
        normal: Surface normal there in the world, shape (3,).
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        checker: `CollisionModel.arrays` with zeros and scratch arrays.
        status: Answers by limb and branch, -1 where unknown, shape (N, 8).
        ends: Capsule ends by limb and branch in the body frame [m], shape (N, 8, c, 2, 3).

    Returns:
        An answer, looked up or worked out.
    """
    if status[i, b] < 0:
        (
            shapes,
            gripper,
            hand,
            fixed,
            world,
            clearance,
            _,
            still,
            shift,
            spin,
            frames,
            world_ends,
        ) = checker
        status[i, b] = CLEAR + 1
        if frames_of_branch(p, z, lengths, b, frames):
            place(frames, shapes, mount_rotation, mount_position, ends[i, b])
            found, _ = against_body(
                i, ends[i, b], still, EVERY, shift, spin, 0.0, shapes, fixed, clearance
            )
            if found == CLEAR:
                to_world(ends[i, b], position, rotation, world_ends)
                found, _ = against_boxes(
                    world_ends,
                    still,
                    EVERY,
                    hand,
                    shapes[2],
                    world,
                    gripper,
                    point,
                    normal,
                    clearance,
                )
            status[i, b] = found
    answer: int = status[i, b]
    return answer


@kernel
def pair_status(
    i: int, b: int, j: int, c: int, ends: Array, pairs: IntArray, checker: tuple[Any, ...]
) -> int:
    """Whether limb `i` on branch `b` keeps clear of limb `j` on branch `c`, both in place.

    Args:
        i: First limb.
        b: Its branch.
        j: Second limb.
        c: Its branch.
        ends: See `limb_status`.
        pairs: Answers by limbs and branches, -1 where unknown, shape (N, 8, N, 8).
        checker: See `limb_status`.

    Returns:
        An answer, looked up or worked out.
    """
    if pairs[i, b, j, c] < 0:
        found, _ = against_limb(
            ends[i, b], checker[7], EVERY, ends[j, c], checker[7], checker[0], checker[5]
        )
        pairs[i, b, j, c] = pairs[j, c, i, b] = found
    answer: int = pairs[i, b, j, c]
    return answer


@kernel
def apart(trial: IntArray, ends: Array, pairs: IntArray, checker: tuple[Any, ...]) -> bool:
    """Whether limbs in place on a combination of branches keep clear of each other."""
    for i in range(len(trial)):
        for j in range(i):
            if pair_status(i, trial[i], j, trial[j], ends, pairs, checker) != CLEAR:
                return False
    return True


@kernel
def forget(status: IntArray, pairs: IntArray) -> None:
    """Mark every answer as unknown."""
    for i in range(status.shape[0]):
        for b in range(8):
            status[i, b] = -1
            for j in range(status.shape[0]):
                for c in range(8):
                    pairs[i, b, j, c] = -1


@kernel
def _link_gaps(
    limb: int, ends: Array, shapes: tuple[Any, ...], fixed: tuple[Any, ...], least: float
) -> float:
    """Least distance of a limb's links from each other, the body and what is fixed to that [m].

    Any number below `least` stands for one below it. `ends` has shape (c, 2, 3), in the body frame.
    """
    link, radius, compared = shapes[0], shapes[2], shapes[3]
    mounts, mount_radius, half, least_link = fixed
    gap = np.inf
    for k in range(len(compared)):
        i, j = compared[k, 0], compared[k, 1]
        gap = min(gap, _axes_gap(ends, i, ends, j, radius[i] + radius[j], gap))
    for c in range(len(link)):
        if gap < least:
            return gap
        if link[c] < 2:
            continue
        p, u = axis_of(ends, c)
        gap = min(gap, np.sqrt(segment_box_apart(p, u, (half[0], half[1], half[2]))) - radius[c])
        for m in range(len(mounts)):
            if link[c] >= least_link[limb, m]:
                gap = min(gap, _axes_gap(ends, c, mounts, m, radius[c] + mount_radius[m], gap))
    return gap


@kernel
def _axes_gap(ends: Array, i: int, other: Array, j: int, radii: float, gap: float) -> float:
    """Distance of two capsules [m], or `gap` where it is seen to be no less."""
    if boxes_apart(ends, i, other, j, gap + radii):
        return gap
    p, u = axis_of(ends, i)
    q, v = axis_of(other, j)
    distance: float = np.sqrt(segments_apart(p, u, q, v)) - radii
    return distance


@kernel
def self_clearance(
    trial: IntArray, ends: Array, shapes: tuple[Any, ...], fixed: tuple[Any, ...], least: float
) -> float:
    """Least distance of two shapes of the robot that are compared, on some branches [m].

    Negative where they overlap; `contacts.contacts` is the plain definition. Any number below
    `least` stands for one below it.

    Args:
        trial: Branch of each limb, shape (N,).
        ends: Capsule ends by limb and branch in the body frame [m], shape (N, 8, c, 2, 3).
        shapes: `LimbShapes.arrays`.
        fixed: `LimbShapes.fixed`.
        least: See above [m].
    """
    radius, gap = shapes[2], np.inf
    for i in range(len(trial)):
        gap = min(gap, _link_gaps(i, ends[i, trial[i]], shapes, fixed, least))
        for j in range(i):
            for a in range(len(radius)):
                if gap < least:
                    return gap
                for b in range(len(radius)):
                    gap = min(
                        gap,
                        _axes_gap(
                            ends[i, trial[i]], a, ends[j, trial[j]], b, radius[a] + radius[b], gap
                        ),
                    )
    return gap


@kernel
def hold_masks(
    grasps: Array, normals: Array, tools: Array, position: Array, rotation: Array, branch: IntArray,
    p: Array, z: Array, w: Array, mount_rotations: Array, mount_positions: Array, lengths: Array,
    limits: Array, full_turn: bool, tool_length: float, lift: float, l_c: float, w_m_min: float,
    w_b_min: float, floor: float, points: Array, world_position: Array, checker: tuple[Any, ...],
    status: IntArray, ends: Array, pairs: IntArray, information: Array, scratch: Array,
    members: IntArray, allowed: BoolArray, kept: BoolArray, mask: IntArray,
) -> None:  # fmt: skip
    """Branches and flips on which each limb may hold at a posture, a product set.

    A branch belongs if `w_m` meets the threshold, if the limb can depart along the surface normal
    on it with `w_m` above the floor and inside its joint limits, if it touches nothing, and if
    every combination with the other limbs' branches meets the threshold of `w_b` and keeps them
    apart. The set grows from the branches of the posture in a fixed order. It is written into
    `mask`, shape (N,).

    Further arguments as in `solve_geometries`, for one geometry, and scratch arrays.
    """
    count = grasps.shape[0]
    grip, approach, lifted = floats(3), floats(3), floats(3)
    kind = STRAIGHT
    for i in range(count):
        classes = 0
        for c in range(4):
            if w[i, c] >= w_m_min and w[i, c] >= floor and w[i, c] > 0.0:
                classes |= 1 << c
        for axis in range(3):
            approach[axis] = -normals[i, axis]
            grip[axis] = grasps[i, axis] + tool_length * normals[i, axis]
            lifted[axis] = position[axis] - lift * normals[i, axis]
        if classes:
            classes = certify(
                grip, approach, position, rotation, lifted, rotation, kind, position,
                mount_rotations[i], mount_positions[i], lengths, floor * l_c**3, classes,
            )  # fmt: skip
        bits = expand_classes(classes)
        if bits and not full_turn:
            bits = within_limits(
                grip, tools[i], position, rotation, lifted, rotation, kind, position,
                mount_rotations[i], mount_positions[i], lengths, limits, bits,
            )  # fmt: skip
        mask[i] = bits
        for b in range(8):
            allowed[i, b] = (bits | bits >> 8) >> b & 1
            if allowed[i, b]:
                allowed[i, b] = limb_status(
                    i, b, p[i], z[i], world_position, rotation, points[i], normals[i],
                    mount_rotations[i],
                    mount_positions[i], lengths, checker, status, ends,
                ) == CLEAR  # fmt: skip
            kept[i, b] = False
            if allowed[i, b]:
                limb_information(
                    p[i],
                    z[i],
                    lengths,
                    b,
                    mount_rotations[i],
                    mount_positions[i],
                    l_c,
                    information[i, b],
                )
    _grow(allowed, information, branch, w_b_min, ends, pairs, checker, members, scratch, kept)
    for i in range(count):
        bits = 0
        for b in range(8):
            if kept[i, b]:
                bits |= 0x0101 << b
        mask[i] &= bits


@kernel
def _grow(
    allowed: BoolArray, information: Array, branch: IntArray, w_b_min: float, ends: Array,
    pairs: IntArray, checker: tuple[Any, ...], members: IntArray, scratch: Array, kept: BoolArray,
) -> None:  # fmt: skip
    """Product set reached from the branches of a posture by adding branches one at a time.

    Every combination reaches `w_b_min` and is clear. `members`, shape (8^N, N), takes the
    combinations of the set; `kept`, shape (N, 8), says which branches are in it.
    """
    count = len(branch)
    for i in range(count):
        members[0, i] = branch[i]
        if not allowed[i, branch[i]]:
            return
    for i in range(count):
        kept[i, branch[i]] = True
    size = 1
    for i in range(count):
        for b in range(8):
            if not allowed[i, b] or kept[i, b]:
                continue
            end = size
            for k in range(size):
                if members[k, i] == branch[i]:
                    for j in range(count):
                        members[end, j] = members[k, j]
                    members[end, i] = b
                    clear = True
                    for j in range(count):
                        if j != i and clear:
                            clear = (
                                pair_status(i, b, j, members[end, j], ends, pairs, checker) == CLEAR
                            )
                    if not clear or combined(information, members[end], scratch) < w_b_min:
                        end = -1
                        break
                    end += 1
            if end > 0:
                size = end
                kept[i, b] = True
