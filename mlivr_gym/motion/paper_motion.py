"""The motion of the paper, for steps that are not checked: sampled, and nothing about it is proved.

The base moves on its base path, and the gripper of the moving limb on a straight line with its
rotation by slerp, if the limb can follow on one branch inside its joint limits; otherwise the limb
moves on a line in joint space. With quintic time scalings (`time_scaling.Durations`) this is the
paper's motion. Joint angles come from inverse kinematics at samples, between which nothing is
known, and knots are taken from them as from curves that were checked.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.arm import LIMIT_TOLERANCE
from mlivr_gym.kinematics.base_path import BasePath, base_poses
from mlivr_gym.motion.joint_path import JointPath
from mlivr_gym.motion.knots import joint_path_along
from mlivr_gym.motion.step_ends import Follower, StepEnds, follow, joints_on_normal, support_joints
from mlivr_gym.motion.swings import RoundedLines
from mlivr_gym.stances.stance_graph import StanceGraph

SAMPLES: Array = np.linspace(0.0, 1.0, 400)
"""Path parameters at which it is checked that limbs can follow."""

MAX_JUMP = 0.2
"""Largest change of a joint between two of these samples [rad]; a larger one indicates a
singularity."""


def paper_path(graph: StanceGraph, ends: StepEnds, path: BasePath) -> JointPath | None:
    """Return the joint path of a step that was not checked; None if a limb cannot follow."""
    try:
        supports = support_joints(graph, ends, path, SAMPLES)
        if np.abs(np.diff(supports, axis=0)).max() > MAX_JUMP:
            return None
        line = StraightSwing(graph, ends, path)
        joint_line = RoundedLines(np.column_stack([[0.0, 1.0], line.ends]), np.zeros((0, 2)))
        swing = line if line.is_feasible() else joint_line
        return joint_path_along(graph, ends, path, [swing])
    except PlanError:
        return None


class StraightSwing:
    """A swing of a gripper on a straight line from above one point to above the other."""

    breaks: Array = np.array([0.0, 1.0])

    def __init__(self, graph: StanceGraph, ends: StepEnds, path: BasePath) -> None:
        """Swing from one end of a step to the other while the base follows `path`."""
        self.graph, self.step, self.path = graph, ends, path

    @cached_property
    def ends(self) -> Array:
        """Joint angles at both ends of the swing, shape (2, 6) [rad]."""
        above = np.array([0.0, 1.0])
        ends = [joints_on_normal(self.graph, self.step, after, above) for after in (False, True)]
        return np.stack(ends)[:, 1]

    def at(self, sigma: Array) -> Array:
        """Return base parameter and joint angles at k path parameters, shape (k, 7)."""
        graph, step = self.graph, self.step
        rows = graph.solver.grasps[[step.before[step.limb], step.to_point]]
        above = rows["point"] + graph.robot.lift * rows["normal"]
        tools = scipy.spatial.transform.Rotation.from_matrix(rows["flange"]["rotation"])
        turn = sigma[:, None] * (tools[0].inv() * tools[1]).as_rotvec()
        rotations = (tools[0] * scipy.spatial.transform.Rotation.from_rotvec(turn)).as_matrix()
        grasps = above[0] + sigma[:, None] * (above[1] - above[0])
        flange = grasps - graph.robot.tool_length * rotations[:, :, 2], rotations
        one = Follower(step.limb, step.branches[step.limb], self.ends[0])
        joints = follow(graph, step, one, flange, base_poses(self.path, sigma))
        return np.column_stack([sigma, joints])

    def is_feasible(self) -> bool:
        """Return whether the gripper can move on a straight line within limits, without jumps."""
        low, high = self.graph.robot.joint_limits[self.step.limb].T
        try:
            joints = self.at(SAMPLES)[:, 1:]
        except PlanError:
            return False
        inside = (joints >= low - LIMIT_TOLERANCE) & (joints <= high + LIMIT_TOLERANCE)
        smooth = np.abs(np.diff(joints, axis=0)).max() < MAX_JUMP
        return bool(inside.all() and smooth and np.abs(joints[-1] - self.ends[1]).max() < 1e-6)
