"""Both ends of a step, and the knots between a point and the place above it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.holding import joints_along
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import poses
from mlivr_gym.motion.joint_path import (
    CUBIC,
    GRIP_RADIUS,
    JointPath,
    control_places,
    flange_in_body,
)
from mlivr_gym.motion.plan_parts import Motion
from mlivr_gym.stances.stance_graph import StanceGraph

NORMAL_TOLERANCE = 2e-4
"""How far the gripper may be off the surface normal on departure and approach [m]."""


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
    """Joint angles before and after the step, shape (2, N, 6) [rad]."""

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
            joints=motion.joint_positions[ends],
        )

    @property
    def after(self) -> tuple[int, ...]:
        """Point index of each limb after the step."""
        return (*self.before[: self.limb], self.to_point, *self.before[self.limb + 1 :])


class Follower(NamedTuple):
    """A limb on a branch, and joint angles from which on it is followed, shape (6,) [rad]."""

    limb: int
    branch: int
    joints: Array


def normal_knots(graph: StanceGraph, ends: StepEnds, side: int) -> Array:
    """Return knots of the moving limb from its point to the place above it, shape (k, 6) [rad].

    It is the point before the step or, with `side` 1, after it. On one line the gripper would be
    off the surface normal by some distance in the middle. In n equal pieces it is off by the n^2-th
    part of it, and by 4 / 3 of that on the spline, where knots take a sixth of a second difference
    in place of an eighth. So many pieces are taken that twice the part is within the tolerance.
    """
    coarse = _above(graph, ends, side, np.array([0.0, 0.5, 1.0]))
    there = np.stack([0.5 * (coarse[0] + coarse[2]), coarse[1]])
    places, turns = flange_in_body(graph.robot, ends.limb, there)
    turned = turns[0] - turns[1]
    moved = places[0] - places[1] + graph.robot.tool_length * turned[:, 2]
    off = np.linalg.norm(moved) + GRIP_RADIUS * np.linalg.norm(turned) / np.sqrt(2.0)
    pieces = max(1, int(np.ceil(np.sqrt(2.0 * off / NORMAL_TOLERANCE))))
    knots = _above(graph, ends, side, control_places(pieces + CUBIC))
    knots[0] = ends.joints[side, ends.limb]
    return knots


def _above(graph: StanceGraph, ends: StepEnds, side: int, heights: Array) -> Array:
    """Return joint angles of the moving limb at fractions of the lift from 0 on, (k, 6) [rad]."""
    limb, point = ends.limb, ends.to_point if side else ends.before[ends.limb]
    one = Follower(limb, ends.branches[graph.limbs if side else limb], ends.joints[side, limb])
    grasp = graph.solver.grasps[point]
    lift = graph.robot.lift * heights[:, None] * grasp["normal"]
    flange = grasp["flange"]["position"] + lift, grasp["flange"]["rotation"][None]
    return follow(graph, ends, one, flange, (ends.positions[[side]], ends.rotations[[side]]))


def step_path(
    graph: StanceGraph, ends: StepEnds, lifts: tuple[Array, Array], parts: Sequence[Array]
) -> JointPath:
    """Return the joint path of a step: departure, the parts of its swing, and approach.

    `lifts` are the `normal_knots` at both points, and the parts knots of all limbs from one rest to
    the next, shapes (k, N, 6) [rad].
    """
    limb, turned = ends.limb, (lifts[0], lifts[1][::-1])
    departure, approach = (
        np.tile(joints, (len(own), 1, 1))
        for joints, own in zip((ends.joints[0], parts[-1][-1]), turned, strict=True)
    )
    departure[:, limb], approach[:, limb] = turned
    every = [departure, *parts, approach]
    knots = np.concatenate([departure[:1], *(part[1:] for part in every)])
    rests = np.cumsum([0, *(len(part) - 1 for part in every)])
    return JointPath(
        graph.robot, limb, int(limb == 0), ends.positions[0], ends.rotations[0], knots,
        tuple(rests.tolist()),
    )  # fmt: skip


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
