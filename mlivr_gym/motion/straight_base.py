"""The way of the base during a step: knots of supports by inverse kinematics.

The base moves on the straight way on which the step was checked, and the support limbs follow on
their branches. How far a line between two knots is from the motion that was checked is measured in
its middle, by the joint angles there: a turn of a joint moves a part by no more than its distance
from the axis. By how much the grippers of supports slip there is measured by forward kinematics.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.base_path import BasePath, base_path, base_rows
from mlivr_gym.collisions.joint_lines import JointLine
from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.compiled.scratch import ScratchPool
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.limb import Angles, held_angles
from mlivr_gym.kinematics.poses import pose, poses
from mlivr_gym.motion.dense_knots import Spread, fill_knots
from mlivr_gym.motion.joint_path import CUBIC, GRIP_RADIUS, HOLD_TOLERANCE, control_places
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.steps import KEPT_CLEAR, line_clear

FEWEST_PIECES, MOST_PIECES = 8, 4096
"""Fewest and most pieces of the spline of a segment while the base moves."""

LINES = ScratchPool(LineScratch)
"""Scratch of `line_clear`, which takes what it does not set to be empty."""

MeasuredMotion = Callable[[Array], tuple[Array, float]]
"""Joint angles of all limbs at k path parameters from 0 to 1, shape (k, N, 6) [rad], k odd; and how
far lines between every other of them are off in between, as a share of what is allowed."""


class FollowingSupports:
    """Support limbs that follow the base on its straight way while one limb swings."""

    def __init__(self, graph: StanceGraph, ends: StepEnds) -> None:
        """Prepare a step with given ends."""
        self._graph, self._ends, self._path = graph, ends, path_of(ends)
        self._robots, self._world = graph.checks.robots, graph.checks.world(graph.obstacle_grid)
        self._line = line = JointLine.row()
        self._first, self._last = line["first"]["q"], line["last"]["q"]
        self._moved: tuple[float, float] | None = None
        self._spread = spread_of(graph.robot, ends.limb)
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
        if (s, to) == (0.0, 1.0):
            line["path"] = self._path
        elif s != to:
            line["path"] = base_path(*base_rows(self._path, np.array([s, to])))
        else:
            side = int(s)
            line["base"] = pose(ends.positions[side], ends.rotations[side])
            for angles in (self._first, self._last):
                angles[: len(ends.joints[side])] = ends.joints[side]

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
        self._move_base(float(a[0]), float(b[0]))
        line = self._line.copy()
        line["first"]["q"][: len(here)] = here
        line["first"]["q"][limb], line["last"]["q"][limb] = a[1:], b[1:]

        def measured(places: Array) -> tuple[Array, float]:
            joints, spread = Angles.rows(len(places), len(here)), self._spread
            stopped = fill_knots(self._robots, line, places, joints, spread)
            if stopped >= 0:
                raise cannot_follow(self._graph, self._ends, stopped)
            far, slip = float(spread[0]["far"]), float(spread[0]["slip"])
            return joints["q"], share_used(far, slip, KEPT_CLEAR)

        return enough_knots(measured)


def path_of(ends: StepEnds) -> BasePath:
    """Return the way of the base during a step as a record for compiled code."""
    first, last = map(pose, ends.positions, ends.rotations)
    return base_path(first, last)


def enough_knots(measured: MeasuredMotion) -> Array:
    """Return knots of a motion, shape (k, N, 6) [rad], so dense that their spline is close to it.

    They are the control points of the spline where these count most (`control_places`). In the
    middles between them lines are off by no more than is allowed. Raises a `PlanError` if
    `MOST_PIECES` are too few for that.
    """
    pieces = FEWEST_PIECES
    while True:
        joints, off = measured(_places_and_middles(pieces))
        if off <= 1.0:
            return joints[::2]
        if pieces == MOST_PIECES:
            raise PlanError(f"{MOST_PIECES} knots are too few for the motion that was checked")
        pieces = min(MOST_PIECES, int(np.ceil(1.05 * pieces * np.sqrt(off))))


def share_used(far: float, slip: float, tolerance: float) -> float:
    """Return how far lines are off, as a share of what is allowed.

    `far` is how far they move a part of the robot off the motion, of which `tolerance` is allowed,
    and `slip` how far they move a support limb [m].
    """
    # The spline is off by up to 4 / 3 of what lines are.
    return max(4.0 / 3.0 * far / tolerance, slip / (0.5 * HOLD_TOLERANCE))


@lru_cache(maxsize=512)
def _places_and_middles(pieces: int) -> Array:
    """Return the places of the control points of a spline of some pieces, and between them."""
    places = control_places(pieces + CUBIC)
    every: Array = np.sort(np.append(places, 0.5 * (places[1:] + places[:-1])))
    return every


def cannot_follow(graph: StanceGraph, ends: StepEnds, limb: int) -> PlanError:
    """Return the error that a limb cannot stay on its branch during a step."""
    target = graph.grasp_map.ids[ends.to_point]
    return PlanError(
        f"limb {limb} cannot stay on its branch while limb {ends.limb} moves to {target!r}: the "
        "plan does not fit this map and robot, or its steps were not checked"
    )


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


def spread_of(robot: RobotSpec, limb: int) -> Any:
    """Return a row of `Spread` for motions of a limb."""
    leader, spread = int(limb == 0), Spread.rows(1)
    spread["limb"], spread["leader"] = limb, leader
    spread["tool"], spread["grip"] = robot.tool_length, GRIP_RADIUS
    spread["lever"]["q"][0, : robot.limbs] = lever_arms(robot, leader)
    return spread
