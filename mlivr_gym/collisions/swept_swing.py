"""Checks of whole departures and swings (compiled).

Limbs that hold while the base moves are in `swept_hold`.

**Advancement.** A motion is cut into intervals. At the middle of one the shapes are put in place
and compared with everything they can meet, see `link_capsules`. If every distance exceeds radii
and clearance by more than the shapes can move from the middle to either end, nothing comes closer
than the clearance anywhere on the interval, however thin it is: no step can skip a shape. If a
distance is below radii and clearance the motion is blocked; otherwise the interval is halved, down
to `2^-DEPTH` of the motion, where the answer errs on the safe side. On the halves only what was not
clear on the whole is compared again.

**How far shapes move.** Each capsule end hangs on an anchor, limb base, elbow E, forearm end F or
wrist point w, and moves no farther than the anchor moves plus its distance from it times the turn
of its link. Joints 2 to 4 are parallel and across joint 1, so link k up to 4 turns by `hypot(q1, q2
+ .. + qk)`, and joint 5 adds its turn; E, F and w follow one from the other. Two links of one limb
are compared as one sees the other: only the joints between them count. On a line in joint space all
this is exact. A limb whose flange is given (it holds, or departs along the normal) is solved at the
middle and both ends of an interval; its joints are taken to stay within the larger of the two
changes plus the whole second difference, eight times what a parabola through the three values
needs. The limb stays away from its singularities there, which `certificate.certify` has proved.

On a moving base a point at distance rho from its origin moves in the world at most `v + omega rho`
more. A limb that holds is also followed from its grasp, which stands still: the flange does not
move in the world, wrist 2 turns with joint 6 alone, wrist 1 with joints 5 and 6, and so on. The
smaller bound counts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.distances import CLEAR, UNDECIDED
from mlivr_gym.collisions.link_capsules import (
    EVERY,
    against_body,
    against_boxes,
    against_limb,
    bit,
    body_against_boxes,
)
from mlivr_gym.collisions.link_frames import frames_of_angles, place, to_world
from mlivr_gym.collisions.motion_bounds import (
    capsule_motion,
    joint_motion,
    moved_by_base,
    path_speed,
    pose_on_path,
)
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats, integers, zeros
from mlivr_gym.kinematics.base_path import relative_rotation
from mlivr_gym.kinematics.ur import branch_angles, wrap

DEPTH = 9
"""Halvings after which an interval counts as blocked."""

FIRST_INTERVAL = 0.6
"""Travel that an interval of the first division covers [m]; a matter of speed only."""


@kernel
def departure_free(
    limb: int, p: Array, x: Array, z: Array, away: Array, lift: float, lengths: Array, branch: int,
    mount_rotation: Array, mount_position: Array, position: Array, rotation: Array, others: Array,
    shapes: tuple[Any, ...], gripper: int, fixed: tuple[Any, ...], world: tuple[Any, ...],
    point: Array, normal: Array, clearance: float, inside: bool,
) -> int:  # fmt: skip
    """Whether a limb can depart from its grasp on one branch, while all else stands still.

    It moves along the surface normal.

    Args:
        limb: Index of the limb.
        p: Flange position at the grasp in the limb base frame [m], shape (3,).
        x: First axis of the flange in the limb base frame, shape (3,).
        z: Flange axis in the limb base frame, shape (3,).
        away: Surface normal in the limb base frame, shape (3,).
        lift: How far it departs [m].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        branch: Branch label.
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        position: Base position in the world [m], shape (3,).
        rotation: Base rotation in the world, shape (3, 3).
        others: Capsule ends of other limbs in the body frame, one set for each branch, shape (k, c,
            2, 3).
        shapes: `LimbShapes.arrays`.
        gripper: First capsule of the gripper.
        fixed: `LimbShapes.fixed`.
        world: `BoxWorld.arrays`.
        point: The grasp in the world [m], shape (3,).
        normal: Surface normal in the world, shape (3,).
        clearance: Least distance [m].
        inside: Whether the robot's shapes are compared with each other too, not with boxes alone.

    Returns:
        `CLEAR`, `UNDECIDED` (too close for the depth), or the cause.
    """
    count = len(shapes[0])
    ends, world_ends = floats(count, 2, 3), floats(count, 2, 3)
    motion, still = floats(count, 2), zeros(count, 2)
    frames, shift, spin = floats(7, 4, 3), floats(5, 4), floats(5, 7)
    here, q, plus, minus = floats(3), floats(6), floats(6), floats(6)
    stack_s, stack_half = floats(DEPTH + 2), floats(DEPTH + 2)
    stack_q, todo = floats(DEPTH + 2, 2, 6), integers(DEPTH + 2, 3)
    for side in range(2):
        for k in range(3):
            here[k] = p[k] + lift * side * away[k]
        if not branch_angles(here, x, z, lengths, branch, stack_q[0, side]):
            return UNDECIDED
    stack_s[0] = stack_half[0] = 0.5
    todo[0] = EVERY
    top = 1
    shortest = 0.5**DEPTH
    while top > 0:
        top -= 1
        s, half = stack_s[top], stack_half[top]
        boxes, body, limbs = todo[top]
        for k in range(3):
            here[k] = p[k] + lift * s * away[k]
        if not branch_angles(here, x, z, lengths, branch, q):
            return UNDECIDED
        changes(stack_q[top], q, minus, plus)
        joint_motion(plus, minus, lengths, shift, spin)
        frames_of_angles(q, lengths, frames)
        place(frames, shapes, mount_rotation, mount_position, ends)
        capsule_motion(shapes, shift, spin, 1.0, motion)
        if boxes:
            to_world(ends, position, rotation, world_ends)
            answer, boxes = against_boxes(
                world_ends,
                motion,
                boxes,
                count,
                shapes[2],
                world,
                gripper,
                point,
                normal,
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
            answer, limbs = against_branches(ends, motion, limbs, others, still, shapes, clearance)
            if answer > UNDECIDED:
                return answer
        if boxes or (inside and (body or limbs)):
            if half < shortest:
                return UNDECIDED
            top = halve(top, s, half, boxes, body, limbs, stack_s, stack_half, todo)
            share(top, q, stack_q)
    return CLEAR


@kernel
def changes(ends: Array, q: Array, minus: Array, plus: Array) -> None:
    """Changes of joint angles from the middle to both ends, each less than half a turn.

    Args:
        ends: Joint angles at both ends, shape (2, 6) [rad].
        q: Joint angles in the middle, shape (6,) [rad].
        minus: Filled with the changes to the first end, shape (6,) [rad].
        plus: Filled with the changes to the second, shape (6,) [rad].
    """
    for joint in range(6):
        minus[joint], plus[joint] = wrap(ends[0, joint] - q[joint]), wrap(ends[1, joint] - q[joint])


@kernel
def halve(
    top: int, s: float, half: float, boxes: int, body: int, limbs: int, stack_s: Array,
    stack_half: Array, todo: IntArray,
) -> int:  # fmt: skip
    """Put both halves of an interval on the stacks.

    Args:
        top: Number of intervals on the stacks.
        s: Middle of the interval.
        half: Half its length.
        boxes: Bits of what to compare with boxes on the halves.
        body: Bits of what to compare with the body.
        limbs: Bits of what to compare with other limbs.
        stack_s: Middles.
        stack_half: Half lengths.
        todo: Bits, shape (n, 3).

    Returns:
        The new number.
    """
    for side in range(2):
        stack_s[top], stack_half[top] = s + (side - 0.5) * half, 0.5 * half
        todo[top, 0], todo[top, 1], todo[top, 2] = boxes, body, limbs
        top += 1
    return top


@kernel
def share(top: int, q: Array, stack_q: Array) -> None:
    """Joint angles at the ends of the two halves on top of a stack.

    Those of the whole, whose middle has the angles `q`, stand where those of the first half come.
    """
    for joint in range(6):
        stack_q[top - 1, 0, joint], stack_q[top - 1, 1, joint] = (
            q[joint],
            stack_q[top - 2, 1, joint],
        )
        stack_q[top - 2, 1, joint] = q[joint]


@kernel
def against_branches(
    ends: Array, motion: Array, todo: int, others: Array, still: Array, shapes: tuple[Any, ...],
    clearance: float,
) -> tuple[int, int]:  # fmt: skip
    """A limb against another at rest on each of some branches.

    Returns:
        An answer, and the bits of the branches that are undecided.
    """
    undecided = 0
    for k in range(others.shape[0]):
        if todo & bit(k):
            found, _ = against_limb(ends, motion, EVERY, others[k], still, shapes, clearance)
            if found > UNDECIDED:
                return found, undecided
            if found == UNDECIDED:
                undecided |= bit(k)
    return UNDECIDED if undecided else CLEAR, undecided


@kernel
def swing_free(
    limb: int, path: tuple[Any, ...], u0: float, u1: float, q0: Array, q1: Array, lengths: Array,
    mount_rotation: Array, mount_position: Array, others: Array, shapes: tuple[Any, ...],
    fixed: tuple[Any, ...], world: tuple[Any, ...], clearance: float, inside: bool,
    body: tuple[Any, ...],
) -> int:  # fmt: skip
    """Whether a free limb can go from `q0` to `q1` while the base goes from `u0` to `u1` on a path.

    The limb moves on a line in joint space. Limbs that hold are left to `hold_free`, but for those
    at rest in `others`.

    Args:
        limb: Index of the limb.
        path: Base path (t0, r0, t1, r1, kind, pivot).
        u0: Where the base is on it at the start.
        u1: Where it is at the end.
        q0: Joint angles at the start, shape (6,) [rad].
        q1: Joint angles at the end, shape (6,) [rad].
        lengths: d1, a2, a3, d4, d5, d6 [m].
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        others: See `departure_free`.
        shapes: `LimbShapes.arrays`.
        fixed: `LimbShapes.fixed`.
        world: `BoxWorld.arrays`.
        clearance: Least distance [m].
        inside: Whether the robot's shapes are compared with each other too, not with boxes alone.
        body: `LimbShapes.body`, compared with the boxes if the base moves; at rest the stance was.

    Returns:
        `CLEAR`, `UNDECIDED` (too close for the depth), or the cause.
    """
    count = len(shapes[0])
    ends, world_ends = floats(count, 2, 3), floats(count, 2, 3)
    motion, world_motion, still = floats(count, 2), floats(count, 2), zeros(count, 2)
    frames, shift, spin = floats(7, 4, 3), floats(5, 4), floats(5, 7)
    q, plus, minus, axis = floats(6), floats(6), floats(6), floats(3)
    position, rotation = floats(3), floats(3, 3)
    omega = relative_rotation(path[1], path[3], axis)
    speed = path_speed(path) * abs(u1 - u0)
    spin_rate = omega * abs(u1 - u0)
    for k in range(6):
        plus[k] = q1[k] - q0[k]
        minus[k] = -plus[k]
    joint_motion(plus, minus, lengths, shift, spin)
    travel = shift[0, 3] + speed + spin_rate
    pieces = min(max(int(np.ceil(travel / FIRST_INTERVAL)), 1), 1 << DEPTH)
    stack_s, stack_half, todo = floats(DEPTH + 2), floats(DEPTH + 2), integers(DEPTH + 2, 3)
    # The body and the mounts count as one capsule more.
    on_body = bit(count)
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
        s, half = stack_s[top], stack_half[top]
        boxes, robot, limbs = todo[top]
        for k in range(6):
            q[k] = q0[k] + s * plus[k]
        frames_of_angles(q, lengths, frames)
        place(frames, shapes, mount_rotation, mount_position, ends)
        capsule_motion(shapes, shift, spin, half, motion)
        if boxes:
            pose_on_path(path, axis, omega, u0 + s * (u1 - u0), position, rotation)
            to_world(ends, position, rotation, world_ends)
            moved_by_base(ends, motion, speed * half, spin_rate * half, world_motion)
            answer, undecided = against_boxes(
                world_ends,
                world_motion,
                boxes,
                count,
                shapes[2],
                world,
                count,
                position,
                position,
                clearance,
            )
            if answer > UNDECIDED:
                return answer
            if u0 != u1 and boxes & on_body:
                answer = body_against_boxes(
                    position, rotation, speed * half, spin_rate * half, body, world, clearance
                )  # fmt: skip
                if answer > UNDECIDED:
                    return answer
                if answer == UNDECIDED:
                    undecided |= on_body
            boxes = undecided
        if inside and robot:
            answer, robot = against_body(
                limb, ends, motion, robot, shift, spin, half, shapes, fixed, clearance
            )
            if answer > UNDECIDED:
                return answer
        if inside and limbs:
            answer, limbs = against_branches(ends, motion, limbs, others, still, shapes, clearance)
            if answer > UNDECIDED:
                return answer
        if boxes or (inside and (robot or limbs)):
            if half < shortest:
                return UNDECIDED
            top = halve(top, s, half, boxes, robot, limbs, stack_s, stack_half, todo)
    return CLEAR
