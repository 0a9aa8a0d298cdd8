import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import flange, pinocchio_arm, volume

from mlivr_gym import Limb
from mlivr_gym.kinematics.ur import (
    branch_terms,
    forward_kinematics,
    inverse_kinematics,
    jacobian,
    limb_axes,
)

LIMB = Limb()
LENGTHS = LIMB.lengths
ARM = pinocchio_arm(LIMB)
angles = st.lists(st.floats(-np.pi, np.pi), min_size=6, max_size=6).map(np.array)


def solutions(pose):
    out = np.empty((8, 6))
    mask = inverse_kinematics(pose[:3, 3].copy(), pose[:3, :3].copy(), LENGTHS, out)
    return mask, out


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
def test_terms_and_axes_give_the_jacobian_without_joint_angles(q):
    pose = forward_kinematics(q, LENGTHS)[6]
    p, z = pose[:3, 3].copy(), pose[:3, 2].copy()
    mask, out = solutions(pose)
    terms, axes, origins = np.empty((4, 4)), np.empty((6, 3)), np.empty((6, 3))
    branch_terms(p, z, LENGTHS, terms)
    for branch in range(8):
        if not mask >> branch & 1:
            continue
        determinant = volume(flange(ARM, out[branch])[1])
        predicted = abs(LIMB.a2 * LIMB.a3) * np.sqrt(max(terms[branch >> 1, 3], 0.0))
        assert predicted == pytest.approx(determinant, abs=1e-5)
        if determinant > 1e-3:
            assert limb_axes(p, z, LENGTHS, branch, axes, origins)
            built = np.vstack([np.cross(axes, p - origins).T, axes.T])
            np.testing.assert_allclose(built, flange(ARM, out[branch])[1], atol=1e-9)


def test_out_of_reach_has_no_solution():
    pose = np.eye(4)
    pose[:3, 3] = 2.0, 0.0, 0.0
    mask, out = solutions(pose)
    assert mask == 0
    assert np.isnan(out).all()
