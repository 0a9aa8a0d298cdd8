"""Queries of a robot of which joints have failed: its graph, and where it is at the start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from mlivr_gym.arguments import ANY_NUMBER, Reader
from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError
from mlivr_gym.postures.given_pose import JOINT_TOLERANCE, given_joints
from mlivr_gym.robot.specification import MOST_LIMBS, RobotSpec
from mlivr_gym.schema import FieldPath, Integer, ListOf
from mlivr_gym.stances.build import in_same_world
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

FailedJoint: TypeAlias = tuple[int, int, float]
"""Limb from 0, joint of its arm from 1 and angle at which it is locked [rad]."""

Start: TypeAlias = tuple[
    Sequence[str | int] | State, Sequence[Any] | None, Sequence[Any] | Array | None
]
"""Points, base pose and joint angles at the start, as `Planner.plan` takes them."""


def _failed_joint(value: Any, place: FieldPath) -> FailedJoint:
    """Return a joint that has failed."""
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise place.refused(value, "limb, joint and angle [rad]")
    return (
        Integer(0, MOST_LIMBS).read(value[0], place.entry(0)),
        Integer(1, 7).read(value[1], place.entry(1)),
        float(ANY_NUMBER.read(value[2], place.entry(2))),
    )


FAILED_JOINT = Reader(_failed_joint)
"""Validator of a `FailedJoint`."""

FAILED_JOINTS = ListOf(FAILED_JOINT, 0, MOST_LIMBS)
"""Validator of several."""


def robot_with_failed_joints(robot: RobotSpec, failed: Sequence[FailedJoint]) -> RobotSpec:
    """Return the robot of which joints have failed, see `RobotSpec.with_failed_joint`.

    Raises a `RobotError` if a limb cannot move without its joints, and a `SettingError` if there is
    no such limb or joint.
    """
    for k, (limb, joint, angle) in enumerate(failed):
        place = FieldPath("failed_joints", SettingError).entry(k)
        Integer(0, robot.limbs - 1).read(limb, place.entry(0))
        Integer(1, len(robot.every_limb[limb].joint_limits)).read(joint, place.entry(1))
        robot = robot.with_failed_joint(limb, joint, angle)
    return robot


def start_with_failed_joints(
    graph: StanceGraph, failed: Sequence[FailedJoint], start: Start
) -> tuple[StanceGraph, Start]:
    """Return the graph of the robot that results, and a start of the whole robot in its terms.

    Other joints move in that robot, so that joint angles are those of others. Raises as
    `robot_with_failed_joints`, and a `SettingError` if a joint that has failed is not at its angle
    at the start.
    """
    robot = robot_with_failed_joints(graph.robot, failed)
    start = _start_of(graph, robot, failed, start)
    return in_same_world(graph, robot=robot), start


def _start_of(
    graph: StanceGraph, robot: RobotSpec, failed: Sequence[FailedJoint], start: Start
) -> Start:
    """Return a start of the whole robot in the terms of one that holds other joints."""
    points, pose, joints = start
    if isinstance(points, State):
        if not (pose is None and joints is None):
            return start  # refused as without failed joints
        position, quaternion, joints = graph.configuration(graph.validated_state(points))
        points, pose = graph.ids(points.stance), (*position.tolist(), *quaternion.tolist())
    if joints is None:
        return points, pose, None
    moving = given_joints(graph.robot, joints)
    limbs = zip(graph.robot.every_limb, moving, strict=True)
    every = [limb.all_angles(angles) for limb, angles in limbs]
    for limb, joint, angle in failed:
        there = float(every[limb][joint - 1])
        if abs(there - angle) > JOINT_TOLERANCE:
            raise SettingError(
                f"failed_joints: joint {joint} of limb {limb} is at {there:.4f} rad at the start, "
                f"not at {angle:.4f} rad"
            )
    limbs = zip(robot.every_limb, every, strict=True)
    return points, pose, np.array([limb.moving_angles(angles) for limb, angles in limbs])
