"""Both ends of a step, and the joint angles that follow from them by inverse kinematics.

`support_joints` says how the base moves during a step. Nothing else needs to know.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.base_path import BasePath, base_path, base_poses
from mlivr_gym.kinematics.holding import joints_along
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import pose, poses
from mlivr_gym.motion.plan_parts import Motion
from mlivr_gym.stances.stance_graph import StanceGraph

WINDING_SAMPLES = 65
"""Base poses from which support limbs are followed up to the first one asked for."""


@dataclass(frozen=True)
class StepEnds:
    """A step before its joint path is chosen: stances, base poses, branches and joint angles."""

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
    branches: tuple[int, ...]
    """Branch of each limb before the step, followed by that of the moving limb after it, N + 1
    numbers."""
    joints: Array
    """Joint angles before the step, shape (N, 6) [rad]."""
    grasp_joints: Array
    """Joint angles of the moving limb after the step, shape (6,) [rad]."""

    @classmethod
    def of(cls, graph: StanceGraph, motion: Motion, index: int) -> StepEnds:
        """Return the ends of step `index` of a motion."""
        step, ends = motion.steps[index], slice(index, index + 2)
        return cls(
            limb=step.limb,
            before=graph.indices(motion.stances[index]),
            to_point=graph.grasp_map.index(step.to_point),
            positions=motion.base_positions[ends],
            rotations=motion.base_rotations[ends],
            branches=(*motion.branches[index].tolist(), int(motion.branches[index + 1, step.limb])),
            joints=motion.joint_positions[index],
            grasp_joints=motion.joint_positions[index + 1, step.limb],
        )

    @property
    def after(self) -> tuple[int, ...]:
        """Point index of each limb after the step."""
        return (*self.before[: self.limb], self.to_point, *self.before[self.limb + 1 :])

    def base_path(self, graph: StanceGraph, kind: int) -> BasePath:
        """Return the base path of a kind as a record for compiled code."""
        first, last = map(pose, self.positions, self.rotations)
        return base_path(first, last, kind, graph.pivot(self.before, self.after))


def support_joints(graph: StanceGraph, ends: StepEnds, path: BasePath, s: Array) -> Array:
    """Return joint angles while the base moves, at base parameters s, shape (k, N, 6) [rad].

    The base parameters, shape (k,), rise from 0 before the base moves to 1 after it. The support
    limbs hold their points on their branches; the moving limb is as it is before the step. Raises a
    `PlanError` if a support limb cannot follow the base.
    """
    # Windings are known where the base has not moved.
    lead_in = np.linspace(0.0, s[0], WINDING_SAMPLES if s[0] > 0.0 else 1)
    base = base_poses(path, np.concatenate([lead_in, s]))
    joints = np.tile(ends.joints, (len(s), 1, 1))
    for limb, point in enumerate(ends.before):
        if limb != ends.limb:
            flange = graph.solver.grasps[point]["flange"]
            held = flange["position"][None], flange["rotation"][None]
            one = Follower(limb, ends.branches[limb], ends.joints[limb])
            joints[:, limb] = follow(graph, ends, one, held, base)[len(lead_in) :]
    return joints


def joints_on_normal(graph: StanceGraph, ends: StepEnds, after: bool, height: Array) -> Array:
    """Return joint angles of the moving limb above one of its points, shape (k, 6) [rad].

    It is the point before or `after` the step; heights are fractions of the lift from 0 on, shape
    (k,), where the limb holds the point.
    """
    limb, point = ends.limb, ends.to_point if after else ends.before[ends.limb]
    one = Follower(limb, ends.branches[limb], ends.joints[limb])
    if after:
        one = Follower(limb, ends.branches[graph.limbs], ends.grasp_joints)
    grasp = graph.solver.grasps[point]
    lift = graph.robot.lift * height[:, None] * grasp["normal"]
    flange = grasp["flange"]["position"] + lift, grasp["flange"]["rotation"][None]
    base = ends.positions[int(after)][None], ends.rotations[int(after)][None]
    return follow(graph, ends, one, flange, base)


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
