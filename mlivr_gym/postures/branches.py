"""Compiled kernels of the branches of one posture: what they touch, `w_b` of a combination, and on which a limb may hold.

Further arguments are those of `posture_kernels.solve_geometries`.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.collisions.distances import CLEAR, segment_box_apart, segments_apart
from mlivr_gym.collisions.link_capsules import (
    EVERY,
    against_body,
    against_boxes,
    against_limb,
    axis_of,
    boxes_apart,
    frames_of_branch,
    place,
    to_world,
)
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.kinematics.base_path import STRAIGHT, certify, expand_classes, within_limits
from mlivr_gym.kinematics.manipulability import inverse_root_determinant, limb_information


@kernel
def combined(information, branch, scratch):
    """`w_b` of one branch for each limb from their `K^-1`, shape (N, 8, 6, 6); `scratch` has shape (2, 6, 6)."""
    for row in range(6):
        for col in range(row + 1):
            total = 0.0
            for i in range(len(branch)):
                total += information[i, branch[i], row, col]
            scratch[0, row, col] = total
    return inverse_root_determinant(scratch[0], scratch[1])


@kernel
def limb_status(
    i,
    b,
    p,
    z,
    position,
    rotation,
    point,
    normal,
    mount_rotation,
    mount_position,
    lengths,
    checker,
    status,
    ends,
):
    """What limb `i` on branch `b` touches at a posture on its own: an answer, looked up or worked out.

    Args:
        i: Limb.
        b: Branch.
        p: Flange position in the limb base frame [m].
        z: Flange axis there.
        position: Base position in the world [m].
        rotation: Base rotation.
        point: The grasp in the world [m].
        normal: Surface normal there.
        mount_rotation: Shape (3, 3).
        mount_position: Shape (3,) [m].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        checker: `Bodies.arrays` with zeros and scratch arrays.
        status: Answers by limb and branch, -1 where unknown, shape (N, 8).
        ends: Capsule ends by limb and branch in the body frame, shape (N, 8, c, 2, 3).
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
    return status[i, b]


@kernel
def pair_status(i, b, j, c, ends, pairs, checker):
    """Whether limb `i` on branch `b` keeps clear of limb `j` on branch `c`, both in place: an answer, looked up or worked out."""
    if pairs[i, b, j, c] < 0:
        found, _ = against_limb(
            ends[i, b], checker[7], EVERY, ends[j, c], checker[7], checker[0], checker[5]
        )
        pairs[i, b, j, c] = pairs[j, c, i, b] = found
    return pairs[i, b, j, c]


@kernel
def apart(trial, ends, pairs, checker):
    """Whether limbs in place on a combination of branches keep clear of each other."""
    for i in range(len(trial)):
        for j in range(i):
            if pair_status(i, trial[i], j, trial[j], ends, pairs, checker) != CLEAR:
                return False
    return True


@kernel
def forget(status, pairs):
    """Mark every answer as unknown."""
    for i in range(status.shape[0]):
        for b in range(8):
            status[i, b] = -1
            for j in range(status.shape[0]):
                for c in range(8):
                    pairs[i, b, j, c] = -1


@kernel
def _link_gaps(limb, ends, shapes, fixed, least):
    """Distance of a limb from its own links, from the body and from what is fixed to it [m].

    Any number below `least` stands for one below it. `ends` has shape (c, 2, 3), in the body frame.
    """
    link, radius, own = shapes[0], shapes[2], shapes[3]
    mounts, mount_radius, half, least_link = fixed
    gap = np.inf
    for k in range(len(own)):
        i, j = own[k, 0], own[k, 1]
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
def _axes_gap(ends, i, other, j, radii, gap):
    """Distance of two capsules [m], or `gap` where it is seen to be no less."""
    if boxes_apart(ends, i, other, j, gap + radii):
        return gap
    p, u = axis_of(ends, i)
    q, v = axis_of(other, j)
    return np.sqrt(segments_apart(p, u, q, v)) - radii


@kernel
def self_clearance(trial, ends, shapes, fixed, least):
    """Least distance of two shapes of the robot that are compared, the limbs in place on a combination of branches [m].

    Negative where they overlap; `contacts.contacts` is the plain definition. Any number below
    `least` stands for one below it.

    Args:
        trial: Branch of each limb, shape (N,).
        ends: Capsule ends by limb and branch in the body frame, shape (N, 8, c, 2, 3).
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
    grasps, normals, tools, position, rotation, branch, p, z, w, mount_rotations, mount_positions,
    lengths, limits, full_turn,
    tool_length, lift, l_c, w_m_min, w_b_min, floor, points, world_position, checker, status, ends,
    pairs,
    information, scratch, members, allowed, kept, mask,
):  # fmt: skip
    """Branches and flips on which each limb may hold at a posture, a product set, into `mask`, shape (N,).

    A branch belongs if `w_m` meets the threshold, if the limb can depart along the surface normal
    on it with `w_m` above the floor and inside its joint limits, if it touches nothing, and if
    every combination with the other limbs' branches meets the threshold of `w_b` and keeps them
    apart. The set grows from the posture's own branches in a fixed order.

    Further arguments as in `solve_geometries`, for one geometry, and scratch arrays.
    """
    count = grasps.shape[0]
    grip, approach, lifted = floats(3), floats(3), floats(3)
    kind = np.int64(STRAIGHT)
    for i in range(count):
        classes = np.int64(0)
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
def _grow(allowed, information, own, w_b_min, ends, pairs, checker, members, scratch, kept):
    """Product set reached from `own` by adding branches one at a time, every combination at or above `w_b_min` and clear.

    `members`, shape (8^N, N), takes the combinations of the set; `kept`, shape (N, 8), says which
    branches are in it.
    """
    count = len(own)
    for i in range(count):
        members[0, i] = own[i]
        if not allowed[i, own[i]]:
            return
    for i in range(count):
        kept[i, own[i]] = True
    size = 1
    for i in range(count):
        for b in range(8):
            if not allowed[i, b] or kept[i, b]:
                continue
            end = size
            for k in range(size):
                if members[k, i] == own[i]:
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
