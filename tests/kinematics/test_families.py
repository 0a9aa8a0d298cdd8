"""Every operation of arms of all families against Pinocchio models built from their tables."""

import itertools

import numpy as np
import pytest
import wrist_arms
from arms import ARMS, jacobian, truth, turned
from branches import arm_of, branch_of, flange_axis
from branches import solutions as solutions_of
from compiled import called
from hypothesis import example, given, settings
from hypothesis import strategies as st
from oracle import volume

from mlivr_gym.kinematics import chain
from mlivr_gym.kinematics.inverse import branch_frames, branch_sizes
from mlivr_gym.kinematics.manipulability import limb_manipulability
from mlivr_gym.robot.limb import link_frames

each_arm = pytest.mark.parametrize("name", ARMS)
angles = st.lists(st.floats(-np.pi, np.pi), min_size=6, max_size=6).map(np.array)
MANY = settings(max_examples=60, deadline=None)


def solutions(name, pose, *slack):
    return solutions_of(arm_of(ARMS[name]), pose[:3, 3], pose[:3, :3], *slack)


def regular(name):
    """Volume of the Jacobian from which a posture is not close to a singular one [m^3]."""
    return 1e-3 * (7.11**3 if name == "station" else 1.0)


@each_arm
@given(angles)
@MANY
def test_frames_along_the_links_lead_to_the_flange_of_pinocchio(name, q):
    np.testing.assert_allclose(link_frames(ARMS[name], q)[6], truth(ARMS[name], q)[0], atol=1e-12)


def check_all_branches(name, q):
    """Every solution reproduces the pose, and the given angles are among them."""
    pose, columns, _ = truth(ARMS[name], q)
    mask, out = solutions(name, pose)
    assert mask
    for branch in range(8):
        if mask >> branch & 1:
            np.testing.assert_allclose(truth(ARMS[name], out[branch])[0], pose, atol=1e-7)
        else:
            assert np.isnan(out[branch]).all()
    if volume(columns) > 0.1 * regular(name):
        assert min(turned(out[b], q) for b in range(8) if mask >> b & 1) < 1e-6
    return mask, out


@each_arm
@given(angles)
@settings(max_examples=100, deadline=None)
def test_inverse_kinematics_finds_all_branches_of_random_poses(name, q):
    mask, out = check_all_branches(name, q)
    if volume(jacobian(ARMS[name], q)) > regular(name):
        for a, b in itertools.combinations([b for b in range(8) if mask >> b & 1], 2):
            singular = volume(jacobian(ARMS[name], out[a])) < 0.1 * regular(name)
            assert singular or turned(out[a], out[b]) > 1e-3


@each_arm
def test_inverse_kinematics_of_every_right_angled_configuration(name):
    for quarters in itertools.product(range(4), repeat=4):
        others = sum(quarters) % 4, quarters[0] ^ quarters[3]
        check_all_branches(name, np.array([others[0], *quarters, others[1]]) * np.pi / 2)


def test_inverse_kinematics_of_axis_aligned_tools_has_all_eight_branches():
    down = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    for x, y in itertools.product((0.3, 0.4, 0.5), (-0.3, 0.0, 0.3)):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = down, (x, y, -0.1)
        mask, out = solutions("ur5e", pose)
        assert mask == 0xFF
        for q in out:
            np.testing.assert_allclose(truth(ARMS["ur5e"], q)[0], pose, atol=1e-9)


@each_arm
def test_no_flange_is_farther_than_the_reach_and_none_there_has_a_solution(name):
    limb, rng = ARMS[name], np.random.default_rng(0)
    flanges = [link_frames(limb, q)[6, :3, 3] for q in rng.uniform(-np.pi, np.pi, (500, 6))]
    assert np.linalg.norm(flanges, axis=1).max() <= limb.reach
    pose = np.eye(4)
    pose[0, 3] = 1.1 * limb.reach
    mask, out = solutions(name, pose)
    assert mask == 0
    assert np.isnan(out).all()


