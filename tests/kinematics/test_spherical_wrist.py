"""Arms with a spherical wrist against Pinocchio models built from their axes."""

import itertools
from dataclasses import asdict, replace

import numpy as np
import pinocchio as pin
import pytest
from branches import arm_of, flange_axis
from branches import solutions as solutions_of
from compiled import called
from hypothesis import example, given, settings
from hypothesis import strategies as st
from oracle import volume
from wrist_arms import IIWA, LIMBS, SIX, flange_of, pinocchio_wrist_arm

from mlivr_gym import RobotSpec
from mlivr_gym.errors import RobotError
from mlivr_gym.kinematics.arm import SPHERICAL_WRIST, JointAxes
from mlivr_gym.kinematics.families import (
    branch_frames,
    branch_terms,
    forward_kinematics,
    joint_axes,
    link_frames,
)
from mlivr_gym.kinematics.manipulability import limb_manipulability
from mlivr_gym.kinematics.spherical_wrist import jacobian

MODELS = {name: pinocchio_wrist_arm(limb) for name, limb in LIMBS.items()}
each_limb = pytest.mark.parametrize("name", LIMBS)
angles = st.lists(st.floats(-np.pi, np.pi), min_size=6, max_size=6).map(np.array)
MANY = settings(max_examples=100, deadline=None)


def solutions(name, pose, *slack):
    return solutions_of(arm_of(LIMBS[name]), pose[:3, 3], pose[:3, :3], *slack)


def turned(a, b):
    """Largest difference of joint angles, whole turns aside."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max()


@each_limb
@given(angles)
@MANY
def test_forward_kinematics_and_jacobian_agree_with_pinocchio(name, q):
    limb = LIMBS[name]
    pose, truth, _ = flange_of(MODELS[name], limb, q)
    found = forward_kinematics(q, limb.lengths, SPHERICAL_WRIST)[6]
    np.testing.assert_allclose(found, pose, atol=1e-12)
    np.testing.assert_allclose(jacobian(q, limb.lengths), truth, atol=1e-12)


def test_joint_angles_are_the_maker_s_but_for_two_signs():
    """The axes of the iiwa are z, y, z, -y, z, y, z; A2 and A6 turn in the other sense here."""
    heights, axes = (0.0, 0.36, 0.36, 0.78, 1.18, 1.18, 1.18), ["z", "y", "z", "-y", "z", "y", "z"]
    q, pose = np.array([0.3, -0.9, 1.2, 0.4, 0.8, -1.1]), pin.SE3.Identity()
    maker = np.array([q[0], -q[1], 0.7, q[2], q[3], -q[4], q[5]])
    last = 0.0
    for angle, height, axis in zip(maker, heights, axes, strict=True):
        about = pin.utils.rotate(axis[-1], -angle if axis[0] == "-" else angle)
        pose = pose * pin.SE3(about, np.array([0.0, 0.0, height - last]))
        last = height
    pose = pose * pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.126]))
    found = forward_kinematics(q, replace(IIWA, held_angle=0.7).lengths, SPHERICAL_WRIST)[6]
    np.testing.assert_allclose(found, pose.homogeneous, atol=1e-12)


def check_all_branches(name, q):
    """Every solution reproduces the pose, and the given angles are among them."""
    limb = LIMBS[name]
    pose, truth, _ = flange_of(MODELS[name], limb, q)
    mask, out = solutions(name, pose)
    assert mask
    for branch in range(8):
        if mask >> branch & 1:
            np.testing.assert_allclose(
                flange_of(MODELS[name], limb, out[branch])[0], pose, atol=1e-7
            )
        else:
            assert np.isnan(out[branch]).all()
    if volume(truth) > 1e-4:
        assert min(turned(out[b], q) for b in range(8) if mask >> b & 1) < 1e-6
    return mask, out


@each_limb
@given(angles)
@settings(max_examples=150, deadline=None)
def test_inverse_kinematics_finds_all_branches_of_random_poses(name, q):
    mask, out = check_all_branches(name, q)
    if volume(jacobian(q, LIMBS[name].lengths)) > 1e-3:
        for a, b in itertools.combinations([b for b in range(8) if mask >> b & 1], 2):
            assert (
                volume(jacobian(out[a], LIMBS[name].lengths)) < 1e-4
                or turned(out[a], out[b]) > 1e-3
            )


@each_limb
def test_inverse_kinematics_of_every_right_angled_configuration(name):
    for quarters in itertools.product(range(4), repeat=5):
        check_all_branches(name, np.array([0, *quarters]) * np.pi / 2)


def searched(name, pose, rng, seeds=400):
    """Joint angles found by Newton's method with Pinocchio from many seeds, each once."""
    limb, model, found = LIMBS[name], MODELS[name], []
    target = pin.SE3(pose)
    for _ in range(seeds):
        q = rng.uniform(-np.pi, np.pi, 6)
        for _ in range(40):
            here, columns, _ = flange_of(model, limb, q)
            error = pin.log6(pin.SE3(here).actInv(target)).vector
            error = np.concatenate([here[:3, :3] @ error[:3], here[:3, :3] @ error[3:]])
            size = np.linalg.norm(error)
            if size < 1e-10:
                break
            step = np.linalg.solve(
                columns.T @ columns + min(1e-2, size**2) * np.eye(6), columns.T @ error
            )
            q = q + step * min(1.0, 1.0 / np.abs(step).max())
        if size < 1e-10 and all(turned(q, other) > 1e-4 for other in found):
            found.append(q)
    return found


