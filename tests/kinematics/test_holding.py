"""Joint angles of limbs that hold along base paths, and joint limits."""

from dataclasses import replace

import numpy as np
import pytest
from compiled import called
from held_paths import EVERY_BRANCH, FLANGE, FLOOR, LIMB, mounted, path_between, random_ends
from hypothesis import given, settings
from hypothesis import strategies as st

from mlivr_gym.kinematics.base_path import STRAIGHT
from mlivr_gym.kinematics.certificate import Proof, certify
from mlivr_gym.kinematics.holding import (
    SAMPLES,
    Holding,
    Track,
    begin,
    follow,
    hold_mask,
    within_limits,
)

HERE = mounted()


def certified(path):
    return called(certify)(HERE, FLANGE, path, FLOOR, EVERY_BRANCH, Proof.row())


def followed(path, branch, samples):
    """What is followed from the start of a path on."""
    track = Track.row()
    called(begin)(track)
    assert called(follow)(HERE, FLANGE, path, branch, samples, track)
    return track


@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_followed_joints_are_continuous_and_stay_on_their_branch(seed):
    path = path_between(random_ends(seed), STRAIGHT)
    branches = certified(path)
    for c in range(4):
        if not branches >> (2 * c) & 1:
            continue
        coarse, fine = (followed(path, 2 * c, samples) for samples in (int(SAMPLES), 256))
        np.testing.assert_allclose(coarse["q"], fine["q"], atol=1e-9)
        np.testing.assert_array_equal(coarse["first"], followed(path, 2 * c, 0)["q"])
        assert (coarse["low"] >= fine["low"] - 1e-9).all()
        assert (coarse["high"] <= fine["high"] + 1e-9).all()


def test_joint_limits_take_branches_away():
    paths = (path_between(random_ends(seed), STRAIGHT) for seed in range(100))
    path = next(path for path in paths if certified(path))

    def inside(limits, mask):
        arm = mounted(replace(LIMB, joint_limits=tuple(map(tuple, limits.tolist()))))
        found = called(within_limits)(arm, FLANGE, path, mask, Track.row())
        both = called(hold_mask)(arm, FLANGE, path, FLOOR, mask, Holding.row())
        assert both == found & certified(path)
        return found

    wide = inside(LIMB.limits, EVERY_BRANCH)
    assert wide
    for bit in range(16):
        if not wide >> bit & 1:
            continue
        track = followed(path, bit & 7, 64)
        low, high = track["low"], track["high"]
        shift = np.where(np.arange(6) == 5, np.pi * (bit >> 3), 0.0)
        tight = np.stack([low + shift - 0.01, high + shift + 0.01], axis=1)
        assert inside(tight, 1 << bit) == 1 << bit
        assert inside(tight, EVERY_BRANCH) >> bit & 1
        tight[2, 1] = low[2] + 0.3 * (high[2] - low[2])
        if high[2] - low[2] > 1e-3:
            assert inside(tight, 1 << bit) == 0


@pytest.mark.parametrize("mask", [0, 1, 0x0100, 0x00F0, EVERY_BRANCH])
def test_limbs_hold_only_on_branches_that_are_asked_for(mask):
    for seed in range(20):
        path = path_between(random_ends(seed), STRAIGHT)
        found = called(hold_mask)(HERE, FLANGE, path, FLOOR, mask, Holding.row())
        assert found == certified(path) & mask
