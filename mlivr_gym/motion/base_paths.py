"""The way of the base of three limbs and more: knots of supports by inverse kinematics.

The base moves on the straight line or the arc on which the step was checked, and the support limbs
follow on their branches. How far a line between two knots is from the motion that was checked is
measured in its middle, by the joint angles there: a turn of a joint moves nothing farther from its
axis than the arm is long. By how much the grippers of supports slip there is measured by forward
kinematics.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.motion import SweepScratch
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.base_path import BasePath, base_path, base_poses
from mlivr_gym.kinematics.holding import joints_along
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import pose, poses
from mlivr_gym.motion.joint_path import CUBIC, HOLD_TOLERANCE, JointPath, control_places
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions import motions
from mlivr_gym.transitions.edge import Edge

WINDING_SAMPLES = 65
"""Base poses from which support limbs are followed up to the first one asked for."""

SWING_TOLERANCE = 1e-3
"""How far a line may move any limb or the base off the motion that was checked [m]."""

FEWEST_PIECES, MOST_PIECES = 8, 512
"""Fewest and most pieces of the spline of a segment while the base moves."""

JointCurve = Callable[[Array], Array]
"""Joint angles of all limbs, shape (k, N, 6) [rad], at k path parameters from 0 to 1."""


class SupportsOnPath:
    """Support limbs that follow the base on its path; see `swings.Supports`."""

    def __init__(self, graph: StanceGraph, ends: StepEnds, edge: Edge) -> None:
        """Prepare a step with given ends on the base path of its edge."""
        self._graph, self._ends = graph, ends
        self._path = path_of(graph, ends, edge.path_kind)
        self._robots, self._world = graph.checks.robots, graph.checks.world(graph.obstacle_grid)
        supports = [limb for limb in range(graph.limbs) if limb != ends.limb]
        self._rows = motions.SupportRecord.rows(len(supports))
        for row, limb in zip(self._rows, supports, strict=True):
            row["limb"], row["point"], row["branch"] = limb, ends.after[limb], ends.branches[limb]
        self._curves, self._scratch = motions.SwingCurve.rows(1), SweepScratch.rows(1)
        self._curves["path"], self._curves["limb"] = self._path, ends.limb

    def is_clear(self, a: Array, b: Array) -> bool:
        """Return whether the robot keeps the clearance on the line between two swing knots."""
        curve = self._curves[0]
        curve["begin"], curve["finish"] = a[0], b[0]
        curve["start"]["q"], curve["end"]["q"] = a[1:], b[1:]
        return bool(
            motions.curve_clear(self._curves, self._rows, self._robots, self._world, self._scratch)
        )

    def knots(self, a: Array, b: Array) -> Array:
        """Return the knots from one swing knot to the next, shape (k, N, 6) [rad]."""

        def curve(sigma: Array) -> Array:
            rows = a + sigma[:, None] * (b - a)
            joints = support_joints(self._graph, self._ends, self._path, rows[:, 0])
            joints[:, self._ends.limb] = rows[:, 1:]
            return joints

        if a[0] == b[0]:
            return curve(np.array([0.0, 1.0]))
        return dense_knots(self._graph.robot, self._ends, curve)


def path_of(graph: StanceGraph, ends: StepEnds, kind: int) -> BasePath:
    """Return the base path of a step as a record for compiled code."""
    first, last = map(pose, ends.positions, ends.rotations)
    return base_path(first, last, kind, graph.pivot(ends.before, ends.after))


def support_joints(graph: StanceGraph, ends: StepEnds, path: BasePath, s: Array) -> Array:
    """Return joint angles while the base moves, at base parameters s, shape (k, N, 6) [rad].

    The base parameters, shape (k,), rise from 0 before the base moves to 1 after it. The support
    limbs hold their points on their branches; the moving limb is as it is before the step. Raises a
    `PlanError` if a support limb cannot follow the base.
    """
    # Windings are known where the base has not moved.
    lead_in = np.linspace(0.0, s[0], WINDING_SAMPLES if s[0] > 0.0 else 1)
    base = base_poses(path, np.concatenate([lead_in, s]))
    joints = np.tile(ends.joints[0], (len(s), 1, 1))
    for limb, point in enumerate(ends.before):
        if limb != ends.limb:
            flange = graph.solver.grasps[point]["flange"]
            held = flange["position"][None], flange["rotation"][None]
            one = Follower(limb, ends.branches[limb], ends.joints[0, limb])
            joints[:, limb] = follow(graph, ends, one, held, base)[len(lead_in) :]
    return joints


def dense_knots(
    robot: RobotSpec, ends: StepEnds, curve: JointCurve, tolerance: float = SWING_TOLERANCE
) -> Array:
    """Return knots of a motion, shape (k, N, 6) [rad], so dense that lines between them are close.

    They are the control points of its spline at equal distances; lines are within `tolerance` [m].
    """
    rest = JointPath(
        robot, ends.limb, int(ends.limb == 0), ends.positions[0], ends.rotations[0],
        ends.joints[:1], (0,),
    )  # fmt: skip
    radii, pieces = lever_arms(robot, ends.limb) / tolerance, FEWEST_PIECES
    while True:
        places = control_places(pieces + CUBIC)
        joints = curve(np.sort(np.append(places, 0.5 * (places[1:] + places[:-1]))))
        knots, lines = joints[::2], 0.5 * (joints[2::2] + joints[:-2:2])
        far = (np.abs(lines - joints[1::2]) * radii).sum(axis=-1).max()
        # On the spline grippers slip by up to 4 / 3 of what they do on lines.
        off = max(float(far), float(rest.slips(lines).max()) / (0.5 * HOLD_TOLERANCE))
        if off <= 1.0 or pieces == MOST_PIECES:
            return knots
        pieces = min(MOST_PIECES, int(np.ceil(1.05 * pieces * np.sqrt(off))))


class Follower(NamedTuple):
    """A limb on a branch, and joint angles from which on it is followed, shape (6,) [rad]."""

    limb: int
    branch: int
    joints: Array


def follow(
    graph: StanceGraph,
    ends: StepEnds,
    one: Follower,
    flange: tuple[Array, Array],
    base: tuple[Array, Array],
) -> Array:
    """Return joint angles of a limb on its branch along flange and base poses, (k, 6) [rad].

    Raises a `PlanError` if the branch ends.
    """
    bases, flanges, robots = poses(*base), poses(*flange), graph.checks.robots
    out, reference = Angles.rows(max(len(bases), len(flanges))), Angles.row()
    reference["q"] = one.joints
    if joints_along(robots, one.limb, bases, flanges, one.branch, reference, out) < len(out):
        target = graph.grasp_map.ids[ends.to_point]
        raise PlanError(
            f"limb {one.limb} cannot stay on its branch while limb {ends.limb} moves to "
            f"{target!r}: the plan does not fit this map and robot, or its steps were not checked"
        )
    joints: Array = out["q"]
    return joints


@lru_cache(maxsize=16)
def lever_arms(robot: RobotSpec, moving: int) -> Array:
    """Return how far a turn of each joint moves the robot at most, shape (N, 6) [m/rad].

    The moving limb's joints turn what lies between them and its gripper, those of support limbs the
    rest of the robot, as far away as its base.
    """
    out = np.empty((robot.limbs, 6))
    for limb, arm in enumerate(robot.every_limb):
        steps = np.array([np.linalg.norm(place) for place, _ in arm.link_offsets])
        if limb == moving:
            out[limb] = steps[::-1].cumsum()[::-1] - steps + robot.tool_length
        else:
            out[limb] = steps.cumsum() + np.linalg.norm(robot.mount_positions[limb])
    return out