@each_limb
def test_a_dense_search_finds_no_more_solutions(name):
    rng = np.random.default_rng(1)
    for _ in range(3):
        q = rng.uniform(-np.pi, np.pi, 6)
        q[4] = rng.uniform(0.5, 2.5)
        pose = flange_of(MODELS[name], LIMBS[name], q)[0]
        mask, out = solutions(name, pose)
        found = searched(name, pose, rng)
        assert len(found) == bin(mask).count("1")
        for one in found:
            assert min(turned(one, out[b]) for b in range(8) if mask >> b & 1) < 1e-6


def test_a_half_turn_of_the_tool_is_a_half_turn_of_joint_6():
    q = np.array([0.3, -1.1, 1.4, 0.2, 0.9, -2.0])
    for name, limb in LIMBS.items():
        pose = forward_kinematics(q, limb.lengths, SPHERICAL_WRIST)[6]
        flipped = pose.copy()
        flipped[:3, :2] *= -1.0
        (mask, a), (flipped_mask, b) = solutions(name, pose), solutions(name, flipped)
        assert mask == flipped_mask
        for branch in range(8):
            if mask >> branch & 1:
                assert turned(a[branch] + [0, 0, 0, 0, 0, np.pi], b[branch]) < 1e-12


@each_limb
@given(angles)
@MANY
@example(np.array([0.3, -1.1, 1.4, 0.2, 0.0, -2.0]))
def test_terms_and_axes_give_the_jacobian_without_joint_angles(name, q):
    """The determinant factorises, and is a lower bound of that of all seven joints."""
    limb, arm, model = LIMBS[name], arm_of(LIMBS[name]), MODELS[name]
    pose = forward_kinematics(q, limb.lengths, SPHERICAL_WRIST)[6]
    mask, out = solutions(name, pose)
    terms, axes = np.empty((4, 4)), JointAxes.row()
    called(branch_terms)(arm, flange_axis(pose), terms)
    for branch in range(8):
        if not mask >> branch & 1:
            continue
        _, truth, every = flange_of(model, limb, out[branch])
        determinant = volume(truth)
        predicted = arm["links"] * np.sqrt(max(terms[branch >> 1, 3], 0.0))
        assert predicted == pytest.approx(determinant, abs=1e-5)
        six, seven = (limb_manipulability(some, 0.87) ** 2 for some in (truth, every))
        assert six <= seven + 1e-12
        if determinant > 1e-3:
            assert called(joint_axes)(arm, flange_axis(pose), branch, axes)
            moments = np.cross(axes["axis"], pose[:3, 3] - axes["point"])
            built = np.vstack([moments.T, axes["axis"].T])
            np.testing.assert_allclose(built, truth, atol=1e-9)


@each_limb
def test_labels_change_only_where_the_determinant_is_zero(name):
    """Along lines in joint space; the branch is that of the solution with the line's angles."""
    limb, rng = LIMBS[name], np.random.default_rng(3)
    for _ in range(10):
        ends = rng.uniform(-np.pi, np.pi, (2, 6))
        last, changes = None, 0
        for q in np.linspace(*ends, 300):
            pose = forward_kinematics(q, limb.lengths, SPHERICAL_WRIST)[6]
            mask, out = solutions(name, pose)
            off = [turned(out[b], q) if mask >> b & 1 else np.inf for b in range(8)]
            here = int(np.argmin(off)), np.linalg.det(jacobian(q, limb.lengths))
            if last is not None and last[0] != here[0]:
                changes += 1
                assert last[1] * here[1] < 0.0 or min(abs(last[1]), abs(here[1])) < 2e-4
            last = here
        assert changes < 20


@each_limb
def test_out_of_reach_has_no_solution(name):
    pose = np.eye(4)
    pose[:3, 3] = 2.0, 0.0, 0.0
    mask, out = solutions(name, pose)
    assert mask == 0
    assert np.isnan(out).all()


