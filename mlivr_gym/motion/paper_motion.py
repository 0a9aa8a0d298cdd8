"""The motion of the paper, for steps that are not checked: sampled, and nothing about it is proved.

The base moves straight with its rotation by slerp, and so does the gripper of the moving limb, if
the limb can follow on one branch inside its joint limits; otherwise the limb moves on a line in
joint space. With quintic time scalings (`time_scaling.Durations`) this is the paper's motion. Joint
angles come from inverse kinematics at samples, between which nothing is known.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.base_path import BasePath, base_rows
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.chain import LIMIT_TOLERANCE
from mlivr_gym.kinematics.limb import joints_along
from mlivr_gym.kinematics.poses import poses
from mlivr_gym.motion.joint_path import JointPath
from mlivr_gym.motion.step_ends import StepEnds, normal_knots, step_path
from mlivr_gym.motion.straight_base import (
    cannot_follow,
    enough_knots,
    lever_arms,
    path_of,
    share_used,
)
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.stances.stance_graph import StanceGraph

SAMPLES: Array = np.linspace(0.0, 1.0, 400)
"""Path parameters at which it is checked that limbs can follow."""

TOLERANCE = 2e-4
"""How far lines between knots may move the robot off the samples [m]."""

MAX_JUMP = 0.2
"""Largest change of a joint between two of these samples [rad]; a larger one indicates a
singularity."""

JointCurve = Callable[[Array], Array]
"""Joint angles of all limbs, shape (k, N, 6) [rad], at k path parameters from 0 to 1."""


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


def support_joints(
    graph: StanceGraph, ends: StepEnds, path: BasePath, s: Array, here: Array
) -> Array:
    """Return joint angles while the base moves, at base parameters s, shape (k, N, 6) [rad].

    The base parameters, shape (k,), rise from 0 before the base moves to 1 after it; `here`, shape
    (N, 6), are joint angles at the first. The support limbs hold their points on their branches;
    the moving limb stays as it is. Raises a `PlanError` if a support limb cannot follow the base.
    """
    bases, joints = base_rows(path, s), np.empty((len(s), *here.shape))
    joints[:, ends.limb] = here[ends.limb]
    for limb, point in enumerate(ends.before):
        if limb != ends.limb:
            held = graph.solver.grasps[point : point + 1]["flange"].copy()
            one = Follower(limb, ends.branches[limb], here[limb])
            joints[:, limb] = follow(graph, ends, one, held, bases)
    return joints


class Follower(NamedTuple):
    """A limb on a branch, and joint angles from which on it is followed, shape (6,) [rad]."""

    limb: int
    branch: int
    joints: Array


def follow(
    graph: StanceGraph,
    ends: StepEnds,
    one: Follower,
    flanges: Any,
    bases: Any,
) -> Array:
    """Return joint angles of a limb on its branch along flange and base poses, (k, 6) [rad].

    The poses are rows of `Pose`. Raises a `PlanError` if the branch ends.
    """
    robots = graph.checks.robots
    joints = joints_along(robots, one.limb, bases, flanges, one.branch, one.joints)
    if len(joints) < max(len(bases), len(flanges)):
        raise cannot_follow(graph, ends, one.limb)
    return joints


def dense_knots(robot: RobotSpec, ends: StepEnds, curve: JointCurve, tolerance: float) -> Array:
    """Return knots of a motion of any kind, shape (k, N, 6) [rad]; see `enough_knots`.

    In the middles between them the robot is within `tolerance` [m] of the motion.
    """
    leader = int(ends.limb == 0)
    still = JointPath(
        robot, ends.limb, leader, ends.positions[0], ends.rotations[0], ends.joints[:1], (0,)
    )
    radii = lever_arms(robot, leader)
    others = [limb for limb in range(robot.limbs) if limb != leader]

    def measured(places: Array) -> tuple[Array, float]:
        joints = curve(places)
        lines = 0.5 * (joints[2::2] + joints[:-2:2])
        moved = np.einsum("kij,ij->ki", np.abs(lines - joints[1::2]), radii)
        # What a limb does comes on top of where the leader puts the base, or of another limb.
        most = np.sort(moved[:, others], axis=1)[:, ::-1]
        far = most[:, 0] + np.maximum(moved[:, leader], most[:, 1:2].sum(axis=1))
        return joints, share_used(float(far.max()), float(still.slips(lines).max()), tolerance)

    return enough_knots(measured)
