"""One regrasp as a path without time: departure, swing and approach of one limb.

`RegraspPath` evaluates the configurations that were checked when the step was planned, at any
sampling, so that figures, trajectories and the simulation all follow the same path.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np
import scipy

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.arm import LIMIT_TOLERANCE
from mlivr_gym.kinematics.base_path import BasePath, base_path, base_poses
from mlivr_gym.kinematics.holding import joints_along
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import pose, poses
from mlivr_gym.motion.plan_parts import Motion
from mlivr_gym.motion.rounded_lines import RoundedLines
from mlivr_gym.stances.stance_graph import StanceGraph

UNCHECKED_KNOTS: Array = np.zeros((0, 7))
"""Knots of a swing that was not checked: none."""

PHASES = ("departure", "swing", "approach")
"""Names of the phases of a step, in their order."""

SAME_KNOT = 1e-9
"""Knots that differ by less are equal [1, rad]."""

TASK_SPACE_SAMPLES = 400
"""Number of samples at which the feasibility of a swing in task space is checked."""

MAX_JUMP = 0.2
"""Largest change of a joint between two of these samples [rad]; a larger one indicates a
singularity."""


@dataclass(frozen=True)
class Regrasp:
    """One step with all that determines its path, by indices and arrays; files have `Step`."""

    limb: int
    """Index of the limb that moves."""
    before: tuple[int, ...]
    """Point index of each limb before the step, N numbers."""
    to_point: int
    """Index of the point that the limb grasps."""
    positions: Array
    """Base positions before and after the step, shape (2, 3) [m]."""
    rotations: Array
    """Base rotations before and after the step, shape (2, 3, 3)."""
    path_kind: int
    """Kind of the base path, `base_path.STRAIGHT` or `base_path.ARC`."""
    pivot: Array
    """Centre of an arc in the world, shape (3,) [m]."""
    branches: tuple[int, ...]
    """Branch of each limb before the step, followed by that of the swing limb after it, N + 1
    numbers."""
    joints: Array
    """Joint angles before the step, shape (N, 6) [rad]."""
    grasp_joints: Array
    """Joint angles of the swing limb after the step, shape (6,) [rad]."""
    knots: Array
    """Base parameter and joint angles at each knot of the swing, shape (k, 7); empty if the swing
    was not checked."""
    rounded: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """Fractions of the lines before and after each knot that its rounded corner replaces, shape (k,
    2); 0 where the swing stops. By default no corner is rounded."""

    @property
    def after(self) -> tuple[int, ...]:
        """Point index of each limb after the step."""
        return (*self.before[: self.limb], self.to_point, *self.before[self.limb + 1 :])

    @cached_property
    def base_path(self) -> BasePath:
        """The base path as a record for compiled code."""
        first, last = map(pose, self.positions, self.rotations)
        return base_path(first, last, self.path_kind, self.pivot)


class RegraspPath:
    """Configurations along a regrasp.

    A swing that was checked follows its knots and rounded corners. A swing that was not checked
    moves in task space, with the gripper on a straight line and its rotation by slerp, if the limb
    can follow on one branch inside its joint limits; otherwise it is a line in joint space.
    """

    def __init__(self, graph: StanceGraph, regrasp: Regrasp) -> None:
        """Follow `regrasp` on the map and with the robot of `graph`."""
        self.graph, self.regrasp = graph, regrasp

    @cached_property
    def _knots(self) -> Array:
        """Distinct knots of the swing; of a swing that was not checked, its two end points."""
        if len(self.regrasp.knots):
            return self.regrasp.knots[are_distinct(self.regrasp.knots)]
        ends = [self.departure(np.array([0.0, 1.0]))[1:], self.approach(np.array([0.0, 1.0]))[:1]]
        return np.column_stack([[0.0, 1.0], np.concatenate(ends)])

    @cached_property
    def in_task_space(self) -> bool:
        """Whether the swing moves the gripper on a straight line."""
        return not len(self.regrasp.knots) and self._is_feasible_in_task_space()

    @cached_property
    def _swing_segments(self) -> list[RoundedLines]:
        """The segments of the swing: chains of lines with rounded corners, at rest at both ends."""
        rounded, corners = self.regrasp.rounded, np.zeros((len(self._knots), 2))
        if len(rounded):
            corners[1:-1] = rounded[are_distinct(self.regrasp.knots)][1:-1]
        stops = np.flatnonzero((corners == 0.0).any(axis=1))
        return [
            RoundedLines(self._knots[first : last + 1], corners[first + 1 : last])
            for first, last in pairwise(stops)
        ]

    @property
    def lines(self) -> list[int]:
        """Number of lines between knots in each segment of the swing."""
        return [len(lines.knots) - 1 for lines in self._swing_segments]

    def departure(self, sigma: Array) -> Array:
        """Return joint angles of the swing limb along its departure, shape (k, 6) [rad]."""
        return self._along_normal(0, sigma)

    def approach(self, sigma: Array) -> Array:
        """Return joint angles of the swing limb along its approach, shape (k, 6) [rad]."""
        return self._along_normal(1, 1.0 - sigma)

    def _along_normal(self, end: int, height: Array) -> Array:
        """Return joint angles of the swing limb at k fractions of the lift, shape (k, 6) [rad]."""
        step, graph = self.regrasp, self.graph
        point = step.to_point if end else step.before[step.limb]
        branch = step.branches[graph.limbs if end else step.limb]
        grasp = graph.solver.grasps[point]
        flange = grasp["flange"]["position"] + graph.robot.lift * height[:, None] * grasp["normal"]
        grasped = step.grasp_joints if end else step.joints[step.limb]
        # Start at the point, where the windings are known.
        order = np.argsort(height, kind="stable") if len(height) > 1 else slice(None)
        base = (step.positions[end][None], step.rotations[end][None])
        tool = grasp["flange"]["rotation"][None]
        out = np.empty((len(height), 6))
        out[order] = self._follow(step.limb, branch, (flange[order], tool), base, grasped)
        return out

    def swing(self, segment: int, sigma: Array) -> tuple[Array, Array]:
        """Return base parameter and joint angles of the swing limb along one segment of its swing.

        Both are evaluated at k values of sigma; their shapes are (k,) and (k, 6) [rad].
        """
        if self.in_task_space:
            return sigma, self._in_a_straight_line(sigma)
        values = self._swing_segments[segment].at(sigma)
        return values[:, 0], values[:, 1:]

    def _is_feasible_in_task_space(self) -> bool:
        """Return whether the gripper can move on a straight line within limits, without jumps."""
        limits = self.graph.robot.joint_limits[self.regrasp.limb]
        try:
            joints = self._in_a_straight_line(np.linspace(0.0, 1.0, TASK_SPACE_SAMPLES))
        except PlanError:
            return False
        inside = (joints >= limits[:, 0] - LIMIT_TOLERANCE).all() and (
            joints <= limits[:, 1] + LIMIT_TOLERANCE
        ).all()
        smooth = np.abs(np.diff(joints, axis=0)).max() < MAX_JUMP
        return bool(inside and smooth and np.abs(joints[-1] - self._knots[-1, 1:]).max() < 1e-6)

    def _in_a_straight_line(self, sigma: Array) -> Array:
        """Return joint angles for a gripper that moves on a straight line, shape (k, 6) [rad]."""
        step, graph = self.regrasp, self.graph
        points = [step.before[step.limb], step.to_point]
        rows = graph.solver.grasps[points]
        above = rows["point"] + graph.robot.lift * rows["normal"]
        tools = scipy.spatial.transform.Rotation.from_matrix(rows["flange"]["rotation"])
        turn = (tools[0].inv() * tools[1]).as_rotvec()
        rotations = (
            tools[0] * scipy.spatial.transform.Rotation.from_rotvec(sigma[:, None] * turn)
        ).as_matrix()
        grasps = above[0] + sigma[:, None] * (above[1] - above[0])
        flanges = grasps - graph.robot.tool_length * rotations[:, :, 2]
        return self._follow(
            step.limb,
            step.branches[step.limb],
            (flanges, rotations),
            self.base(sigma),
            self._knots[0, 1:],
        )

    def base(self, s: Array) -> tuple[Array, Array]:
        """Return base positions (k, 3) [m] and base rotations (k, 3, 3) at base parameters."""
        return base_poses(self.regrasp.base_path, s)

    def supports(self, s: Array) -> Array:
        """Return joint angles of the support limbs at base parameters, shape (k, N, 6) [rad].

        The base parameters must start at 0, where the windings are known. Entries of the swing limb
        are NaN.
        """
        step, solver, base = self.regrasp, self.graph.solver, self.base(s)
        joints = np.full((len(s), self.graph.limbs, 6), np.nan)
        for limb in range(self.graph.limbs):
            if limb != step.limb:
                flange = solver.grasps[step.before[limb]]["flange"]
                flanges = flange["position"][None], flange["rotation"][None]
                joints[:, limb] = self._follow(
                    limb, step.branches[limb], flanges, base, step.joints[limb]
                )
        return joints

    def _follow(
        self,
        limb: int,
        branch: int,
        flange: tuple[Array, Array],
        base: tuple[Array, Array],
        start: Array,
    ) -> Array:
        """Return joint angles on a branch along flange and base poses, continuous from `start`."""
        bases, flanges = poses(*base), poses(*flange)
        out, reference = Angles.rows(max(len(bases), len(flanges))), Angles.row()
        reference["q"] = start
        robots = self.graph.checks.robots
        followed = joints_along(robots, limb, bases, flanges, branch, reference, out)
        if followed < len(out):
            target = self.graph.grasp_map.ids[self.regrasp.to_point]
            raise PlanError(
                f"limb {limb} cannot stay on its branch while limb {self.regrasp.limb} moves to "
                f"{target!r}: the plan does not fit this map and robot, or its steps were not "
                f"checked"
            )
        joints: Array = out["q"]
        return joints


class HasMotion(Protocol):
    """Anything with a motion, such as a plan."""

    @property
    def motion(self) -> Motion:
        """Stances, steps and configurations."""


def are_distinct(knots: Array) -> BoolArray:
    """Return which knots, shape (k, 7), differ from the one before; the first one does."""
    moved: Array = np.abs(np.diff(knots, axis=0, prepend=np.inf)).max(axis=1)
    return moved > SAME_KNOT


def planned_regrasp(graph: StanceGraph, plan: HasMotion, index: int) -> Regrasp:
    """Return the regrasp of one step of a plan, by its index from 0.

    Raises a `PlanError` if the plan has no such step.
    """
    count = len(plan.motion.steps)
    if not 0 <= index < count:
        raise PlanError(f"the plan has no step {index}; it has {count}, counted from 0")
    return regrasp_of(graph, plan.motion, index)


def regrasp_of(graph: StanceGraph, motion: Motion, index: int) -> Regrasp:
    """Return the regrasp of step `index` of a motion."""
    step, ends = motion.steps[index], slice(index, index + 2)
    return Regrasp(
        limb=step.limb,
        before=graph.indices(motion.stances[index]),
        to_point=graph.grasp_map.index(step.to_point),
        positions=motion.base_positions[ends],
        rotations=motion.base_rotations[ends],
        path_kind=step.path_kind,
        pivot=np.array(step.pivot),
        branches=(*motion.branches[index].tolist(), int(motion.branches[index + 1, step.limb])),
        joints=motion.joint_positions[index],
        grasp_joints=motion.joint_positions[index + 1, step.limb],
        knots=np.array(step.knots, dtype=np.float64).reshape(-1, 7),
        rounded=np.array(step.rounded, dtype=np.float64).reshape(-1, 2),
    )