@each_limb
@given(angles)
@MANY
@example(np.array([0.3, -1.1, 0.0, 0.2, 0.9, -2.0]))
@example(np.array([0.3, 0.0, 0.0, 0.2, 0.0, -2.0]))
def test_without_slack_singular_postures_alone_are_missing(name, q):
    limb = LIMBS[name]
    pose = forward_kinematics(q, limb.lengths, SPHERICAL_WRIST)[6]
    (mask, out), (strict, same) = solutions(name, pose), solutions(name, pose, 0.0)
    assert strict & ~mask == 0
    for branch in range(8):
        if strict >> branch & 1:
            np.testing.assert_array_equal(same[branch], out[branch])
        elif mask >> branch & 1:
            assert volume(jacobian(out[branch], limb.lengths)) < 1e-3


@each_limb
@given(angles)
@MANY
def test_frames_of_links_are_those_of_forward_kinematics_with_and_without_angles(name, q):
    """The axes of link 6 across that of the flange do not matter."""
    limb, arm = LIMBS[name], arm_of(LIMBS[name])
    truth = forward_kinematics(q, limb.lengths, SPHERICAL_WRIST)
    frames, axes = np.empty((7, 4, 3)), JointAxes.row()
    called(link_frames)(arm, q, frames)
    expected = truth[:, :3, [3, 0, 1, 2]].transpose(0, 2, 1)
    np.testing.assert_allclose(frames[:6], expected[:6], atol=1e-12)
    np.testing.assert_allclose(frames[6, [0, 3]], expected[6, [0, 3]], atol=1e-12)
    mask, out = solutions(name, truth[6], 0.0)
    for branch in range(8):
        if not mask >> branch & 1 or volume(jacobian(out[branch], limb.lengths)) < 1e-3:
            continue
        assert called(branch_frames)(arm, flange_axis(truth[6]), branch, axes, frames)
        expected = forward_kinematics(out[branch], limb.lengths, SPHERICAL_WRIST)
        expected = expected[:, :3, [3, 0, 1, 2]].transpose(0, 2, 1)
        np.testing.assert_allclose(frames[:6], expected[:6], atol=1e-7)
        np.testing.assert_allclose(frames[6, [0, 3]], expected[6, [0, 3]], atol=1e-9)
        np.testing.assert_allclose(frames[6, 1:] @ frames[6, 1:].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(frames[6, 1:]) == pytest.approx(1.0)


@each_limb
def test_no_flange_is_farther_than_the_reach(name):
    limb, rng = LIMBS[name], np.random.default_rng(0)
    flanges = [
        forward_kinematics(q, limb.lengths, SPHERICAL_WRIST)[6, :3, 3]
        for q in rng.uniform(-np.pi, np.pi, (500, 6))
    ]
    assert np.linalg.norm(flanges, axis=1).max() <= limb.reach


def test_a_robot_with_such_limbs_is_written_and_read():
    for limb in (*LIMBS.values(), replace(SIX, held_joint=None)):
        robot = RobotSpec(limb=limb)
        assert RobotSpec.from_dict(robot.to_dict()) == robot
        assert robot.folds == limb.default_folds
    plain = {"family": "spherical_wrist", "held_angle": 0.5}
    assert RobotSpec.from_dict({"limb": plain}).limb == replace(IIWA, held_angle=0.5)
    assert RobotSpec.from_dict({"limb": {"family": "ur"}}) == RobotSpec()
    assert "family" not in asdict(RobotSpec())["limb"]


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"a2": 0.0}, "limb.a2 is 0; the upper arm must have a length"),
        ({"d4": 0.0}, "limb.d4 is 0; the forearm must have a length"),
        ({"a1": 0.1}, "limb.a1 is 0.1; it must be 0 where joint 3 is held"),
        ({"held_joint": 2}, "limb.held_joint is 2; it must be a whole number from 3 to 3"),
        ({"held_joint": None}, "limb.joint_limits has 7 entries; .* has 6 joints"),
        ({"held_angle": 3.0}, "limb.held_angle is 3 rad; joint 3 turns from -2.9"),
        ({"d6": 126000.0}, "limb.d6 is 126000, larger than 100 m"),
        ({"family": "srs"}, "limb.family is 'srs'; valid choices are"),
    ],
)
def test_bad_limbs_are_refused(changes, told):
    with pytest.raises(RobotError, match=told):
        replace(IIWA, **changes)
    with pytest.raises(RobotError, match=told):
        RobotSpec.from_dict({"limb": {"family": "spherical_wrist"} | changes})
    six = {"held_joint": None, "held_angle": 0.4}
    with pytest.raises(RobotError, match=r"limb\.held_angle is 0\.4, but no joint is held"):
        replace(SIX, **six)
