"""Checks of postures against boxes (compiled)."""

from __future__ import annotations

from typing import Any

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.link_capsules import EVERY, against_boxes, bit, body_against_boxes
from mlivr_gym.collisions.link_frames import frames_of_branch, place, to_world
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats, zeros
from mlivr_gym.kinematics.base_path import flange_in_limb


@kernel
def hands_clear(
    points: Array,
    normals: Array,
    tool_length: float,
    lengths: Array,
    collision_model: tuple[Any, ...],
    answers: IntArray,
) -> None:
    """What the capsules on the flange axis touch at each point, whatever the posture.

    Args:
        points: Points of the map in the world [m], shape (m, 3).
        normals: Their surface normals in the world, shape (m, 3).
        tool_length: Flange to grasp [m].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        collision_model: `CollisionModel.arrays`.
        answers: Filled with what they touch, shape (m,).
    """
    shapes, gripper, hand, _, world, clearance, _ = collision_model
    link, local = shapes[0], shapes[1]
    ends, still = floats(len(link), 2, 3), zeros(len(link), 2)
    for m in range(len(points)):
        for c in range(hand, len(link)):
            for e in range(2):
                along = local[c, e, 2] if link[c] == 6 else local[c, e, 1] - lengths[5]
                for k in range(3):
                    ends[c, e, k] = points[m, k] + (tool_length - along) * normals[m, k]
        answers[m] = against_boxes(
            ends,
            still,
            -bit(hand),
            len(link),
            shapes[2],
            world,
            gripper,
            points[m],
            normals[m],
            clearance,
        )[0]


@kernel
def clear_of_world(
    start: int, stop: int, chosen: IntArray, points: IntArray, positions: Array, normals: Array,
    tool_length: float, position: Array, rotation: Array, branch: IntArray, mask: IntArray,
    check: bool, mount_rotations: Array, mount_positions: Array, lengths: Array,
    collision_model: tuple[Any, ...], cause: IntArray,
) -> None:  # fmt: skip
    """Take the branches that touch a box out of the masks of postures.

    Args:
        start: First of `chosen`.
        stop: One past the last.
        chosen: Stances to check.
        points: Point indices of all stances, shape (k, N).
        positions: Points of the map in the world [m], shape (m, 3).
        normals: Their surface normals in the world, shape (m, 3).
        tool_length: Flange to grasp [m].
        position: Base positions in the world [m], shape (k, 3).
        rotation: Base rotations in the world, shape (k, 3, 3).
        branch: Branch of each limb in the posture, shape (k, N).
        mask: Branches and flips of each limb, shape (k, N), changed.
        check: Whether branches other than these count.
        mount_rotations: Limb base axes in the body frame, shape (N, 3, 3).
        mount_positions: Limb base origins in the body frame [m], shape (N, 3).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        collision_model: `CollisionModel.arrays`.
        cause: Filled with the cause where a branch of the posture touches a box, shape (k,).
    """
    shapes, gripper, hand, _, world, clearance, body = collision_model
    capsules = len(shapes[0])
    ends, world_ends, still = floats(capsules, 2, 3), floats(capsules, 2, 3), zeros(capsules, 2)
    frames, p, z = floats(7, 4, 3), floats(3), floats(3)
    grip, approach, normal = floats(3), floats(3), floats(3)
    for n in range(start, stop):
        k = chosen[n]
        found = body_against_boxes(position[k], rotation[k], 0.0, 0.0, body, world, clearance)
        if found != CLEAR:
            cause[k] = found
            for i in range(points.shape[1]):
                if check:
                    mask[k, i] = 0
            continue
        for i in range(points.shape[1]):
            point = points[k, i]
            for axis in range(3):
                normal[axis] = normals[point, axis]
                approach[axis] = -normal[axis]
                grip[axis] = positions[point, axis] + tool_length * normal[axis]
            flange_in_limb(
                grip,
                approach,
                position[k],
                rotation[k],
                approach,
                0.0,
                mount_rotations[i],
                mount_positions[i],
                p,
                z,
            )
            for b in range(8):
                in_posture = b == branch[k, i]
                if not in_posture and not (check and mask[k, i] & (0x0101 << b)):
                    continue
                found = CLEAR + 1
                if frames_of_branch(p, z, lengths, b, frames):
                    place(frames, shapes, mount_rotations[i], mount_positions[i], ends)
                    to_world(ends, position[k], rotation[k], world_ends)
                    found, _ = against_boxes(
                        world_ends,
                        still,
                        EVERY,
                        hand,
                        shapes[2],
                        world,
                        gripper,
                        positions[point],
                        normal,
                        clearance,
                    )
                if found != CLEAR:
                    if check:
                        mask[k, i] &= ~(0x0101 << b)
                    if in_posture:
                        cause[k] = found
