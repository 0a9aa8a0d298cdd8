import numpy as np
import pytest
from held_paths import FLOOR, GRIP, LIMB, MOUNT, ORIGIN, TOOL, random_ends
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mlivr_gym.kinematics.base_path import (
    SAMPLES,
    STRAIGHT,
    follow,
    relative_rotation,
    within_limits,
)
from mlivr_gym.kinematics.certificate import certify


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
