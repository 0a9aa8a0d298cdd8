"""One regrasp as a path without a clock: departure, swing and approach of one limb.

`RegraspPath` evaluates the configurations that were checked when the step was planned, at any
places along it, so that a picture, a trajectory and a simulation all follow the same path.
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
from mlivr_gym.kinematics.base_path import PATH_KINDS, STRAIGHT, BasePath, base_path, base_poses
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.path_following import joints_along, poses
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.motion.plan_parts import Motion
from mlivr_gym.motion.runs import Run
from mlivr_gym.stances.stance_graph import StanceGraph

UNCHECKED_KNOTS: Array = np.zeros((0, 7))
"""Knots of a swing that was not checked."""

PHASES = ("departure", "swing", "approach")
"""Parts of a step."""

SAME_KNOT = 1e-9
"""Knots that differ by less are one [rad]."""

TASK_SPACE_SAMPLES = 400
"""Places at which a swing in task space is looked at before it is used."""

LARGEST_JUMP = 0.2
"""Largest change of a joint between two of them [rad]; a larger one would be a singularity."""


@dataclass(frozen=True)
class Regrasp:
    """What is needed to execute one step.

    Attributes
    ----------
    limb
        Limb that moves.
    before
        Point index of each limb before the step, N of them.
    to_point
        Point index it grasps.
    positions
        Base positions before and after, shape (2, 3) [m].
    rotations
        Base rotations before and after, shape (2, 3, 3).
    kind
        Kind of the base path, `base_path.STRAIGHT` or `base_path.ARC`.
    pivot
        Centre of an arc, shape (3,) [m].
    branches
        Branch of each limb before the step, and of the moving limb after it, N + 1
        numbers.
    joints
        Joint angles before the step, shape (N, 6) [rad].
    grasp_joints
        Joint angles of the moving limb after the step, shape (6,) [rad].
    knots
        Base parameter and joint angles at each knot of the swing, shape (k, 7); none if the
        swing was not checked.
    rounded
        Shares of the lines before and after each knot that lie on its rounded corner,
        shape (k, 2); 0 where the swing comes to rest. None is rounded by default.
    """

    limb: int
    before: tuple[int, ...]
    to_point: int
    positions: Array
    rotations: Array
    kind: int
    pivot: Array
    branches: tuple[int, ...]
    joints: Array
    grasp_joints: Array
    knots: Array
    rounded: Array = field(default_factory=lambda: np.zeros((0, 2)))

    @property
    def after(self) -> tuple[int, ...]:
        """Point index of each limb after the step."""
        return (*self.before[: self.limb], self.to_point, *self.before[self.limb + 1 :])

    @cached_property
    def base_path(self) -> BasePath:
        """The base path as compiled code takes it."""
        first, last = map(pose, self.positions, self.rotations)
        return base_path(first, last, self.kind, self.pivot)


class RegraspPath:
    """Configurations along a regrasp.

    A swing that was checked is followed on its knots, round the corners that are rounded. One that
    was not runs in task space, the gripper on a straight line with its rotation by slerp, where the
    limb can do so on one branch inside its joint limits; else in joint space.
    """

    def __init__(self, graph: StanceGraph, regrasp: Regrasp) -> None:
        """Follow `regrasp` on the map and with the robot of `graph`."""
        self.graph, self.regrasp = graph, regrasp

    @cached_property
    def _kept(self) -> BoolArray:
        """Which knots count: each once."""
        moved = np.abs(np.diff(self.regrasp.knots, axis=0)).max(axis=1) > SAME_KNOT
        kept: BoolArray = np.concatenate([[True], moved])
        return kept

    @cached_property
    def _knots(self) -> Array:
        """Knots of the swing, each once; of one that was not checked, those at its ends."""
        if len(self.regrasp.knots):
            return self.regrasp.knots[self._kept]
        ends = [self.departure(np.array([0.0, 1.0]))[1:], self.approach(np.array([0.0, 1.0]))[:1]]
        return np.column_stack([[0.0, 1.0], np.concatenate(ends)])

    @cached_property
    def in_task_space(self) -> bool:
        """Whether the gripper swings on a straight line."""
        return not len(self.regrasp.knots) and self._serves_in_task_space()

    @cached_property
    def _runs(self) -> list[Run]:
        """The pieces of the swing, chains of lines with rounded corners between them."""
        rounded, corners = self.regrasp.rounded, np.zeros((len(self._knots), 2))
        if len(rounded):
            corners[1:-1] = rounded[self._kept][1:-1]
        stops = np.flatnonzero((corners == 0.0).any(axis=1))
        return [
            Run(self._knots[first : last + 1], corners[first + 1 : last])
            for first, last in pairwise(stops)
        ]

    @property
    def pieces(self) -> int:
        """Number of pieces of the swing, each from rest to rest."""
        return len(self._runs)

    @property
    def lines(self) -> list[int]:
        """Number of lines between knots in each of them."""
        return [len(run.knots) - 1 for run in self._runs]

    def departure(self, share: Array) -> Array:
        """Joint angles of the moving limb at shares of its departure, shape (k, 6) [rad]."""
        return self._lifted(0, share)

    def approach(self, share: Array) -> Array:
        """Joint angles of the moving limb at shares of its approach, shape (k, 6) [rad]."""
        return self._lifted(1, 1.0 - share)

    def _lifted(self, end: int, height: Array) -> Array:
        step, graph = self.regrasp, self.graph
        point = step.to_point if end else step.before[step.limb]
        branch = step.branches[graph.limbs if end else step.limb]
        grasp = graph.solver.grasps[point]
        flange = grasp["flange"]["position"] + graph.robot.lift * height[:, None] * grasp["normal"]
        grasped = step.grasp_joints if end else step.joints[step.limb]
        # The angles are followed from the point on, where the windings are known.
        order = np.argsort(height, kind="stable") if len(height) > 1 else slice(None)
        base = (step.positions[end][None], step.rotations[end][None])
        tool = grasp["flange"]["rotation"][None]
        out = np.empty((len(height), 6))
        out[order] = self._follow(step.limb, branch, (flange[order], tool), base, grasped)
        return out

    def swing(self, piece: int, share: Array) -> tuple[Array, Array]:
        """Base parameter and joint angles of the moving limb at shares of one piece of its swing.

        Shapes (k,) and (k, 6) [rad].
        """
        if self.in_task_space:
            return share, self._in_a_straight_line(share)
        values = self._runs[piece].at(share)
        return values[:, 0], values[:, 1:]

    def _serves_in_task_space(self) -> bool:
        limits = self.graph.robot.joint_limits[self.regrasp.limb]
        try:
            joints = self._in_a_straight_line(np.linspace(0.0, 1.0, TASK_SPACE_SAMPLES))
        except PlanError:
            return False
        inside = (joints >= limits[:, 0] - LIMIT_TOLERANCE).all() and (
            joints <= limits[:, 1] + LIMIT_TOLERANCE
        ).all()
        smooth = np.abs(np.diff(joints, axis=0)).max() < LARGEST_JUMP
        return bool(inside and smooth and np.abs(joints[-1] - self._knots[-1, 1:]).max() < 1e-6)

    def _in_a_straight_line(self, share: Array) -> Array:
        """Joint angles of the moving limb on a straight line of its gripper, shape (k, 6) [rad]."""
        step, graph = self.regrasp, self.graph
        points = [step.before[step.limb], step.to_point]
        rows = graph.solver.grasps[points]
        above = rows["point"] + graph.robot.lift * rows["normal"]
        tools = scipy.spatial.transform.Rotation.from_matrix(rows["flange"]["rotation"])
        turn = (tools[0].inv() * tools[1]).as_rotvec()
        rotations = (
            tools[0] * scipy.spatial.transform.Rotation.from_rotvec(share[:, None] * turn)
        ).as_matrix()
        grasps = above[0] + share[:, None] * (above[1] - above[0])
        flanges = grasps - graph.robot.tool_length * rotations[:, :, 2]
        return self._follow(
            step.limb,
            step.branches[step.limb],
            (flanges, rotations),
            self.base(share),
            self._knots[0, 1:],
        )

    def base(self, u: Array) -> tuple[Array, Array]:
        """Base positions (k, 3) [m] and rotations (k, 3, 3) at base parameters."""
        return base_poses(self.regrasp.base_path, u)

    def supports(self, u: Array) -> Array:
        """Joint angles of all limbs at base parameters that start at 0, shape (k, N, 6) [rad].

        Those of the moving limb are NaN.
        """
        step, solver, base = self.regrasp, self.graph.solver, self.base(u)
        joints = np.full((len(u), self.graph.limbs, 6), np.nan)
        for limb in range(self.graph.limbs):
            if limb != step.limb:
                flange = solver.grasps[step.before[limb]]["flange"]
                hold = flange["position"][None], flange["rotation"][None]
                joints[:, limb] = self._follow(
                    limb, step.branches[limb], hold, base, step.joints[limb]
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
        """Joint angles of a limb on a branch at flange and base poses, continuous from `start`."""
        bases, flanges = poses(*base), poses(*flange)
        out, reference = Angles.rows(max(len(bases), len(flanges))), Angles.row()
        reference["q"] = start
        robots = self.graph.checks.robots
        found = joints_along(robots, limb, bases, flanges, branch, reference, out)
        if found < len(out):
            target = self.graph.grasp_map.ids[self.regrasp.to_point]
            raise PlanError(
                f"limb {limb} cannot stay on its branch while limb {self.regrasp.limb} moves to "
                f"{target!r}: the plan does not fit this map and robot, or its steps were not "
                f"checked"
            )
        joints: Array = out["q"]
        return joints


class Planned(Protocol):
    """What has a motion, as a plan has."""

    @property
    def motion(self) -> Motion:
        """Stances, steps and configurations."""


def planned_regrasp(graph: StanceGraph, plan: Planned, index: int) -> Regrasp:
    """What is needed to execute one step of a plan.

    Parameters
    ----------
    graph
        The stance graph of the plan's robot and map.
    plan
        The plan.
    index
        Index of the step.

    Raises
    ------
    PlanError
        If the plan has no such step.
    """
    count = len(plan.motion.steps)
    if not 0 <= index < count:
        raise PlanError(f"the plan has no step {index}; it has {count}, counted from 0")
    return regrasp_of(graph, plan.motion, index)


def regrasp_of(graph: StanceGraph, motion: Motion, index: int) -> Regrasp:
    """What is needed to execute step `index` of a motion; see `planned_regrasp`."""
    step, ends = motion.steps[index], slice(index, index + 2)
    turns = scipy.spatial.transform.Rotation.from_quat(
        motion.base_quaternions[ends], scalar_first=True
    )
    return Regrasp(
        limb=step.limb,
        before=graph.indices(motion.stances[index]),
        to_point=graph.grasp_map.index(step.to_point),
        positions=motion.base_positions[ends],
        rotations=turns.as_matrix(),
        kind=PATH_KINDS.index(step.path) if step.path in PATH_KINDS else STRAIGHT,
        pivot=np.array(step.pivot),
        branches=(*motion.branches[index].tolist(), int(motion.branches[index + 1, step.limb])),
        joints=motion.joint_positions[index],
        grasp_joints=motion.joint_positions[index + 1, step.limb],
        knots=np.array(step.knots, dtype=np.float64).reshape(-1, 7),
        rounded=np.array(step.rounded, dtype=np.float64).reshape(-1, 2),
    )
