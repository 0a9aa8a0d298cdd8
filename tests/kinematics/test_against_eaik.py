"""Solutions of arms of all closed forms, some with a joint locked, against EAIK."""

from dataclasses import replace

import numpy as np
import oracle
import pinocchio as pin
import pytest
import station_arm
from arms import turned
from branches import arm_of, solutions
from eaik.IK_HP import HPRobot
from wrist_arms import FURTHER, LIMBS, OTHERS, flange_of, pinocchio_wrist_arm

from mlivr_gym import Limb, robot_spec
from mlivr_gym.robot.dh_table import frames_of_dh, ur_dh
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.limb_dynamics import ARMS, arm_limb

MIRRORED = Limb(*frames_of_dh(ur_dh(d4=-0.1333, d5=-0.0997)))
WRISTS = LIMBS | OTHERS | FURTHER


def eaik_arm(model, frame, held=None):
    """EAIK's arm of a model of Pinocchio, by axes and points at 0, and the frame's axes there."""
    data, zero = model.createData(), np.zeros(model.nq)
    pin.framesForwardKinematics(model, data, zero)
    pin.computeJointJacobians(model, data, zero)
    world = pin.ReferenceFrame.WORLD
    axes = np.array(
        [pin.getJointJacobian(model, data, k + 1, world)[3:, k] for k in range(model.nq)]
    )
    end = data.oMf[model.getFrameId(frame)]
    places = np.array([np.zeros(3), *(pose.translation for pose in data.oMi[1:]), end.translation])
    return HPRobot(axes, np.diff(places, axis=0), held), end.rotation


def assert_same_solutions(limb, robot, pose, flange, to_ours):
    """EAIK finds at `pose` as many exact solutions as there are branches at `flange`, and these."""
    mask, ours = solutions(arm_of(limb), flange[:3, 3], flange[:3, :3])
    found = robot.IK(pose)
    exact = [to_ours(q) for q, fit in zip(found.Q, found.is_LS, strict=True) if not fit]
    assert len(exact) == mask.bit_count() > 0
    for q in exact:
        assert min(turned(ours[b], q) for b in range(8) if mask >> b & 1) < 1e-6


def random_angles(seed):
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (30, 6))


@pytest.mark.parametrize("limb", [*map(arm_limb, ARMS), MIRRORED])
def test_eaik_finds_the_same_solutions_of_arms_with_parallel_axes(limb):
    model = oracle.pinocchio_arm(limb)
    robot, axes = eaik_arm(model, "flange")
    for q in random_angles(0):
        flange = oracle.flange(model, q)[0]
        pose = flange.copy()
        pose[:3, :3] = flange[:3, :3] @ axes.T
        assert_same_solutions(limb, robot, pose, flange, lambda angles: angles)


@pytest.mark.parametrize("held", [0.0, 0.7, -2.0])
def test_eaik_finds_the_same_solutions_of_the_published_station_arm_with_joint_1_held(held):
    limb = replace(robot_spec("ssrms2").limb, locked_angle=held)
    robot, _ = eaik_arm(station_arm.MODEL, "end", [(0, held)])
    for angles in random_angles(1):
        pose, q = station_arm.end_of([held, *angles])[0], station_arm.SIGNS * angles
        mount, _ = station_arm.flange_in_mount(held, q + station_arm.ZEROS)
        flange = np.linalg.inv(limb.base_in_mount) @ mount
        assert_same_solutions(
            limb, robot, pose, flange, lambda q: station_arm.SIGNS * q[1:] + station_arm.ZEROS
        )


@pytest.mark.parametrize("name", WRISTS)
def test_eaik_finds_the_same_solutions(name):
    """Arms with a spherical wrist or shoulder, known by their axes and the joint that is locked."""
    limb, model = WRISTS[name], pinocchio_wrist_arm(WRISTS[name])
    held = [(limb.locked_joint - 1, limb.locked_angle)] if limb.locked_joint else None
    robot, axes = eaik_arm(model, "flange", held)
    for q in random_angles(0):
        flange = flange_of(model, limb, q)[0]
        np.testing.assert_allclose(link_frames(limb, q)[6], flange, atol=1e-12)
        pose = limb.base_in_mount @ flange
        pose[:3, :3] = pose[:3, :3] @ axes.T
        assert_same_solutions(limb, robot, pose, flange, limb.moving_angles)
