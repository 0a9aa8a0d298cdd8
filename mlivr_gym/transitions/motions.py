"""Motions of a step, which `collisions.sweep` checks (compiled)."""

from __future__ import annotations

from typing import Any

from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.collisions.motion import DEPARTS, HOLDS, SWINGS, LimbMotion, SweepScratch
from mlivr_gym.collisions.sweep import sweep
from mlivr_gym.compiled.bit_sets import NO, YES
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.compiled.records import Record
from mlivr_gym.kinematics.base_path import BasePath, set_path
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import vector
from mlivr_gym.transitions.records import WorldRecord


class SwingCurve(Record):
    """A line in joint space while the base follows part of its path, or a rounded corner."""

    path: BasePath
    """Base path."""
    begin: float
    """Parameter of the base path at the start."""
    turning: float
    """Parameter at the corner."""
    finish: float
    """Parameter at the end."""
    rounded: bool
    """Whether it rounds a corner, see `collisions.sweep`."""
    limb: int
    """Limb that swings."""
    start: Angles
    """Its joint angles at the start."""
    corner: Angles
    """Its joint angles at the corner."""
    end: Angles
    """Its joint angles at the end."""


class SupportRecord(Record):
    """A support limb during a swing."""

    limb: int
    """Index of the limb."""
    point: int
    """Point that it holds."""
    branch: int
    """Branch that it is on."""


@kernel
def set_base_motion(scratch: SweepScratch, path: BasePath, begin: float, finish: float) -> None:
    """Set the base motion, from `begin` to `finish` on a path, with limbs that swing in lines."""
    motion = scratch.motion
    motion.rounded = False
    set_path(motion.path, path.first, path.last, path.kind, vector(path.pivot))
    motion.begin, motion.finish = begin, finish


@kernel
def set_swing(motion: LimbMotion, limb: int, start: Angles, end: Angles) -> None:
    """Set a limb motion to a line in joint space."""
    motion.limb, motion.kind = limb, SWINGS
    for joint in range(6):
        motion.start[joint], motion.end[joint] = start.q[joint], end.q[joint]


@kernel
def set_corner(scratch: SweepScratch, curve: SwingCurve) -> None:
    """Set base and swing limbs to round a corner."""
    motion = scratch.motion
    motion.rounded, motion.corner = True, curve.turning
    for joint in range(6):
        motion.first.corner[joint] = motion.second.corner[joint] = curve.corner.q[joint]


@kernel
def set_support(motion: LimbMotion, limb: int, branch: int, grasp: Grasp) -> None:
    """Set a limb motion to holding a grasp on a branch."""
    motion.limb, motion.kind, motion.branch = limb, HOLDS, branch
    _set_flange(motion, grasp)


@kernel
def set_departure(motion: LimbMotion, limb: int, branch: int, grasp: Grasp) -> None:
    """Set a limb motion to departing from a grasp on a branch."""
    motion.limb, motion.kind, motion.branch = limb, DEPARTS, branch
    _set_flange(motion, grasp)


@kernel
def _set_flange(motion: LimbMotion, grasp: Grasp) -> None:
    """Set the flange of a limb motion to that of a limb at a grasp."""
    for k in range(3):
        motion.flange.position[k] = grasp.flange.position[k]
        for axis in range(3):
            motion.flange.rotation[k, axis] = grasp.flange.rotation[k, axis]


@kernel
def compare_with(
    scratch: SweepScratch, boxes: bool, body: bool, resting: bool, meeting: bool
) -> None:
    """Select the shapes with which the first limb is compared; it is at no grasp."""
    motion = scratch.motion
    motion.boxes, motion.body, motion.resting, motion.meeting = boxes, body, resting, meeting
    scratch.surface.applies = False


@part
def is_clear(robot: RobotModel, world: WorldRecord, layer: int, scratch: SweepScratch) -> bool:
    """Return whether the motion in `scratch` keeps the clearance in a layer of the world.

    Layer 0 has the boxes of the map, layer 1 the obstacles.
    """
    grid = world.boxes if layer == 0 else world.obstacles
    return sweep(robot, grid, world.thresholds[0].clearance, scratch) == CLEAR


@kernel
def swing_clear(
    robot: RobotModel,
    world: WorldRecord,
    layer: int,
    limb: int,
    start: Angles,
    end: Angles,
    scratch: SweepScratch,
) -> bool:
    """Return whether a limb can swing along a line while the base follows the motion in `scratch`.

    It is not compared with support limbs, but with the limbs at rest in `scratch`.
    """
    inside = layer == 0
    set_swing(scratch.motion.first, limb, start, end)
    set_swing(scratch.motion.second, limb, start, end)
    compare_with(scratch, YES, inside, inside, NO)
    return is_clear(robot, world, layer, scratch)


@entry
def curve_clear(
    curves: Any, supports: Any, robots: Any, world: WorldRecord, scratch_rows: Any
) -> bool:
    """Return whether the robot keeps the clearance along one line or rounded corner of a swing.

    `curves` is a row of `SwingCurve`, `robots` one of `RobotModel`, `scratch_rows` one of
    `SweepScratch`; `supports` are rows of `SupportRecord`.
    """
    curve, robot, scratch = curves[0], robots[0], scratch_rows[0]
    scratch.resting.count = 0
    set_base_motion(scratch, curve.path, curve.begin, curve.finish)
    if curve.rounded:
        set_corner(scratch, curve)
    for layer in range(world.first, world.stop):
        if not swing_clear(robot, world, layer, curve.limb, curve.start, curve.end, scratch):
            return False
        inside = layer == 0
        for k in range(len(supports)):
            support = supports[k]
            set_support(
                scratch.motion.first, support.limb, support.branch, world.grasps[support.point]
            )
            set_swing(scratch.motion.second, curve.limb, curve.start, curve.end)
            compare_with(scratch, YES, inside, NO, inside)
            if not is_clear(robot, world, layer, scratch):
                return False
    return True
