"""Every operation of an arm on a second one: that of a space station, its first joint locked.

It is of the form of the UR arms, with other lengths, and `station_arm` has it as published.
"""

from dataclasses import replace

import numpy as np
import pytest
import station_arm
from branches import arm_of, flange_axis, solutions
from compiled import called
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import volume
from scipy.spatial.transform import Rotation
from station_arm import LIMB, SIGNS, ZEROS, links

from mlivr_gym import GraspMap, robot_spec, stance_graph
from mlivr_gym.kinematics.arm import JointAxes
from mlivr_gym.kinematics.families import (
    branch_frames,
    branch_terms,
    forward_kinematics,
    joint_axes,
    link_frames,
)
from mlivr_gym.kinematics.manipulability import limb_manipulability

ARM = arm_of(LIMB)
FAR = 1e-2 * abs(LIMB.a2 * LIMB.a3)
"""Volume of the Jacobian from which a posture is not close to a singular one [m^3]."""
L_C = 7.11
TURN = st.floats(-1.5 * np.pi, 1.5 * np.pi)
"""The published joints turn by 270 degrees each way."""
ANGLES = st.lists(TURN, min_size=6, max_size=6).map(np.array)
MANY = settings(max_examples=200, deadline=None)


def published_volume(locked, q):
    """`|det J|` of the published arm without column 1 [m^3], at the limb's joint angles."""
    return volume(station_arm.jacobian([locked, *SIGNS * (q - ZEROS)])[:, 1:])


def turned(a, b):
    """Largest difference of joint angles, whole turns aside."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max()


@given(TURN, ANGLES)
@MANY
def test_forward_kinematics_is_that_of_the_published_arm(locked, q):
    np.testing.assert_allclose(
        forward_kinematics(q, LIMB.lengths)[6], links(locked, q)[6], atol=1e-12
    )


@given(TURN, ANGLES)
@MANY
def test_every_branch_reaches_the_flange_and_one_has_the_angles(locked, q):
    pose = links(locked, q)[6]
    mask, out = solutions(ARM, pose[:3, 3], pose[:3, :3], 0.0)
    for branch in range(8):
        if mask >> branch & 1:
            np.testing.assert_allclose(links(locked, out[branch])[6], pose, atol=1e-9)
    if published_volume(locked, q) > FAR:
        assert mask
        assert min(turned(out[b], q) for b in range(8) if mask >> b & 1) < 1e-8


@given(TURN, ANGLES)
@MANY
def test_determinant_and_w_m_are_those_of_the_jacobian_without_its_first_column(locked, q):
    pose = links(locked, q)[6]
    mask, out = solutions(ARM, pose[:3, 3], pose[:3, :3], 0.0)
    terms = np.empty((4, 4))
    called(branch_terms)(ARM, flange_axis(pose), terms)
    for branch in range(8):
        if not mask >> branch & 1:
            continue
        ours = abs(LIMB.a2 * LIMB.a3) * np.sqrt(max(terms[branch >> 1, 3], 0.0))
        truth = published_volume(locked, out[branch])
        assert ours == pytest.approx(truth, rel=1e-7, abs=1e-4)
        jacobian = station_arm.jacobian([locked, *SIGNS * (out[branch] - ZEROS)])[:, 1:]
        w_m = limb_manipulability(jacobian, L_C)
        assert ours / L_C**3 == pytest.approx(w_m, rel=1e-7, abs=1e-6)


@given(TURN, ANGLES)
@MANY
def test_joint_axes_are_those_of_the_published_arm(locked, q):
    pose = links(locked, q)[6]
    mask, out = solutions(ARM, pose[:3, 3], pose[:3, :3], 0.0)
    axes = JointAxes.row()
    for branch in range(8):
        if not mask >> branch & 1 or published_volume(locked, out[branch]) < FAR:
            continue
        assert called(joint_axes)(ARM, flange_axis(pose), branch, axes)
        poses = station_arm.bodies([locked, *SIGNS * (out[branch] - ZEROS)])
        base = poses[0] @ station_arm.transform(np.eye(3), station_arm.LINKS[0][1])
        seen = np.linalg.inv(base) @ poses[1:]
        letters = ["xyz".index(axis) for _, axis in station_arm.JOINTS[1:]]
        truth = SIGNS[:, None] * seen[np.arange(6), :3, letters]
        np.testing.assert_allclose(axes["axis"], truth, atol=1e-9)
        # Any point of an axis will do.
        off = np.cross(axes["point"] - seen[:, :3, 3], truth)
        np.testing.assert_allclose(off, 0.0, atol=1e-8)


@given(TURN, ANGLES)
@MANY
def test_link_frames_are_those_of_the_published_bodies(locked, q):
    """Those of link 6 across the flange axis do not matter."""
    truth, frames, axes = links(locked, q), np.empty((7, 4, 3)), JointAxes.row()
    called(link_frames)(ARM, q, frames)
    expected = truth[:, :3, [3, 0, 1, 2]].transpose(0, 2, 1)
    np.testing.assert_allclose(frames[:6], expected[:6], atol=1e-12)
    np.testing.assert_allclose(frames[6, [0, 3]], expected[6, [0, 3]], atol=1e-12)
    pose = truth[6]
    mask, out = solutions(ARM, pose[:3, 3], pose[:3, :3], 0.0)
    for branch in range(8):
        if not mask >> branch & 1 or published_volume(locked, out[branch]) < FAR:
            continue
        assert called(branch_frames)(ARM, flange_axis(pose), branch, axes, frames)
        expected = links(locked, out[branch])[:, :3, [3, 0, 1, 2]].transpose(0, 2, 1)
        np.testing.assert_allclose(frames[:6], expected[:6], atol=1e-8)
        np.testing.assert_allclose(frames[6, [0, 3]], expected[6, [0, 3]], atol=1e-12)


@pytest.fixture(scope="module")
def truss():
    """Fifteen points 3 m apart on a plane."""
    points = [
        {
            "id": f"{row}:{k}",
            "face": "deck",
            "position": [3.0 * k, 3.0 * row, 0.0],
            "normal": [0, 0, 1],
            "rail": [1, 0, 0],
        }
        for row in range(3)
        for k in range(5)
    ]
    return GraspMap.from_dict({"name": "truss", "points": points})


def test_a_robot_with_two_such_arms_holds_stances_of_a_map_of_its_size(truss):
    """Each limb of each stance reaches its grasp on each of its branches, as published."""
    robot = replace(
        robot_spec("mlivr2"), name="station", limb=LIMB, mount_radius=0.5, body_size=1.0,
        tool_length=0.5, characteristic_length=7.0, span=15.0, grasp_separation=1.0, lift=0.5,
        heights=(4.0, 5.0, 6.0, 7.0),
    )  # fmt: skip
    graph = stance_graph(truss, robot)
    assert len(graph) > 50
    for stance in graph.points:
        state = graph.state(stance.tolist())
        position, quaternion, joints = graph.configuration(state)
        base = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        for i, point in enumerate(stance):
            frame = links(0.0, joints[i])[6]
            tip = frame[:3, 3] + robot.tool_length * frame[:3, 2]
            world = position + base @ (robot.mount_positions[i] + robot.mount_rotations[i] @ tip)
            np.testing.assert_allclose(world, truss.positions[point], atol=1e-9)
            axis = base @ robot.mount_rotations[i] @ frame[:3, 2]
            np.testing.assert_allclose(axis, -truss.normals[point], atol=1e-9)
    steps = graph.successors(graph.state(graph.points[0].tolist()))
    assert len(steps)
