"""Arithmetic of a limb at a grasp: windings, and joint angles above the point (compiled)."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.collisions.limb_shapes import Limb, Robot
from mlivr_gym.compiled.bit_sets import BRANCHES, EMPTY, both_flips, has_branch
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.kinematics.arm import Arm
from mlivr_gym.kinematics.families import branch_angles
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.limb import Angles, flange_seen, wrap
from mlivr_gym.kinematics.poses import Pose, along
from mlivr_gym.transitions.records import StepRoom


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
def fold_nearest_to(robot: Robot, fold: int, arm: Arm, reference: Angles, to: Angles) -> bool:
    """A fold on the windings nearest to `reference`, into `to`; whether it lies inside the limits.

    Joint 6 is as in `reference`.
    """
    inside, q, out, limits = True, reference.q, to.q, arm.limits
    out[5] = q[5]
    for joint in range(5):
        angle = robot.folds[fold, joint]
        out[joint] = nearest_turn(angle, q[joint], limits[joint, 0], limits[joint, 1])
        inside = inside and out[joint] == out[joint]
    return inside


@kernel
def line_end(first: Angles, last: Angles, arm: Arm, to: Angles) -> float:
    """Where a line in joint space ends, on the windings nearest to its start.

    Joint 6 goes to the nearest half turn: a grasp is the same with the tool turned by it.

    Args:
        first: Joint angles at the start.
        last: Joint angles at the end up to whole turns.
        arm: The arm, with its limits.
        to: Filled with the angles at the end; it may be `last`.

    Returns:
        The length of the line, the largest of the turns of joints 1 to 5 [rad]; inf if it ends
        outside the limits.
    """
    length, q0, q1, out, limits = 0.0, first.q, last.q, to.q, arm.limits
    for joint in range(5):
        out[joint] = nearest_turn(q1[joint], q0[joint], limits[joint, 0], limits[joint, 1])
        length = max(length, abs(out[joint] - q0[joint]))
        if out[joint] != out[joint]:
            return np.inf
    out[5] = q0[5] + 0.5 * wrap(2.0 * (q1[5] - q0[5]))
    return length if limits[5, 0] <= out[5] <= limits[5, 1] else np.inf


@kernel
def lifted_angles(
    limb: Limb, base: Pose, grasp: Grasp, branch: int, lift: float, to: Angles
) -> bool:
    """Joint angles of a limb that has departed from a grasp, on the windings nearest to zero.

    Args:
        limb: The limb.
        base: Base in the world.
        grasp: The grasp.
        branch: Branch label.
        lift: How far it has departed [m].
        to: Filled; NaN where no winding lies inside the limits.

    Returns:
        Whether the branch exists there.
    """
    q = to.q
    p, x, z = flange_seen(limb, base, grasp.flange)
    if not branch_angles(limb.arm, along(p, -lift, z), x, z, branch, 0.0, q):
        return False
    limits = limb.arm.limits
    for joint in range(6):
        q[joint] = nearest_turn(q[joint], 0.0, limits[joint, 0], limits[joint, 1])
    return True


@kernel
def lifted_branches(
    robot: Robot, limb: Limb, base: Pose, grasp: Grasp, mask: int, side: int, room: StepRoom
) -> int:
    """Joint angles of a limb that has departed from a grasp, on each branch of a mask.

    They are written into `room.q[side]`, on the windings nearest to zero.

    Args:
        robot: The robot.
        limb: The limb.
        base: Base in the world.
        grasp: The grasp.
        mask: Branches and flips.
        side: 0 before a step, 1 after it.
        room: Scratch.

    Returns:
        The branches and flips of the mask that exist there.
    """
    found = EMPTY
    for b in range(BRANCHES):
        q = room.q[side, b]
        if has_branch(mask, b) and lifted_angles(limb, base, grasp, b, robot.lift, q):
            found |= both_flips(b)
    return found & mask


@entry
def fold_of_limb(robots: Any, i: int, fold: int, reference: Angles, to: Angles) -> bool:
    """`fold_nearest_to` of limb `i` of a row of `Robot`, shape (1,)."""
    return fold_nearest_to(robots[0], fold, robots[0].limbs[i].arm, reference, to)


@entry
def line_of_limb(robots: Any, i: int, first: Angles, last: Angles, to: Angles) -> float:
    """`line_end` of limb `i` of a row of `Robot`, shape (1,)."""
    return line_end(first, last, robots[0].limbs[i].arm, to)


@entry
def angles_above(robots: Any, i: int, base: Pose, grasp: Grasp, branch: int, to: Angles) -> bool:
    """`lifted_angles` of limb `i` of a row of `Robot`, shape (1,)."""
    return lifted_angles(robots[0].limbs[i], base, grasp, branch, robots[0].lift, to)
