"""Checks of stationary postures against boxes (compiled)."""

from __future__ import annotations

from typing import Any, NamedTuple

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.collisions.against_boxes import (
    GraspSurface,
    compare_base_with_boxes,
    compare_limb_with_boxes,
    compare_with_grid,
    set_grasp_surface,
)
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.joint_lines import BaseMove
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.collisions.placement import Placed, capsule_axis, place
from mlivr_gym.compiled.bit_sets import BRANCHES, below, has_branch, without_branch
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Record
from mlivr_gym.kinematics.inverse import branch_frames
from mlivr_gym.kinematics.limb import flange_seen
from mlivr_gym.kinematics.poses import along, dot, minus, vector


class Surroundings(NamedTuple):
    """The graspable points and boxes in the world."""

    grasps: Any
    """Graspable points, records of `Grasp`, shape (m,)."""
    grid: BoxGrid
    """The boxes."""
    clearance: float
    """Clearance that shapes must keep [m]."""


class CheckedPostures(NamedTuple):
    """Postures of k stances that are checked against boxes."""

    points: IntArray
    """Point of each limb, shape (k, N)."""
    first: IntArray
    """Limb from which on they are checked, the last that touches a box tells why, shape (k,)."""
    base: Any
    """Base poses in the world, records of `Pose`, shape (k,)."""
    branch: IntArray
    """Branch of each limb in the posture, shape (k, N)."""
    branch_sets: IntArray
    """Branch set of branches and flips of each limb, shape (k, N); updated."""
    cause: IntArray
    """Cause of a collision on a branch of the posture, shape (k,); updated."""
    all_branches: BoolArray
    """Whether all branches are checked and removed from the branch sets, shape (1,)."""


class QueryScratch(Record):
    """Scratch for a check."""

    placed: Placed
    """The limb that is checked."""
    surface: GraspSurface
    """The grasp at which the gripper is."""
    move: BaseMove
    """The base, which rests."""


@entry
def check_points(
    robots: Any, surroundings: Surroundings, scratch_rows: Any, causes: IntArray
) -> None:
    """Check for each of m points whether a limb that holds it touches a box at its flange axis.

    The capsules on that axis do not depend on the posture. `robots` is a record of `RobotModel` and
    `scratch_rows` one of `QueryScratch`, shape (1,); `causes`, shape (m,), is filled with the cause
    of the collision, or `CLEAR`.
    """
    robot, scratch = robots[0], scratch_rows[0]
    limb = robot.limbs[0]
    for m in range(len(causes)):
        grasp = surroundings.grasps[m]
        set_grasp_surface(scratch.surface, vector(grasp.point), vector(grasp.normal))
        causes[m] = CLEAR
        for c in range(limb.first_on_axis, limb.capsule_count):
            capsule = limb.capsules[c]
            a, b = capsule_axis(capsule.ends)
            # Coordinates along the flange axis from the flange, in whose frame link 6 lies.
            at_a, at_b = a[2], b[2]
            if capsule.link != 6:
                tip, out = vector(limb.arm.steps[5, 0]), vector(limb.arm.steps[5, 3])
                at_a, at_b = dot(minus(a, tip), out), dot(minus(b, tip), out)
            point, normal = vector(grasp.point), vector(grasp.normal)
            axis = (
                along(point, robot.tool_length - at_a, normal),
                along(point, robot.tool_length - at_b, normal),
            )
            inner, at_grasp = capsule.radius + surroundings.clearance, c >= limb.gripper
            result = compare_with_grid(
                axis, inner, (0.0, 0.0), surroundings.grid, scratch.surface, at_grasp
            )
            if result != CLEAR:
                causes[m] = result
                break


@entry
def remove_touching_branches(
    start: int,
    stop: int,
    chosen: IntArray,
    postures: CheckedPostures,
    robots: Any,
    surroundings: Surroundings,
    scratch_rows: Any,
) -> None:
    """Remove the branches that touch a box from the postures `chosen[start:stop]`.

    `robots` is a record of `RobotModel` and `scratch_rows` a record of `QueryScratch`, shape (1,).
    """
    robot, scratch, remove = robots[0], scratch_rows[0], postures.all_branches[0]
    for n in range(start, stop):
        k = chosen[n]
        grid, clearance = surroundings.grid, surroundings.clearance
        base = postures.base[k]
        result = compare_base_with_boxes(
            robot, base, scratch.move, 0.0, grid, clearance, scratch.surface
        )
        if result != CLEAR:
            postures.cause[k] = result
            for i in range(robot.limb_count):
                if remove:
                    postures.branch_sets[k, i] = 0
            continue
        for later in range(robot.limb_count):
            i = (postures.first[k] + later) % robot.limb_count
            for b in range(BRANCHES):
                in_posture = b == postures.branch[k, i]
                if not in_posture and not (remove and has_branch(postures.branch_sets[k, i], b)):
                    continue
                result = _check_branch(k, i, b, postures, robot, surroundings, scratch)
                if result != CLEAR:
                    if remove:
                        postures.branch_sets[k, i] = without_branch(postures.branch_sets[k, i], b)
                    if in_posture:
                        postures.cause[k] = result


@kernel
def _check_branch(
    k: int,
    i: int,
    b: int,
    postures: CheckedPostures,
    robot: RobotModel,
    surroundings: Surroundings,
    scratch: QueryScratch,
) -> int:
    """Compare limb `i` on branch `b` of posture `k` with the boxes, except on the flange axis."""
    limb, placed, grasp = robot.limbs[i], scratch.placed, surroundings.grasps[postures.points[k, i]]
    base = postures.base[k]
    seen, _ = flange_seen(limb, base, grasp.flange)
    if not branch_frames(limb.arm, seen, b, placed.frames):
        return CLEAR + 1
    shapes, pending = placed.in_body, below(limb.first_on_axis)
    place(limb, pending, placed.frames, shapes.ends)
    set_grasp_surface(scratch.surface, vector(grasp.point), vector(grasp.normal))
    result, _ = compare_limb_with_boxes(
        limb,
        shapes.ends,
        shapes.motion,
        base,
        pending,
        surroundings.grid,
        surroundings.clearance,
        scratch.surface,
    )
    return result
