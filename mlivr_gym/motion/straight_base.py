"""The way of the base during a step: knots of supports by inverse kinematics.

The base moves on the straight way on which the step was checked, and the support limbs follow on
their branches. How far a line between two knots is from the motion that was checked is measured in
its middle, by the joint angles there: a turn of a joint moves a part by no more than its distance
from the axis. By how much the grippers of supports slip there is measured by forward kinematics.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.base_path import BasePath, base_path, base_rows
from mlivr_gym.collisions.joint_lines import JointLine
from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.compiled.scratch import ScratchPool
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.limb import Angles, held_angles, joints_along
from mlivr_gym.kinematics.poses import pose, poses
from mlivr_gym.motion.joint_path import CUBIC, HOLD_TOLERANCE, JointPath, control_places
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.steps import KEPT_CLEAR, line_clear

FEWEST_PIECES, MOST_PIECES = 8, 4096
"""Fewest and most pieces of the spline of a segment while the base moves."""

LINES = ScratchPool(LineScratch)
"""Scratch of `line_clear`, which takes what it does not set to be empty."""

JointCurve = Callable[[Array], Array]
"""Joint angles of all limbs, shape (k, N, 6) [rad], at k path parameters from 0 to 1."""


class FollowingSupports:
    """Support limbs that follow the base on its straight way while one limb swings."""

    def __init__(self, graph: StanceGraph, ends: StepEnds) -> None:
        """Prepare a step with given ends."""
        self._graph, self._ends, self._path = graph, ends, path_of(ends)
        self._robots, self._world = graph.checks.robots, graph.checks.world(graph.obstacle_grid)
        self._line = line = JointLine.row()
        self._first, self._last = line["first"]["q"], line["last"]["q"]
        self._moved: tuple[float, float] | None = None
        out = Angles.rows(1, graph.limbs)
        base, branches = poses(ends.positions[:1], ends.rotations[:1]), np.array([ends.branches])
        grasps = graph.solver.grasps[list(ends.before)][None]
        held_angles(self._robots, base, grasps, branches[:, : graph.limbs].copy(), out)
        for limb, point in enumerate(ends.after):
            if limb != ends.limb:
                is_turned = np.cos(out["q"][0, limb, 5] - ends.joints[0, limb, 5]) < 0.0
                line["follows"] |= 1 << limb
                line["held"][limb] = graph.solver.grasps[point]["flange"]
                line["branch"][limb] = ends.branches[limb]
                line["flips"][limb] = 1 << int(is_turned)

    def is_clear(self, a: Array, b: Array) -> bool:
        """Return whether the robot keeps the clearance on the line between two swing knots."""
        if self._moved != (a[0], b[0]):
            self._move_base(float(a[0]), float(b[0]))
        limb = self._ends.limb
        self._first[limb], self._last[limb] = a[1:], b[1:]
        with LINES.borrowed() as rows:
            lines = rows(1)
            lines[0]["line"] = self._line
            return bool(line_clear(limb, self._robots, self._world, lines))

    def _move_base(self, s: float, to: float) -> None:
        """Let the base move from one of its places to another, or rest before or after it moves."""
        line, ends, self._moved = self._line, self._ends, (s, to)
        line["moves"] = s != to
        if s != to:
            line["path"] = self._path_between(s, to)
        else:
            side = int(s)
            line["base"] = pose(ends.positions[side], ends.rotations[side])
            for angles in (self._first, self._last):
                angles[: len(ends.joints[side])] = ends.joints[side]

    def _path_between(self, s: float, to: float) -> BasePath:
        """Return the way of the base from one of its places to another."""
        if (s, to) == (0.0, 1.0):
            return self._path
        return base_path(*base_rows(self._path, np.array([s, to])))

    def knots(self, a: Array, b: Array, here: Array) -> Array:
        """Return the knots from one swing knot to the next, shape (k, N, 6) [rad].

        Joint angles at the first have shape (N, 6). Raises a `PlanError` if a support cannot follow
        the base.
        """
        limb = self._ends.limb
        if a[0] == b[0]:
            joints = np.stack([here, here])
            joints[:, limb] = a[1:], b[1:]
            return joints
        path = self._path_between(float(a[0]), float(b[0]))

        def curve(places: Array) -> Array:
            joints = support_joints(self._graph, self._ends, path, places, here)
            joints[:, limb] = a[1:] + places[:, None] * (b[1:] - a[1:])
            return joints

        return dense_knots(self._graph.robot, self._ends, curve, KEPT_CLEAR)


def path_of(ends: StepEnds) -> BasePath:
    """Return the way of the base during a step as a record for compiled code."""
    first, last = map(pose, ends.positions, ends.rotations)
    return base_path(first, last)


def dense_knots(robot: RobotSpec, ends: StepEnds, curve: JointCurve, tolerance: float) -> Array:
    """Return knots of a motion, shape (k, N, 6) [rad], so dense that their spline is close to it.

    They are the control points of the spline where these count most (`control_places`). In the
    middles between them lines are off by no more than is allowed, `tolerance` [m] for any part of
    the robot. Raises a `PlanError` if `MOST_PIECES` are too few for that.
    """
    leader, pieces = int(ends.limb == 0), FEWEST_PIECES
    still = JointPath(
        robot, ends.limb, leader, ends.positions[0], ends.rotations[0], ends.joints[:1], (0,)
    )
    radii = lever_arms(robot, leader)
    others = [limb for limb in range(robot.limbs) if limb != leader]
    while True:
        joints = curve(_places_and_middles(pieces))
        lines = 0.5 * (joints[2::2] + joints[:-2:2])
        moved = np.einsum("kij,ij->ki", np.abs(lines - joints[1::2]), radii)
        # What a limb does comes on top of where the leader puts the base, or of another limb.
        most = np.sort(moved[:, others], axis=1)[:, ::-1]
        far = most[:, 0] + np.maximum(moved[:, leader], most[:, 1:2].sum(axis=1))
        # The spline is off by up to 4 / 3 of what lines are.
        off = 4.0 / 3.0 * float(far.max()) / tolerance
        off = max(off, float(still.slips(lines).max()) / (0.5 * HOLD_TOLERANCE))
        if off <= 1.0:
            return joints[::2]
        if pieces == MOST_PIECES:
            raise PlanError(f"{MOST_PIECES} knots are too few for the motion that was checked")
        pieces = min(MOST_PIECES, int(np.ceil(1.05 * pieces * np.sqrt(off))))


@lru_cache(maxsize=512)
def _places_and_middles(pieces: int) -> Array:
    """Return the places of the control points of a spline of some pieces, and between them."""
    places = control_places(pieces + CUBIC)
    every: Array = np.sort(np.append(places, 0.5 * (places[1:] + places[:-1])))
    return every


def support_joints(
    graph: StanceGraph, ends: StepEnds, path: BasePath, s: Array, here: Array
) -> Array:
    """Return joint angles while the base moves, at base parameters s, shape (k, N, 6) [rad].

    The base parameters, shape (k,), rise from 0 before the base moves to 1 after it; `here`, shape
    (N, 6), are joint angles at the first. The support limbs hold their points on their branches;
    the moving limb stays as it is. Raises a `PlanError` if a support limb cannot follow the base.
    """
    bases, joints = base_rows(path, s), np.empty((len(s), *here.shape))
    joints[:, ends.limb] = here[ends.limb]
    for limb, point in enumerate(ends.before):
        if limb != ends.limb:
            held = graph.solver.grasps[point : point + 1]["flange"].copy()
            one = Follower(limb, ends.branches[limb], here[limb])
            joints[:, limb] = follow(graph, ends, one, held, bases)
    return joints


class Follower(NamedTuple):
    """A limb on a branch, and joint angles from which on it is followed, shape (6,) [rad]."""

    limb: int
    branch: int
    joints: Array


def follow(
    graph: StanceGraph,
    ends: StepEnds,
    one: Follower,
    flanges: Any,
    bases: Any,
) -> Array:
    """Return joint angles of a limb on its branch along flange and base poses, (k, 6) [rad].

    The poses are rows of `Pose`. Raises a `PlanError` if the branch ends.
    """
    robots = graph.checks.robots
    joints = joints_along(robots, one.limb, bases, flanges, one.branch, one.joints)
    if len(joints) < max(len(bases), len(flanges)):
        target = graph.grasp_map.ids[ends.to_point]
        raise PlanError(
            f"limb {one.limb} cannot stay on its branch while limb {ends.limb} moves to "
            f"{target!r}: the plan does not fit this map and robot, or its steps were not checked"
        )
    return joints


@lru_cache(maxsize=16)
def lever_arms(robot: RobotSpec, leader: int) -> Array:
    """Return how far a turn of each joint moves a part of the robot at most, (N, 6) [m/rad].

    The leader's joints turn the rest of the robot, as far from the body's middle as any part may
    be; those of other limbs what lies between them and their grippers.
    """
    out = np.empty((robot.limbs, 6))
    for limb, arm in enumerate(robot.every_limb):
        steps = np.linalg.norm(arm.steps[:, :3, 3], axis=1)
        if limb == leader:
            mount = float(np.linalg.norm(robot.mount_positions[limb]))
            out[limb] = steps.cumsum() + mount + robot.extent
        else:
            out[limb] = steps[::-1].cumsum()[::-1] - steps + robot.tool_length
    return out