@each_arm
@given(angles)
@MANY
@example(np.array([0.3, -1.1, 1.4, 0.2, 0.0, -2.0]))
def test_sizes_and_frames_give_the_jacobian_without_joint_angles(name, q):
    """The determinant factorises, and is a lower bound of that of all seven joints."""
    arm, pose = arm_of(ARMS[name]), link_frames(ARMS[name], q)[6]
    slack, close = ((0.0,), 1e-4) if name == "station" else ((), 1e-5)
    mask, out = solutions(name, pose, *slack)
    sizes, frames = np.empty(4), np.empty((7, 4, 3))
    called(branch_sizes)(arm, flange_axis(pose), sizes)
    for branch in range(8):
        if not mask >> branch & 1:
            continue
        _, columns, every = truth(ARMS[name], out[branch])
        determinant = volume(columns)
        assert sizes[branch >> 1] == pytest.approx(determinant, rel=1e-7, abs=close)
        six, seven = (limb_manipulability(some, 0.87) ** 2 for some in (columns, every))
        assert six <= seven + 1e-12
        if determinant > regular(name):
            assert called(branch_frames)(arm, flange_axis(pose), branch, frames)
            moments = np.cross(frames[1:, 3], pose[:3, 3] - frames[1:, 0])
            built = np.vstack([moments.T, frames[1:, 3].T])
            np.testing.assert_allclose(built, columns, atol=1e-9)


@each_arm
@given(angles)
@MANY
@example(np.array([0.3, -1.1, 0.0, 0.2, 0.9, -2.0]))
@example(np.array([0.3, -1.1, 1.4, 0.2, 0.0, -2.0]))
@example(np.array([0.3, 0.0, 0.0, 0.2, 0.0, -2.0]))
def test_without_slack_singular_postures_alone_are_missing(name, q):
    pose = link_frames(ARMS[name], q)[6]
    (mask, out), (strict, same) = solutions(name, pose), solutions(name, pose, 0.0)
    assert strict & ~mask == 0
    for branch in range(8):
        if strict >> branch & 1:
            np.testing.assert_array_equal(same[branch], out[branch])
        elif mask >> branch & 1:
            assert volume(jacobian(ARMS[name], out[branch])) < regular(name)


@each_arm
@given(angles)
@MANY
def test_frames_of_links_are_those_of_forward_kinematics_with_and_without_angles(name, q):
    """The axes of link 6 across that of the flange do not matter."""
    limb, arm, form = ARMS[name], arm_of(ARMS[name]), link_frames(ARMS[name], q)
    found, built = np.empty((7, 4, 3)), np.empty((7, 4, 3))
    called(chain.link_frames)(arm, q, found)
    np.testing.assert_allclose(found[:, 0], form[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(found[6, 3], form[6, :3, 2], atol=1e-12)
    np.testing.assert_allclose(found[:6, 1:], form[:6, :3, :3].transpose(0, 2, 1), atol=1e-12)
    for turn in found[:, 1:]:
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1.0)
    mask, out = solutions(name, form[6], 0.0)
    for branch in range(8):
        if not mask >> branch & 1 or volume(jacobian(limb, out[branch])) < regular(name):
            continue
        called(chain.link_frames)(arm, out[branch], found)
        assert called(branch_frames)(arm, flange_axis(form[6]), branch, built)
        np.testing.assert_allclose(built[:6], found[:6], atol=1e-7)
        np.testing.assert_allclose(built[6, [0, 3]], found[6, [0, 3]], atol=1e-9)
        np.testing.assert_allclose(built[6, 1:] @ built[6, 1:].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(built[6, 1:]) == pytest.approx(1.0)


@pytest.mark.parametrize("name", wrist_arms.LIMBS)
def test_labels_change_only_where_the_determinant_is_zero(name):
    """Along lines in joint space; the branch is that of the solution with the line's angles."""
    limb, rng = ARMS[name], np.random.default_rng(3)
    for _ in range(4):
        ends = rng.uniform(-np.pi, np.pi, (2, 6))
        last, changes = None, 0
        for q in np.linspace(*ends, 300):
            here = (
                branch_of(arm_of(limb), link_frames(limb, q)[6], q),
                np.linalg.det(jacobian(limb, q)),
            )
            if last is not None and last[0] != here[0]:
                changes += 1
                assert last[1] * here[1] < 0.0 or min(abs(last[1]), abs(here[1])) < 2e-4
            last = here
        assert changes < 20
