"""Arms with three parallel axes, of six joints or with a first one that is held, against EAIK."""

from dataclasses import replace

import numpy as np
import oracle
import pinocchio as pin
import pytest
import station_arm
from arms import turned
from branches import arm_of, solutions
from eaik.IK_HP import HPRobot

from mlivr_gym import Limb, SsrmsLimb
from mlivr_gym.robot.limb_dynamics import ARMS, arm_limb


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


def assert_same_solutions(limb, robot, pose, flange, all_angles):
    """EAIK finds at `pose` as many exact solutions as there are branches at `flange`, and these."""
    mask, ours = solutions(arm_of(limb), flange[:3, 3], flange[:3, :3])
    found = robot.IK(pose)
    exact = [q for q, fit in zip(found.Q, found.is_LS, strict=True) if not fit]
    assert len(exact) == mask.bit_count() > 0
    every = [all_angles(ours[branch]) for branch in range(8) if mask >> branch & 1]
    for q in exact:
        assert min(turned(one, q) for one in every) < 1e-6


@pytest.mark.parametrize("limb", [*map(arm_limb, ARMS), Limb(d4=-0.1333, d5=-0.0997)])
def test_eaik_finds_the_same_solutions(limb):
    model, rng = oracle.pinocchio_arm(limb), np.random.default_rng(0)
    robot, axes = eaik_arm(model, "flange")
    for q in rng.uniform(-np.pi, np.pi, (30, 6)):
        flange = oracle.flange(model, q)[0]
        pose = flange.copy()
        pose[:3, :3] = flange[:3, :3] @ axes.T
        assert_same_solutions(limb, robot, pose, flange, lambda angles: angles)


@pytest.mark.parametrize("held", [0.0, 0.7, -2.0])
def test_eaik_finds_the_same_solutions_of_the_published_station_arm_with_joint_1_held(held):
    limb, rng = replace(SsrmsLimb(), held_angle=held), np.random.default_rng(1)
    robot, _ = eaik_arm(station_arm.MODEL, "end", [(0, held)])
    axes, origin = limb.base_in_mount
    mount = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    for angles in rng.uniform(-np.pi, np.pi, (30, 6)):
        pose = station_arm.end_of([held, *angles])[0]
        flange = np.eye(4)
        turn = mount @ pose[:3, :3] @ station_arm.along(station_arm.LINKS[6][0])
        flange[:3, :3] = axes.T @ turn
        flange[:3, 3] = axes.T @ (mount @ pose[:3, 3] - origin)
        assert_same_solutions(
            limb, robot, pose, flange,
            lambda q: np.array([held, *station_arm.SIGNS * (q - station_arm.ZEROS)]),
        )  # fmt: skip
