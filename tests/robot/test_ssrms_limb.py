"""The seven-joint limb of the SSRMS's kind against Pinocchio's model of the published table."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import station_arm
from hypothesis import given, settings
from hypothesis import strategies as st
from robot_texts import one_arm, written

from mlivr_gym import RobotSpec, robot_spec
from mlivr_gym.kinematics.forms import closed_form
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.specification import MLIVR2
from mlivr_gym.simulation.scene import robot_alone, set_configuration

LIMB = replace(robot_spec("ssrms2").limb, held_angle=0.0)
LENGTHS = (7.11, 7.11, 0.5692 + 0.475 + 0.5692, 0.7026, 1.3589)
"""Of booms, offsets and wrist in the published table [m]."""
L_C = 15.0
TURN = st.floats(-1.5 * np.pi, 1.5 * np.pi)
ANGLES = st.lists(TURN, min_size=6, max_size=6).map(np.array)
MANY = settings(max_examples=100, deadline=None)


def flange(limb, q):
    """The flange in the limb's mount by the limb's own kinematics, shape (4, 4)."""
    return limb.base_in_mount @ link_frames(limb, q)[6]


@given(TURN, ANGLES)
@MANY
def test_forward_kinematics_of_all_seven_joints_is_that_of_pinocchio(held, q):
    ours = flange(replace(LIMB, held_angle=held), q)
    np.testing.assert_allclose(ours, station_arm.flange_in_mount(held, q)[0], atol=1e-12)


@pytest.mark.parametrize("held", [0.0, 0.5 * np.pi, -1.0])
def test_the_scene_has_the_links_where_pinocchio_has_the_end_effector(held):
    """The limbs of a robot begin at joint 2; a mount is where joint 1 begins."""
    limb = replace(LIMB, held_angle=held)
    robot = replace(MLIVR2, name="two", limb=limb, mount_radius=0.5, body_size=1.0, tool_length=0.0)
    model, rng = robot_alone(robot).compile(), np.random.default_rng(0)
    data = mujoco.MjData(model)
    for _ in range(10):
        joints = rng.uniform(-2.0, 2.0, (2, 6))
        set_configuration(model, data, np.zeros(3), np.array([1.0, 0, 0, 0]), joints)
        for i, radial in enumerate(([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0])):
            mount = np.column_stack([[0, 0, 1.0], np.cross(radial, [0, 0, 1.0]), radial])
            place = station_arm.transform(mount, 0.5 * np.array(radial))
            truth, site = place @ station_arm.flange_in_mount(held, joints[i])[0], f"limb{i}/flange"
            np.testing.assert_allclose(data.site(site).xpos, truth[:3, 3], atol=1e-9)
            np.testing.assert_allclose(data.site(site).xmat, truth[:3, :3].ravel(), atol=1e-9)


@given(TURN, ANGLES)
@MANY
def test_bounds_of_reach_hold_from_the_mount(held, q):
    limb = replace(LIMB, held_angle=held)
    frame, _ = station_arm.flange_in_mount(held, q)
    assert np.linalg.norm(frame[:3, 3]) <= limb.reach


def published_frames():
    """Frames of the published joints and the end effector at angles 0, joints turning about z."""
    frames, about = station_arm.bodies(np.zeros(7)), ("yzx", "xyz", "zxy")
    axes = [about["xzy".index(axis)] for _, axis in station_arm.JOINTS]
    frames = [
        frame @ station_arm.transform(station_arm.along(letters), (0.0, 0.0, 0.0))
        for frame, letters in zip(frames, axes, strict=True)
    ]
    return [*frames, frames[-1] @ station_arm.transform(np.eye(3), (0.0, 0.0, station_arm.END[0]))]


def test_from_a_urdf_with_joint_1_held_the_arm_has_the_same_lengths(tmp_path):
    """But for that along joint 2, from where the limb begins; the booms' sign is a choice."""
    path = written(tmp_path, one_arm(frames=published_frames()))
    robot = RobotSpec.from_urdf(path, limbs=2, body_size=1.0, mount_radius=2.5, held_joint="joint1")
    figures = closed_form(robot.limb.steps)[0].figures
    found = [abs(figures[name]) for name in ("a2", "a3", "d4", "d5", "d6")]
    np.testing.assert_allclose(found, LENGTHS, atol=1e-6)
