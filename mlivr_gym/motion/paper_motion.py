"""The motion of the paper, for steps that are not checked: sampled, and nothing about it is proved.

The base moves straight with its rotation by slerp, and so does the gripper of the moving limb, if
the limb can follow on one branch inside its joint limits; otherwise the limb moves on a line in
joint space. With quintic time scalings (`time_scaling.Durations`) this is the paper's motion. Joint
angles come from inverse kinematics at samples, between which nothing is known.
"""

from __future__ import annotations

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.base_path import BasePath, base_rows
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.chain import LIMIT_TOLERANCE
from mlivr_gym.kinematics.poses import poses
from mlivr_gym.motion.joint_path import JointPath
from mlivr_gym.motion.step_ends import StepEnds, normal_knots, step_path
from mlivr_gym.motion.straight_base import (
    Follower,
    JointCurve,
    dense_knots,
    follow,
    path_of,
    support_joints,
)
from mlivr_gym.stances.stance_graph import StanceGraph

SAMPLES: Array = np.linspace(0.0, 1.0, 400)
"""Path parameters at which it is checked that limbs can follow."""

TOLERANCE = 2e-4
"""How far lines between knots may move the robot off the samples [m]."""

MAX_JUMP = 0.2
"""Largest change of a joint between two of these samples [rad]; a larger one indicates a
singularity."""


def paper_path(graph: StanceGraph, ends: StepEnds) -> JointPath | None:
    """Return the joint path of a step that was not checked; None if a limb would jump.

    Raises a `PlanError` if a limb cannot follow.
    """
    path, limb = path_of(ends), ends.limb
    if _jumps(support_joints(graph, ends, path, SAMPLES, ends.joints[0])):
        return None
    lifts = normal_knots(graph, ends, 0), normal_knots(graph, ends, 1)
    first, last = lifts[0][-1], lifts[1][-1]
    swing = _straight_swing(graph, ends, path, first)
    is_straight = _is_feasible(graph, limb, swing, last)

    def curve(sigma: Array) -> Array:
        joints = support_joints(graph, ends, path, sigma, ends.joints[0])
        line = first + sigma[:, None] * (last - first)
        joints[:, limb] = swing(sigma) if is_straight else line
        return joints

    return step_path(graph, ends, lifts, [dense_knots(graph.robot, ends, curve, TOLERANCE)])


def _straight_swing(graph: StanceGraph, ends: StepEnds, path: BasePath, first: Array) -> JointCurve:
    """Return the swing of the gripper on a straight line from above one point to above the other.

    It gives joint angles, shape (k, 6) [rad], and begins with the given ones.
    """
    rows = graph.solver.grasps[[ends.before[ends.limb], ends.to_point]]
    above = rows["point"] + graph.robot.lift * rows["normal"]
    tools = scipy.spatial.transform.Rotation.from_matrix(rows["flange"]["rotation"])
    turn = (tools[0].inv() * tools[1]).as_rotvec()
    one = Follower(ends.limb, ends.branches[ends.limb], first)

    def at(sigma: Array) -> Array:
        turns = scipy.spatial.transform.Rotation.from_rotvec(sigma[:, None] * turn)
        rotations = (tools[0] * turns).as_matrix()
        grasps = above[0] + sigma[:, None] * (above[1] - above[0])
        flange = grasps - graph.robot.tool_length * rotations[:, :, 2], rotations
        return follow(graph, ends, one, poses(*flange), base_rows(path, sigma))

    return at


def _is_feasible(graph: StanceGraph, limb: int, swing: JointCurve, last: Array) -> bool:
    """Return whether a swing ends as it should, within limits and without jumps, at samples."""
    low, high = graph.robot.joint_limits[limb].T
    try:
        joints = swing(SAMPLES)
    except PlanError:
        return False
    inside = (joints >= low - LIMIT_TOLERANCE) & (joints <= high + LIMIT_TOLERANCE)
    return bool(inside.all() and not _jumps(joints) and np.abs(joints[-1] - last).max() < 1e-6)


def _jumps(joints: Array) -> bool:
    """Return whether a joint changes too far between two samples."""
    return bool(np.abs(np.diff(joints, axis=0)).max() > MAX_JUMP)
