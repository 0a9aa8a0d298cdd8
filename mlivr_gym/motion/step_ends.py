"""Both ends of a step, and the knots between a point and the place above it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.motion.joint_path import JointPath
from mlivr_gym.motion.plan_parts import Motion
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.departures import Departure, departure_of


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


def normal_knots(graph: StanceGraph, ends: StepEnds, side: int) -> Array:
    """Return knots of the moving limb from its point to the place above it, shape (k, 6) [rad].

    It is the point before the step or, with `side` 1, after it. The lines are those of
    `transitions.departures`; of the first and the last the outer third is a line of its own, so
    that the gripper rises at constant rate on the spline. Raises a `PlanError` if the limb cannot
    depart.
    """
    limb, point = ends.limb, ends.to_point if side else ends.before[ends.limb]
    branch, hold = ends.branches[graph.limbs if side else limb], ends.joints[side, limb]
    base, found = pose(ends.positions[side], ends.rotations[side]), Departure.row()
    grasp = graph.solver.grasps[point]
    if not departure_of(graph.checks.robots, limb, base, grasp, branch, found):
        raise PlanError(
            f"limb {limb} cannot move along the normal of {graph.grasp_map.ids[point]!r} on branch "
            f"{branch}: the plan does not fit this map and robot, or its steps were not checked"
        )
    knots = found["knots"]["q"][: found["pieces"] + 1]
    turns: Array = knots + np.pi * np.rint((hold - knots[0]) / np.pi)
    turns[0] = hold
    first, last = turns[:1], turns[-1:]
    outer = first + (turns[1:2] - first) / 3.0, last + (turns[-2:-1] - last) / 3.0
    return np.concatenate([first, outer[0], turns[1:-1], outer[1], last])


def step_path(
    graph: StanceGraph, ends: StepEnds, lifts: tuple[Array, Array], parts: Sequence[Array]
) -> JointPath:
    """Return the joint path of a step: departure, the parts of its swing, and approach.

    `lifts` are the `normal_knots` at both points, and the parts knots of all limbs from one rest to
    the next, shapes (k, N, 6) [rad].
    """
    limb, turned = ends.limb, (lifts[0], lifts[1][::-1])
    departure, approach = (
        np.tile(joints, (len(angles), 1, 1))
        for joints, angles in zip((ends.joints[0], parts[-1][-1]), turned, strict=True)
    )
    departure[:, limb], approach[:, limb] = turned
    every = [departure, *parts, approach]
    knots = np.concatenate([departure[:1], *(part[1:] for part in every)])
    rests = np.cumsum([0, *(len(part) - 1 for part in every)])
    return JointPath(
        graph.robot, limb, int(limb == 0), ends.positions[0], ends.rotations[0], knots,
        tuple(rests.tolist()),
    )  # fmt: skip
