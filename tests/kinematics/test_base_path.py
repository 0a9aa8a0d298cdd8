import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from mlivr_gym import Limb, robot_spec
from mlivr_gym.kinematics.base_path import (
    ARC,
    SAMPLES,
    STRAIGHT,
    follow,
    relative_rotation,
    within_limits,
)
from mlivr_gym.kinematics.certificate import certify
from mlivr_gym.kinematics.holding import base_path
from mlivr_gym.kinematics.ur import inverse_kinematics, jacobian

ROBOT = robot_spec("mlivr2")
LIMB = Limb()
FLOOR = 0.03 * 0.87**3
MOUNT, ORIGIN = ROBOT.mount_rotations[0].copy(), ROBOT.mount_positions[0].copy()
TOOL = np.diag([1.0, -1.0, -1.0])
GRIP = np.array([0.55, 0.0, -0.6])


def random_ends(seed):
    rng = np.random.default_rng(seed)
    ends = []
    for _ in range(2):
        rotation = Rotation.from_rotvec(rng.normal(size=3) * 0.35).as_matrix()
        ends += [rng.uniform([-0.35, -0.35, -0.15], [0.35, 0.35, 0.25]), rotation]
    return ends


def determinants(ends, kind, pivot, branch, samples=400):
    """|det J| of one branch at points of the path; 0 where it does not exist."""
    positions, rotations = base_path(*ends, kind, pivot, np.linspace(0, 1, samples))
    out, q = np.zeros(samples), np.empty((8, 6))
    for k in range(samples):
        mount = rotations[k] @ MOUNT
        p = mount.T @ (GRIP - positions[k] - rotations[k] @ ORIGIN)
        if (
            inverse_kinematics(p, np.ascontiguousarray(mount.T @ TOOL), LIMB.lengths, q) >> branch
            & 1
        ):
            out[k] = abs(np.linalg.det(jacobian(q[branch], LIMB.lengths)))
    return out


@pytest.mark.parametrize("kind", [STRAIGHT, ARC])
@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_certified_choices_keep_the_floor_at_every_point(kind, seed):
    ends, pivot = random_ends(seed), np.array([0.55, 0.0, -0.65])
    approach = TOOL[:, 2].copy()
    classes = certify(GRIP, approach, *ends, kind, pivot, MOUNT, ORIGIN, LIMB.lengths, FLOOR, 15)
    for c in range(4):
        least = determinants(ends, kind, pivot, 2 * c).min()
        if classes >> c & 1:
            assert least >= FLOOR * (1 - 1e-9)
        else:
            # The proof may only fail close to the floor: conservatism is bounded.
            assert least < FLOOR * 1.02


@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_certificates_are_the_same_in_both_directions(seed):
    ends, pivot = random_ends(seed), np.zeros(3)
    approach = TOOL[:, 2].copy()
    there = certify(GRIP, approach, *ends, STRAIGHT, pivot, MOUNT, ORIGIN, LIMB.lengths, FLOOR, 15)
    back = certify(
        GRIP,
        approach,
        *ends[2:],
        *ends[:2],
        STRAIGHT,
        pivot,
        MOUNT,
        ORIGIN,
        LIMB.lengths,
        FLOOR,
        15,
    )
    assert there == back


@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_followed_joints_are_continuous_and_stay_on_their_branch(seed):
    ends, pivot = random_ends(seed), np.zeros(3)
    classes = certify(
        GRIP, TOOL[:, 2].copy(), *ends, STRAIGHT, pivot, MOUNT, ORIGIN, LIMB.lengths, FLOOR, 15
    )
    for c in range(4):
        if not classes >> c & 1:
            continue
        coarse, fine = [], []
        for samples, store in ((SAMPLES, coarse), (256, fine)):
            q, low, high = np.full(6, np.nan), np.full(6, np.inf), np.full(6, -np.inf)
            assert follow(
                GRIP,
                TOOL,
                *ends,
                STRAIGHT,
                pivot,
                MOUNT,
                ORIGIN,
                LIMB.lengths,
                2 * c,
                samples,
                np.empty(6),
                q,
                low,
                high,
            )
            store += [q, low, high]
        np.testing.assert_allclose(coarse[0], fine[0], atol=1e-9)
        assert (coarse[1] >= fine[1] - 1e-9).all()
        assert (coarse[2] <= fine[2] + 1e-9).all()


def test_base_path_is_slerp_on_a_line_or_on_an_arc():
    ends, s = random_ends(3), np.linspace(0, 1, 11)
    positions, rotations = base_path(*ends, STRAIGHT, np.zeros(3), s)
    np.testing.assert_allclose(positions, ends[0] + s[:, None] * (ends[2] - ends[0]), atol=1e-12)
    slerp = Slerp([0, 1], Rotation.from_matrix(np.array([ends[1], ends[3]])))
    np.testing.assert_allclose(rotations, slerp(s).as_matrix(), atol=1e-12)
    pivot = np.array([0.55, 0.0, -0.65])
    positions, _ = base_path(*ends, ARC, pivot, s)
    lengths = np.linalg.norm(positions - pivot, axis=1)
    np.testing.assert_allclose(np.diff(lengths, 2), 0.0, atol=1e-12)
    np.testing.assert_allclose(positions[[0, -1]], [ends[0], ends[2]], atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi])
def test_relative_rotation_of_any_angle(angle):
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    start = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix()
    found = np.empty(3)
    value = relative_rotation(start, start @ Rotation.from_rotvec(angle * axis).as_matrix(), found)
    assert value == pytest.approx(angle, abs=1e-7)
    turned = Rotation.from_rotvec(value * found).as_matrix()
    np.testing.assert_allclose(turned, Rotation.from_rotvec(angle * axis).as_matrix(), atol=1e-7)


def test_joint_limits_take_branches_away():
    ends = next(
        ends
        for ends in map(random_ends, range(100))
        if certify(
            GRIP,
            TOOL[:, 2].copy(),
            *ends,
            STRAIGHT,
            np.zeros(3),
            MOUNT,
            ORIGIN,
            LIMB.lengths,
            FLOOR,
            15,
        )
    )
    here = (GRIP, TOOL, *ends, STRAIGHT, np.zeros(3), MOUNT, ORIGIN, LIMB.lengths)
    wide = within_limits(*here, LIMB.limits, 0xFFFF)
    assert wide
    for bit in range(16):
        if not wide >> bit & 1:
            continue
        q, low, high = np.full(6, np.nan), np.full(6, np.inf), np.full(6, -np.inf)
        follow(*here, bit & 7, 64, np.empty(6), q, low, high)
        shift = np.where(np.arange(6) == 5, np.pi * (bit >> 3), 0.0)
        tight = np.stack([low + shift - 0.01, high + shift + 0.01], axis=1)
        assert within_limits(*here, tight, 1 << bit) == 1 << bit
        tight[2, 1] = low[2] + 0.3 * (high[2] - low[2])
        if high[2] - low[2] > 1e-3:
            assert within_limits(*here, tight, 1 << bit) == 0
