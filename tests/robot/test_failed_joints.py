"""Robots of which a joint has failed: the limb is the same arm with another joint locked."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from wrist_arms import IIWA, flange_of, pinocchio_wrist_arm

from mlivr_gym import RobotSpec, robot_spec
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.limb import link_frames

ROBOT = replace(robot_spec("mlivr2"), name="pair", limb=replace(IIWA, locked_angle=0.8),
                folds=IIWA.default_folds)  # fmt: skip
ANGLES = np.array([0.3, -0.9, 0.8, 1.2, -0.4, 0.7, 0.1])


@pytest.mark.parametrize("joint", [1, 2, 3, 5, 6])
def test_the_flange_stays_where_it_is_when_a_joint_fails(joint):
    """By Pinocchio's model of all seven joints, seen from the body, in the same angles."""
    robot = ROBOT.with_failed_joint(0, joint, ANGLES[joint - 1])
    model, seen = pinocchio_wrist_arm(IIWA), []
    for spec in (ROBOT, robot):
        limb = spec.every_limb[0]
        moving = limb.moving_angles(ANGLES)
        np.testing.assert_allclose(limb.all_angles(moving), ANGLES)
        flange = link_frames(limb, moving)[-1]
        mount = pin.SE3(spec.mount_rotations[0], spec.mount_positions[0]).homogeneous
        seen.append(mount @ flange)
    pose = flange_of(model, ROBOT.limb, ROBOT.limb.moving_angles(ANGLES))[0]
    mount = pin.SE3(ROBOT.mount_rotations[0], ROBOT.mount_positions[0]).homogeneous
    np.testing.assert_allclose(seen, [mount @ pose] * 2, atol=1e-12)
    assert robot.limb == ROBOT.limb
    assert robot.every_limb[1] == ROBOT.limb
    np.testing.assert_allclose(robot.mount_positions[1], ROBOT.mount_positions[1], atol=1e-12)
    assert RobotSpec.from_dict(robot.to_dict()) == robot


def test_masses_stay_known_where_the_locked_joint_itself_fails():
    robot = robot_spec("mlivr2-iiwa")
    again = robot.with_failed_joint(1, 3, 0.5)
    assert again.dynamics_of(1) == robot.dynamics_of(0)
    assert again.mounted[1].capsules == robot.mounted[0].capsules
    other = robot.with_failed_joint(1, 1, 0.5)
    assert other.dynamics_of(0) == robot.dynamics_of(0)
    assert other.mounted[1].dynamics is None
    with pytest.raises(RobotError, match="cannot be simulated"):
        other.dynamics_of(1)


def test_joints_of_two_limbs_fail_one_after_the_other_and_two_of_one_limb_are_refused():
    robot = ROBOT.with_failed_joint(0, 2, -0.9)
    both = robot.with_failed_joint(1, 5, -0.4)
    held = [(limb.locked_joint, limb.locked_angle) for limb in both.every_limb]
    assert held == [(2, -0.9), (5, -0.4)]
    other = ROBOT.with_failed_joint(1, 5, -0.4).with_failed_joint(0, 2, -0.9)
    assert replace(other, name=both.name) == both
    assert RobotSpec.from_dict(both.to_dict()) == both
    assert both.with_failed_joint(0, 2, -0.9) == both
    for given, words in (
        ((0, 5, 0.3), "limb 0 has joint 2 failed at -0.9 rad already; with joint 5 failed at 0.3"),
        ((0, 2, 0.3), "limb 0 has joint 2 failed at -0.9 rad already; with joint 2 failed at 0.3"),
    ):  # fmt: skip
        with pytest.raises(RobotError, match=words):
            both.with_failed_joint(*given)
    with pytest.raises(
        RobotError, match=r"locked_angle is 0.5 rad; joint 2 turns from -0.9 to -0.9"
    ):
        replace(robot.every_limb[0], locked_angle=0.5)
