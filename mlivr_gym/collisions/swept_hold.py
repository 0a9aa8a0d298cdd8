"""Checks of limbs that hold while the base moves (compiled); the reasoning is in `swept_swing`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.distances import CLEAR, UNDECIDED
from mlivr_gym.collisions.link_capsules import EVERY, against_body, against_boxes, against_limb
from mlivr_gym.collisions.link_frames import frames_of_angles, place, to_world
from mlivr_gym.collisions.motion_bounds import (
    capsule_motion,
    joint_motion,
    moved_by_base,
    path_speed,
    pose_on_path,
    seen_from_grasp,
)
from mlivr_gym.collisions.swept_swing import DEPTH, FIRST_INTERVAL, changes, halve, share
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats, integers
from mlivr_gym.kinematics.base_path import position_on_path, relative_rotation, turn
from mlivr_gym.kinematics.ur import branch_angles, wrap

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

STANDING, MOVER, BOTH = 1, 2, 3
"""Parts of what a limb that holds is checked against, see `hold_free`."""


@kernel
def holding_angles(
    grip: Array, tool: Array, path: tuple[Any, ...], axis: Array, omega: float, s: float,
    mount_rotation: Array, mount_position: Array, lengths: Array, branch: int, scratch: Array,
    q: Array,
) -> bool:  # fmt: skip
    """Joint angles of a limb that holds, at `s` on a base path.

    Args:
        grip: Flange position in the world [m], shape (3,).
        tool: Flange rotation in the world, shape (3, 3).
        path: Base path (t0, r0, t1, r1, kind, pivot).
        axis: Axis of its rotation in the body frame at the start, shape (3,).
        omega: Angle of its rotation [rad].
        s: Path parameter from 0 to 1.
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        branch: Branch label.
        scratch: Shape (4, 3).
        q: Filled, shape (6,) [rad].

    Returns:
        Whether the branch exists there.
    """
    t0, r0, t1, _, kind, pivot = path
    here, p, x, z = scratch[0], scratch[1], scratch[2], scratch[3]
    position_on_path(t0, t1, kind, pivot, s, here)
    c, sine = np.cos(s * omega), -np.sin(s * omega)
    seen = seen_from_base(
        r0, axis, c, sine, grip[0] - here[0], grip[1] - here[1], grip[2] - here[2]
    )
    along = seen_from_base(r0, axis, c, sine, tool[0, 0], tool[1, 0], tool[2, 0])
    approach = seen_from_base(r0, axis, c, sine, tool[0, 2], tool[1, 2], tool[2, 2])
    for k in range(3):
        p[k] = x[k] = z[k] = 0.0
        for row in range(3):
            p[k] += mount_rotation[row, k] * (seen[row] - mount_position[row])
            x[k] += mount_rotation[row, k] * along[row]
            z[k] += mount_rotation[row, k] * approach[row]
    return branch_angles(p, x, z, lengths, branch, q)


@kernel
def seen_from_base(
    r0: Array, axis: Array, c: float, s: float, x: float, y: float, z: float
) -> Triple:
    """A vector of the world in the axes of a base that has turned from `r0` about `axis`.

    The angle has the cosine `c` and the sine `-s`; `axis` is given in the body frame at `r0`.
    """
    return turn(
        axis,
        c,
        s,
        r0[0, 0] * x + r0[1, 0] * y + r0[2, 0] * z,
        r0[0, 1] * x + r0[1, 1] * y + r0[2, 1] * z,
        r0[0, 2] * x + r0[1, 2] * y + r0[2, 2] * z,
    )


@kernel
def hold_free(
    limb: int, grip: Array, tool: Array, path: tuple[Any, ...], u0: float, u1: float, branch: int,
    lengths: Array, mount_rotation: Array, mount_position: Array, q0: Array, q1: Array,
    mover_rotation: Array, mover_position: Array, shapes: tuple[Any, ...], hand: int,
    fixed: tuple[Any, ...], world: tuple[Any, ...], clearance: float, inside: bool, parts: int,
) -> int:  # fmt: skip
    """Whether a limb can hold on one branch while the base goes from `u0` to `u1` on a path.

    It is checked against the boxes, the body, itself, and the limb that moves from `q0` to `q1`
    meanwhile. Its hand stands still in the world and is not compared with the boxes again:
    `queries.hands_clear` has done so.

    Args:
        limb: Index of the limb.
        grip: Flange position in the world [m], shape (3,).
        tool: Flange rotation in the world, shape (3, 3).
        path: Base path (t0, r0, t1, r1, kind, pivot).
        u0: Where the base is on it at the start.
        u1: Where it is at the end.
        branch: Branch label.
        lengths: d1, a2, a3, d4, d5, d6 [m].
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        q0: Joint angles of the limb that moves at the start, shape (6,) [rad].
        q1: Joint angles of the limb that moves at the end, shape (6,) [rad].
        mover_rotation: Base axes of the limb that moves in the body frame, shape (3, 3).
        mover_position: Base origin of the limb that moves in the body frame [m], shape (3,).
        shapes: `LimbShapes.arrays`.
        hand: First capsule of the hand, see `LimbShapes`.
        fixed: `LimbShapes.fixed`.
        world: `BoxWorld.arrays`.
        clearance: Least distance [m].
        inside: Whether the robot's shapes are compared with each other too, not with boxes alone.
        parts: Bits of what to compare with: `STANDING`, boxes, body and the limb itself, and
            `MOVER`, the limb that moves.

    Returns:
        `CLEAR`, `UNDECIDED` (too close for the depth), or the cause.
    """
    count = len(shapes[0])
    ends, world_ends, others = floats(count, 2, 3), floats(count, 2, 3), floats(count, 2, 3)
    motion, world_motion, other_motion = floats(count, 2), floats(count, 2), floats(count, 2)
    frames, shift, spin = floats(7, 4, 3), floats(5, 4), floats(5, 7)
    other_shift, other_spin = floats(5, 4), floats(5, 7)
    q, other_q, plus, minus, axis = floats(6), floats(6), floats(6), floats(6), floats(3)
    position, rotation, following, scratch = floats(3), floats(3, 3), floats(6), floats(4, 3)
    omega = relative_rotation(path[1], path[3], axis)
    speed = path_speed(path) * abs(u1 - u0)
    spin_rate = omega * abs(u1 - u0)
    for k in range(6):
        plus[k] = q1[k] - q0[k]
        minus[k] = -plus[k]
    joint_motion(plus, minus, lengths, other_shift, other_spin)
    pieces = min(max(int(np.ceil((speed + spin_rate) / FIRST_INTERVAL)), 1), 1 << DEPTH)
    stack_s, stack_half = floats(DEPTH + 2), floats(DEPTH + 2)
    stack_q, todo = floats(DEPTH + 2, 2, 6), integers(DEPTH + 2, 3)
    if not holding_angles(
        grip,
        tool,
        path,
        axis,
        omega,
        u0,
        mount_rotation,
        mount_position,
        lengths,
        branch,
        scratch,
        following,
    ):
        return UNDECIDED
    piece = top = 0
    shortest = 0.5 ** (DEPTH + 1)
    while top > 0 or piece < pieces:
        if top == 0:
            stack_half[0] = 0.5 / pieces
            stack_s[0] = (2 * piece + 1) * stack_half[0]
            todo[0, 0] = todo[0, 1] = EVERY if parts & STANDING else 0
            todo[0, 2] = EVERY if parts & MOVER else 0
            piece += 1
            top = 1
            at = u0 + piece / pieces * (u1 - u0)
            for k in range(6):
                stack_q[0, 0, k] = following[k]
            if not holding_angles(
                grip, tool, path, axis, omega, at, mount_rotation, mount_position, lengths, branch,
                scratch, following
            ):  # fmt: skip
                return UNDECIDED
            for k in range(6):
                stack_q[0, 1, k] = following[k]
        top -= 1
        s, half = stack_s[top], stack_half[top]
        boxes, body, limbs = todo[top]
        at = u0 + s * (u1 - u0)
        if not holding_angles(
            grip,
            tool,
            path,
            axis,
            omega,
            at,
            mount_rotation,
            mount_position,
            lengths,
            branch,
            scratch,
            q,
        ):
            return UNDECIDED
        changes(stack_q[top], q, minus, plus)
        joint_motion(plus, minus, lengths, shift, spin)
        frames_of_angles(q, lengths, frames)
        place(frames, shapes, mount_rotation, mount_position, ends)
        capsule_motion(shapes, shift, spin, 1.0, motion)
        if boxes:
            pose_on_path(path, axis, omega, at, position, rotation)
            to_world(ends, position, rotation, world_ends)
            moved_by_base(ends, motion, speed * half, spin_rate * half, world_motion)
            seen_from_grasp(plus, minus, lengths, shapes, world_motion)
            answer, boxes = against_boxes(
                world_ends,
                world_motion,
                boxes,
                hand,
                shapes[2],
                world,
                hand,
                position,
                position,
                clearance,
            )
            if answer > UNDECIDED:
                return answer
        if inside and body:
            answer, body = against_body(
                limb, ends, motion, body, shift, spin, 1.0, shapes, fixed, clearance
            )
            if answer > UNDECIDED:
                return answer
        if inside and limbs:
            for k in range(6):
                other_q[k] = q0[k] + s * (q1[k] - q0[k])
            frames_of_angles(other_q, lengths, frames)
            place(frames, shapes, mover_rotation, mover_position, others)
            capsule_motion(shapes, other_shift, other_spin, half, other_motion)
            answer, limbs = against_limb(
                ends, motion, limbs, others, other_motion, shapes, clearance
            )
            if answer > UNDECIDED:
                return answer
        if boxes or (inside and (body or limbs)):
            if half < shortest:
                return UNDECIDED
            top = halve(top, s, half, boxes, body, limbs, stack_s, stack_half, todo)
            share(top, q, stack_q)
    return CLEAR


@kernel
def holds_apart(
    grip_a: Array, tool_a: Array, branch_a: int, rotation_a: Array, position_a: Array,
    grip_b: Array, tool_b: Array, branch_b: int, rotation_b: Array, position_b: Array,
    path: tuple[Any, ...], lengths: Array, shapes: tuple[Any, ...], clearance: float,
) -> int:  # fmt: skip
    """Whether two limbs that hold keep clear of each other while the base follows a path.

    Grips, tools, branches and mounts of both limbs `a` and `b`, path and shapes as in `hold_free`.

    Returns:
        `CLEAR`, `UNDECIDED` (too close for the depth), or `SELF`.
    """
    count = len(shapes[0])
    ends, others = floats(count, 2, 3), floats(count, 2, 3)
    motion, other_motion = floats(count, 2), floats(count, 2)
    frames, shift, spin = floats(7, 4, 3), floats(5, 4), floats(5, 7)
    q, plus, minus, axis, scratch = floats(6), floats(6), floats(6), floats(3), floats(4, 3)
    omega = relative_rotation(path[1], path[3], axis)
    pieces = min(max(int(np.ceil((path_speed(path) + omega) / FIRST_INTERVAL)), 1), 1 << DEPTH)
    stack_s, stack_half, todo = floats(DEPTH + 2), floats(DEPTH + 2), integers(DEPTH + 2, 3)
    piece = top = 0
    shortest = 0.5 ** (DEPTH + 1)
    while top > 0 or piece < pieces:
        if top == 0:
            stack_half[0] = 0.5 / pieces
            stack_s[0] = (2 * piece + 1) * stack_half[0]
            todo[0] = EVERY
            piece += 1
            top = 1
        top -= 1
        s, half, limbs = stack_s[top], stack_half[top], todo[top, 0]
        for limb in range(2):
            grip, tool, branch = (
                (grip_a, tool_a, branch_a) if limb == 0 else (grip_b, tool_b, branch_b)
            )
            mount_rotation, mount_position = (
                (rotation_a, position_a) if limb == 0 else (rotation_b, position_b)
            )
            for side in range(3):
                at = s + (half if side == 1 else -half if side == 2 else 0.0)
                into = q if side == 0 else plus if side == 1 else minus
                if not holding_angles(
                    grip, tool, path, axis, omega, at, mount_rotation, mount_position, lengths,
                    branch, scratch, into
                ):  # fmt: skip
                    return UNDECIDED
            for joint in range(6):
                plus[joint], minus[joint] = (
                    wrap(plus[joint] - q[joint]),
                    wrap(minus[joint] - q[joint]),
                )
            joint_motion(plus, minus, lengths, shift, spin)
            frames_of_angles(q, lengths, frames)
            place(frames, shapes, mount_rotation, mount_position, ends if limb == 0 else others)
            capsule_motion(shapes, shift, spin, 1.0, motion if limb == 0 else other_motion)
        answer, limbs = against_limb(ends, motion, limbs, others, other_motion, shapes, clearance)
        if answer > UNDECIDED:
            return answer
        if limbs:
            if half < shortest:
                return UNDECIDED
            top = halve(top, s, half, limbs, limbs, limbs, stack_s, stack_half, todo)
    return CLEAR
