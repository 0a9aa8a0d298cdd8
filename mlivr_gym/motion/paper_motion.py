"""The motion of the paper, for steps that are not checked: sampled, and nothing about it is proved.

The base moves on its base path, and the gripper of the moving limb on a straight line with its
rotation by slerp, if the limb can follow on one branch inside its joint limits; otherwise the limb
moves on a line in joint space. With quintic time scalings (`time_scaling.Durations`) this is the
paper's motion. Joint angles come from inverse kinematics at samples, between which nothing is
known, and knots are taken from them as from curves that were checked.
"""

from __future__ import annotations

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.arm import LIMIT_TOLERANCE
from mlivr_gym.kinematics.base_path import BasePath, base_poses
from mlivr_gym.motion.joint_path import JointPath
from mlivr_gym.motion.knots import SwingPart, joint_path_along
from mlivr_gym.motion.step_ends import Follower, StepEnds, follow, joints_on_normal, support_joints
from mlivr_gym.motion.swings import rounded_lines
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
        above = np.array([0.0, 1.0])
        lifted = [joints_on_normal(graph, ends, after, above)[1] for after in (False, True)]
        swing = straight_swing(graph, ends, path, lifted[0])
        if not _is_feasible(graph, ends, swing, lifted[1]):
            swing = rounded_lines(np.column_stack([above, np.stack(lifted)]), np.zeros((0, 2)))
        return joint_path_along(graph, ends, path, [swing])
    except PlanError:
        return None


def straight_swing(graph: StanceGraph, ends: StepEnds, path: BasePath, lifted: Array) -> SwingPart:
    """Return a swing of the gripper on a straight line from above one point to above the other.

    `lifted` are the joint angles above the first one, shape (6,) [rad].
    """
    rows = graph.solver.grasps[[ends.before[ends.limb], ends.to_point]]
    above = rows["point"] + graph.robot.lift * rows["normal"]
    tools = scipy.spatial.transform.Rotation.from_matrix(rows["flange"]["rotation"])
    turn = (tools[0].inv() * tools[1]).as_rotvec()
    one = Follower(ends.limb, ends.branches[ends.limb], lifted)

    def at(sigma: Array) -> Array:
        turns = scipy.spatial.transform.Rotation.from_rotvec(sigma[:, None] * turn)
        rotations = (tools[0] * turns).as_matrix()
        grasps = above[0] + sigma[:, None] * (above[1] - above[0])
        flange = grasps - graph.robot.tool_length * rotations[:, :, 2], rotations
        return np.column_stack([sigma, follow(graph, ends, one, flange, base_poses(path, sigma))])

    return SwingPart(np.array([0.0, 1.0]), at)


def _is_feasible(graph: StanceGraph, ends: StepEnds, swing: SwingPart, last: Array) -> bool:
    """Return whether a swing ends as it should, within limits and without jumps, at samples."""
    low, high = graph.robot.joint_limits[ends.limb].T
    try:
        joints = swing.at(SAMPLES)[:, 1:]
    except PlanError:
        return False
    inside = (joints >= low - LIMIT_TOLERANCE) & (joints <= high + LIMIT_TOLERANCE)
    smooth = np.abs(np.diff(joints, axis=0)).max() < MAX_JUMP
    return bool(inside.all() and smooth and np.abs(joints[-1] - last).max() < 1e-6)
