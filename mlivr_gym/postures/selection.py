"""Selection of postures among candidates (compiled); see `solver` for what it serves."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.distances import CLEAR, SELF
from mlivr_gym.compiled.kernels import allocating_kernel, kernel
from mlivr_gym.compiled.stack_arrays import floats, zeros
from mlivr_gym.kinematics.base_path import flange_in_limb, turn
from mlivr_gym.kinematics.manipulability import limb_information
from mlivr_gym.kinematics.ur import SINGULAR, branch_terms
from mlivr_gym.postures.branches import combined, hold_masks
from mlivr_gym.postures.rule import best_posture, enter, touches_nothing


@kernel
def limb_choices(
    grasps: Array, normals: Array, tool_length: float, position: Array, rotation: Array,
    mount_rotations: Array, mount_positions: Array, lengths: Array, l_c: float, p: Array, z: Array,
    w: Array,
) -> float:  # fmt: skip
    """Flange poses and `w_m` of the shoulder and wrist choices of each limb, for one base pose.

    Grasps, normals and base pose are given in one frame.

    Args:
        grasps: Held points [m], shape (N, 3).
        normals: Surface normals, shape (N, 3).
        tool_length: Flange to grasp [m].
        position: Base position [m], shape (3,).
        rotation: Base rotation, shape (3, 3).
        mount_rotations: Limb base axes in the body frame, shape (N, 3, 3).
        mount_positions: Limb base origins in the body frame [m], shape (N, 3).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        l_c: Characteristic length [m].
        p: Filled with flange positions in the limb base frames [m], shape (N, 3).
        z: Filled with flange axes in the limb base frames, shape (N, 3).
        w: Filled, shape (N, 4); 0 out of reach.

    Returns:
        The least over the limbs of the best choice.
    """
    unit = abs(lengths[1] * lengths[2]) / l_c**3
    terms = floats(4, 4)
    grip, approach = floats(3), floats(3)
    least = np.inf
    for i in range(grasps.shape[0]):
        for axis in range(3):
            approach[axis] = -normals[i, axis]
            grip[axis] = grasps[i, axis] + tool_length * normals[i, axis]
        flange_in_limb(
            grip,
            approach,
            position,
            rotation,
            approach,
            0.0,
            mount_rotations[i],
            mount_positions[i],
            p[i],
            z[i],
        )
        branch_terms(p[i], z[i], lengths, terms)
        best = 0.0
        for c in range(4):
            w[i, c] = unit * np.sqrt(terms[c, 3]) if terms[c, 3] > SINGULAR * SINGULAR else 0.0
            best = max(best, w[i, c])
        least = min(least, best)
    return least


@kernel
def choices_along(
    points: IntArray, grasps: Array, normals: Array, tool_length: float, position: Array,
    rotation: Array, mount_rotations: Array, mount_positions: Array, lengths: Array, l_c: float,
    p: Array, z: Array, w: Array,
) -> None:  # fmt: skip
    """`limb_choices` of K stances given by point indices, shape (K, N).

    `grasps` and `normals` are those of the map, in the world, as the base poses are.
    """
    count, limbs = points.shape
    here, out = floats(limbs, 3), floats(limbs, 3)
    for k in range(count):
        for i in range(limbs):
            for axis in range(3):
                here[i, axis] = grasps[points[k, i], axis]
                out[i, axis] = normals[points[k, i], axis]
        limb_choices(
            here, out, tool_length, position[k], rotation[k], mount_rotations, mount_positions,
            lengths, l_c, p[k], z[k], w[k]
        )  # fmt: skip


@kernel
def base_along(
    p: Array, z: Array, branches: IntArray, mount_rotations: Array, mount_positions: Array,
    lengths: Array, l_c: float, information: Array, scratch: Array, w_b: Array,
) -> None:  # fmt: skip
    """`w_b` of K stances on given branches, shape (K, N), from flange poses of `choices_along`."""
    count, limbs = branches.shape
    for k in range(count):
        for i in range(limbs):
            b = branches[k, i]
            limb_information(
                p[k, i],
                z[k, i],
                lengths,
                b,
                mount_rotations[i],
                mount_positions[i],
                l_c,
                information[i, b],
            )
        w_b[k] = combined(information, branches[k], scratch)


@allocating_kernel
def solve_geometries(
    start: int, stop: int, grasps: Array, normals: Array, tools: Array, frames: Array, outs: Array,
    lines: Array, opposed: BoolArray, mount_rotations: Array, mount_positions: Array,
    lengths: Array, limits: Array, full_turn: bool, tool_length: float, lift: float, l_c: float,
    heights: Array, rolls: Array, wide_heights: Array, wide_rolls: Array, scale_m: float,
    scale_b: float, w_m_min: float, w_b_min: float, floor: float, nodes_margin: float,
    first_avoid: bool, check: bool, collide: bool, centres: Array, collision_model: tuple[Any, ...],
    position: Array, rotation: Array, w_m: Array, w_b: Array, branch: IntArray, mask: IntArray,
    cause: IntArray,
) -> None:  # fmt: skip
    """Best posture of each geometry from `start` to `stop`.

    Grasps, directions and base poses of a geometry are given in its frame, about the grasps'
    centroid; `centres` says where that lies in the world of `collision_model`.

    Args:
        start: First geometry.
        stop: One past the last.
        grasps: Held points from their centroid [m], shape (k, N, 3).
        normals: Surface normals, shape (k, N, 3).
        tools: Flange rotations at the grasps, flip 0, shape (k, N, 3, 3).
        frames: Unrolled body axes, shape (k, 3, 3).
        outs: Outward directions, shape (k, 3).
        lines: Roll axes, shape (k, 3).
        opposed: Whether the walls are opposed, shape (k,).
        mount_rotations: Limb base axes in the body frame, shape (N, 3, 3).
        mount_positions: Limb base origins in the body frame [m], shape (N, 3).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        limits: Joint limits [rad], shape (6, 2).
        full_turn: Whether the limits rule out nothing.
        tool_length: Flange to grasp [m].
        lift: Departure along the normal [m].
        l_c: Characteristic length [m].
        heights: Heights tried [m].
        rolls: Rolls tried [rad].
        wide_heights: Heights tried between opposed walls [m].
        wide_rolls: Rolls tried there [rad].
        scale_m: Limb manipulability that counts as margin 1.
        scale_b: Base manipulability that counts as margin 1.
        w_m_min: Threshold of `w_m`.
        w_b_min: Threshold of `w_b`.
        floor: Least `w_m` on the departure.
        nodes_margin: A margin below that of every node.
        first_avoid: Whether the best posture of all is known to touch something.
        check: Whether branches are checked; if not, every node has all of them.
        collide: Whether postures must touch nothing.
        centres: Centroids of the grasps in the world of `collision_model` [m], shape (k, 3).
        collision_model: `CollisionModel.arrays`.
        position: Filled with base positions from the centroid [m], shape (k, 3).
        rotation: Filled with base rotations, shape (k, 3, 3).
        w_m: Filled, shape (k, N); 0 where nothing is in reach.
        w_b: Filled, shape (k,).
        branch: Filled, shape (k, N).
        mask: Zeros, shape (k, N), filled at nodes; see `hold_masks`.
        cause: Zeros, shape (k,), filled with what the best posture touches where that alone keeps a
            node away.
    """
    count, capsules = grasps.shape[1], len(collision_model[0][0])
    most = max(len(heights) * len(rolls), len(wide_heights) * len(wide_rolls))
    scratch = (
        np.empty((8**count, count), dtype=np.int64), np.empty((count, 8), dtype=np.bool_),
        np.empty((count, 8), dtype=np.bool_),
        np.empty((most, count, 4)), np.empty(most), np.empty(most), np.empty((most, count, 3)),
        np.empty((most, count, 3)),
        np.empty((most, 3, 3)), np.empty((most, 3)), np.empty((count, 8, 6, 6)),
        np.empty((2, 6, 6)),
        np.zeros(count, dtype=np.int64), np.empty((count, 8), dtype=np.int64),
        np.empty((count, 8, count, 8), dtype=np.int64), np.empty((count, 8, capsules, 2, 3)),
    )  # fmt: skip
    _solve(
        start, stop, grasps, normals, tools, frames, outs, lines, opposed, mount_rotations,
        mount_positions, lengths, limits,
        full_turn, tool_length, lift, l_c, heights, rolls, wide_heights, wide_rolls, scale_m,
        scale_b, w_m_min, w_b_min, floor,
        nodes_margin, first_avoid, check, collide, centres, collision_model, position, rotation,
        w_m, w_b, branch, mask, cause, scratch,
    )  # fmt: skip


@kernel
def _solve(
    start: int, stop: int, grasps: Array, normals: Array, tools: Array, frames: Array, outs: Array,
    lines: Array, opposed: BoolArray, mount_rotations: Array, mount_positions: Array,
    lengths: Array, limits: Array, full_turn: bool, tool_length: float, lift: float, l_c: float,
    heights: Array, rolls: Array, wide_heights: Array, wide_rolls: Array, scale_m: float,
    scale_b: float, w_m_min: float, w_b_min: float, floor: float, nodes_margin: float,
    first_avoid: bool, check: bool, collide: bool, centres: Array, collision_model: tuple[Any, ...],
    position: Array, rotation: Array, w_m: Array, w_b: Array, branch: IntArray, mask: IntArray,
    cause: IntArray, scratch: tuple[Any, ...],
) -> None:  # fmt: skip
    """What `solve_geometries` does, with scratch arrays sized by the number of limbs."""
    count = grasps.shape[1]
    (
        members, allowed, kept, w_class, bounds, first_bounds, p, z, turned, origins, information,
        work, trial, status, pairs,
        ends,
    ) = scratch  # fmt: skip
    shapes, gripper, hand, fixed, world, clearance, body = collision_model
    capsules = len(shapes[0])
    still, shift, spin = zeros(capsules, 2), zeros(5, 4), zeros(5, 7)
    link_frames, world_ends = floats(7, 4, 3), floats(capsules, 2, 3)
    strict = (
        shapes,
        gripper,
        hand,
        fixed,
        world,
        clearance,
        body,
        still,
        shift,
        spin,
        link_frames,
        world_ends,
    )
    # Where nothing is to be avoided `world` is empty and only what penetrates counts.
    loose = (
        shapes,
        gripper,
        hand,
        fixed,
        world,
        0.0,
        body,
        still,
        shift,
        spin,
        link_frames,
        world_ends,
    )
    world_position, points = floats(3), floats(count, 3)
    arm = (mount_rotations, mount_positions, lengths, l_c)
    room = (information, work, trial, status, pairs, ends, world_position)
    for g in range(start, stop):
        for i in range(count):
            for axis in range(3):
                points[i, axis] = centres[g, axis] + grasps[g, i, axis]
        try_rolls = wide_rolls if opposed[g] else rolls
        try_heights = wide_heights if opposed[g] else heights
        candidates = len(try_rolls) * len(try_heights)
        for c in range(candidates):
            roll = try_rolls[c // len(try_heights)]
            height = try_heights[c % len(try_heights)]
            cosine, sine = np.cos(roll), np.sin(roll)
            for col in range(3):
                turned[c, 0, col], turned[c, 1, col], turned[c, 2, col] = turn(
                    lines[g], cosine, sine, frames[g, 0, col], frames[g, 1, col], frames[g, 2, col]
                )
            up = turn(lines[g], cosine, sine, outs[g, 0], outs[g, 1], outs[g, 2])
            for axis in range(3):
                origins[c, axis] = height * up[axis]
            first_bounds[c] = limb_choices(
                grasps[g], normals[g], tool_length, origins[c], turned[c], mount_rotations,
                mount_positions,
                lengths, l_c, p[c], z[c], w_class[c],
            ) / scale_m  # fmt: skip
        poses = (
            p[:candidates],
            z[:candidates],
            w_class[:candidates],
            origins[:candidates],
            turned[:candidates],
        )
        ahead, rest = first_bounds[:candidates], bounds[:candidates]
        # First the best posture that does not penetrate the robot itself; only if that comes too
        # close to something, the best of those that keep the clearance.
        chosen, node, touches = -1, False, CLEAR
        checker = loose
        for avoid in range(2):
            if (avoid == 0 and first_avoid) or (
                avoid == 1 and not (first_avoid or touches != CLEAR)
            ):
                continue
            checker = strict if avoid else loose
            lowest = nodes_margin if avoid else 0.0
            cause[g] = touches
            chosen, w_b[g], seen = best_posture(
                lowest, avoid == 0, poses, ahead, rest, centres[g], points, normals[g], arm,
                scale_m,
                scale_b, checker, fixed, room, branch[g],
            )  # fmt: skip
            node = chosen >= 0 and w_b[g] >= w_b_min
            for i in range(count):
                w_m[g, i] = w_class[chosen, i, branch[g, i] >> 1] if chosen >= 0 else 0.0
                node = node and w_m[g, i] >= w_m_min
            if chosen >= 0:
                for axis in range(3):
                    position[g, axis] = origins[chosen, axis]
                    for col in range(3):
                        rotation[g, axis, col] = turned[chosen, axis, col]
            if avoid == 0:
                if not node and seen > nodes_margin:
                    cause[g] = SELF
                if node and collide:
                    enter(
                        chosen,
                        np.inf,
                        False,
                        poses,
                        centres[g],
                        normals[g],
                        arm,
                        scale_m,
                        strict,
                        room,
                    )
                    for i in range(count):
                        trial[i] = branch[g, i]
                    if not touches_nothing(chosen, poses, points, normals[g], arm, strict, room):
                        touches = SELF
            elif node:
                cause[g] = CLEAR
        checker = strict if collide else loose
        if node and check:
            enter(chosen, np.inf, False, poses, centres[g], normals[g], arm, scale_m, checker, room)
            hold_masks(
                grasps[g], normals[g], tools[g], position[g], rotation[g], branch[g], p[chosen],
                z[chosen], w_class[chosen],
                mount_rotations, mount_positions, lengths, limits, full_turn, tool_length, lift,
                l_c, w_m_min, w_b_min,
                floor, points, world_position, checker, status, ends, pairs, information, work,
                members,
                allowed, kept, mask[g],
            )  # fmt: skip
        elif node:
            for i in range(count):
                mask[g, i] = 0xFFFF
