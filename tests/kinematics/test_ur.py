import itertools

import numpy as np
import pytest
from branches import arm_of, flange_axis
from branches import solutions as solutions_of
from compiled import called
from hypothesis import example, given, settings
from hypothesis import strategies as st
from oracle import flange, pinocchio_arm, volume

from mlivr_gym import Limb
from mlivr_gym.kinematics.arm import JointAxes
from mlivr_gym.kinematics.families import branch_terms, joint_axes
from mlivr_gym.kinematics.ur import branch_frames, forward_kinematics, jacobian, link_frames

LIMB = Limb()
LENGTHS = LIMB.lengths
ARM = pinocchio_arm(LIMB)
ROW = arm_of(LIMB)
angles = st.lists(st.floats(-np.pi, np.pi), min_size=6, max_size=6).map(np.array)


def solutions(pose, *slack):
    return solutions_of(ROW, pose[:3, 3], pose[:3, :3], *slack)


def turned(a, b):
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max()


@given(angles)
@settings(max_examples=200, deadline=None)
def test_forward_kinematics_and_jacobian_agree_with_pinocchio(q):
    pose, truth = flange(ARM, q)
    np.testing.assert_allclose(forward_kinematics(q, LENGTHS)[6], pose, atol=1e-12)
    np.testing.assert_allclose(jacobian(q, LENGTHS), truth, atol=1e-12)


def test_jacobian_agrees_with_finite_differences():
    q, step = np.array([0.3, -1.1, 1.4, 0.2, 0.9, -2.0]), 1e-6
    numeric = np.empty((6, 6))
    for k in range(6):
        up, down = (
            forward_kinematics(q + sign * step * np.eye(6)[k], LENGTHS)[6] for sign in (1, -1)
        )
        numeric[:3, k] = (up[:3, 3] - down[:3, 3]) / (2 * step)
        spin = (
            (up[:3, :3] - down[:3, :3]) / (2 * step) @ forward_kinematics(q, LENGTHS)[6, :3, :3].T
        )
        numeric[3:, k] = spin[2, 1], spin[0, 2], spin[1, 0]
    np.testing.assert_allclose(jacobian(q, LENGTHS), numeric, atol=1e-8)


def check_all_branches(q):
    """Every solution reproduces the pose, and the given angles are among them."""
    pose, truth = flange(ARM, q)
    mask, out = solutions(pose)
    assert mask
    for branch in range(8):
        if mask >> branch & 1:
            np.testing.assert_allclose(flange(ARM, out[branch])[0], pose, atol=1e-7)
        else:
            assert np.isnan(out[branch]).all()
    if volume(truth) > 1e-4:
        assert min(turned(out[b], q) for b in range(8) if mask >> b & 1) < 1e-6
    return mask, out


@given(angles)
@settings(max_examples=300, deadline=None)
def test_inverse_kinematics_finds_all_branches_of_random_poses(q):
    mask, out = check_all_branches(q)
    if volume(jacobian(q, LENGTHS)) > 1e-3:
        for a, b in itertools.combinations([b for b in range(8) if mask >> b & 1], 2):
            assert turned(out[a], out[b]) > 1e-3


def test_inverse_kinematics_of_every_right_angled_configuration():
    for quarters in itertools.product(range(4), repeat=6):
        check_all_branches(np.array(quarters) * np.pi / 2)


def test_inverse_kinematics_of_axis_aligned_tools_has_all_eight_branches():
    down = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    full = 0
    for x, y in itertools.product((0.3, 0.4, 0.5), (-0.3, 0.0, 0.3)):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = down, (x, y, -0.1)
        mask, out = solutions(pose)
        for b in range(8):
            if mask >> b & 1:
                np.testing.assert_allclose(flange(ARM, out[b])[0], pose, atol=1e-9)
        full += mask == 0xFF
    assert full == 9


def test_a_half_turn_of_the_tool_is_a_half_turn_of_joint_6():
    q = np.array([0.3, -1.1, 1.4, 0.2, 0.9, -2.0])
    pose = forward_kinematics(q, LENGTHS)[6]
    flipped = pose.copy()
    flipped[:3, :2] *= -1.0
    (mask, a), (flipped_mask, b) = solutions(pose), solutions(flipped)
    assert mask == flipped_mask
    for branch in range(8):
        if mask >> branch & 1:
            assert turned(a[branch] + [0, 0, 0, 0, 0, np.pi], b[branch]) < 1e-12


@given(angles)
@settings(max_examples=200, deadline=None)
@example(np.array([0.3, -1.1, 1.4, 0.2, 0.0, -2.0]))
def test_terms_and_axes_give_the_jacobian_without_joint_angles(q):
    pose = forward_kinematics(q, LENGTHS)[6]
    mask, out = solutions(pose)
    terms, axes = np.empty((4, 4)), JointAxes.row()
    called(branch_terms)(ROW, flange_axis(pose), terms)
    for branch in range(8):
        if not mask >> branch & 1:
            continue
        determinant = volume(flange(ARM, out[branch])[1])
        predicted = abs(LIMB.a2 * LIMB.a3) * np.sqrt(max(terms[branch >> 1, 3], 0.0))
        assert predicted == pytest.approx(determinant, abs=1e-5)
        if determinant > 1e-3:
            assert called(joint_axes)(ROW, flange_axis(pose), branch, axes)
            moments = np.cross(axes["axis"], pose[:3, 3] - axes["point"])
            built = np.vstack([moments.T, axes["axis"].T])
            np.testing.assert_allclose(built, flange(ARM, out[branch])[1], atol=1e-9)


def test_out_of_reach_has_no_solution():
    pose = np.eye(4)
    pose[:3, 3] = 2.0, 0.0, 0.0
    mask, out = solutions(pose)
    assert mask == 0
    assert np.isnan(out).all()


@given(angles)
@settings(max_examples=200, deadline=None)
@example(np.array([0.3, -1.1, 0.0, 0.2, 0.9, -2.0]))
@example(np.array([0.3, -1.1, 1.4, 0.2, 0.0, -2.0]))
def test_without_slack_singular_postures_alone_are_missing(q):
    pose = forward_kinematics(q, LENGTHS)[6]
    (mask, out), (strict, same) = solutions(pose), solutions(pose, 0.0)
    assert strict & ~mask == 0
    for branch in range(8):
        if strict >> branch & 1:
            np.testing.assert_array_equal(same[branch], out[branch])
        elif mask >> branch & 1:
            assert volume(jacobian(out[branch], LENGTHS)) < 1e-3


@given(angles)
@settings(max_examples=200, deadline=None)
def test_frames_of_links_are_those_of_forward_kinematics_with_and_without_angles(q):
    """Frames 2 and 3 of the links lie at the near end of the link, those of the table at the far.

    The axes of link 6 across that of the flange do not matter.
    """
    truth, frames = forward_kinematics(q, LENGTHS), np.empty((7, 4, 3))
    called(link_frames)(ROW, q, frames)
    np.testing.assert_allclose(frames[0], np.vstack([np.zeros(3), np.eye(3)]), atol=1e-12)
    np.testing.assert_allclose(frames[1, 0], truth[1, :3, 3], atol=1e-12)
    np.testing.assert_allclose(frames[2, 0], truth[1, :3, 3], atol=1e-12)
    np.testing.assert_allclose(frames[3, 0], truth[2, :3, 3], atol=1e-12)
    for link in (4, 5, 6):
        np.testing.assert_allclose(frames[link, 0], truth[link, :3, 3], atol=1e-12)
    np.testing.assert_allclose(frames[6, 3], truth[6, :3, 2], atol=1e-12)
    for link in range(7):
        np.testing.assert_allclose(frames[link, 1:] @ frames[link, 1:].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(frames[link, 1:]) == pytest.approx(1.0)
    pose = truth[6]
    axes, built = JointAxes.row(), frames.copy()
    mask, out = solutions(pose, 0.0)
    for branch in range(8):
        if not mask >> branch & 1 or volume(jacobian(out[branch], LENGTHS)) < 1e-3:
            continue
        called(link_frames)(ROW, out[branch], frames)
        assert called(branch_frames)(ROW, flange_axis(pose), branch, axes, built)
        np.testing.assert_allclose(built[:6], frames[:6], atol=1e-7)
        np.testing.assert_allclose(built[6, [0, 3]], frames[6, [0, 3]], atol=1e-9)
        np.testing.assert_allclose(built[6, 1:] @ built[6, 1:].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(built[6, 1:]) == pytest.approx(1.0)
