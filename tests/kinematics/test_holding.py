"""Joint angles of limbs that hold along base paths, and their windows."""

from dataclasses import replace

import numpy as np
import pytest
from branches import angles_on, arm_of
from compiled import called
from held_paths import (
    EVERY_BRANCH,
    FLANGE,
    FLOOR,
    GRIP,
    LIMB,
    MOUNT,
    ORIGIN,
    TOOL,
    mounted,
    path_between,
    random_ends,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from mlivr_gym.kinematics.base_path import ARC, STRAIGHT, base_poses
from mlivr_gym.kinematics.certificate import Proof, certify
from mlivr_gym.kinematics.holding import (
    FEW,
    MANY,
    Holding,
    follow,
    held_branches,
    in_windows,
)
from mlivr_gym.kinematics.limb import Track, begin

HERE = mounted()


def certified(path):
    return called(certify)(HERE, FLANGE, path, FLOOR, EVERY_BRANCH, Proof.row())


def followed(path, branch, samples):
    """What is followed from the start of a path on."""
    track = Track.row()
    called(begin)(track)
    assert called(follow)(HERE, FLANGE, path, branch, samples, track)
    return track


def windowed(path):
    """Branches and flips on which every joint stays in its window, followed anew in small steps."""
    mask, arm, low = 0, arm_of(LIMB), np.array(LIMB.window_starts)
    positions, rotations = base_poses(path, np.linspace(0.0, 1.0, 300))
    mounts = rotations @ MOUNT
    origins = positions + rotations @ ORIGIN
    flanges = np.einsum("kji,kj->ki", mounts, GRIP - origins), mounts.transpose(0, 2, 1) @ TOOL
    for bit in range(16):
        angles = [angles_on(arm, p, r, bit & 7) for p, r in zip(*flanges, strict=True)]
        if any(q is None for q in angles):
            continue
        q = np.unwrap(np.array(angles) + np.pi * (bit >> 3) * np.eye(6)[5], axis=0)
        q += 2.0 * np.pi * np.ceil((low - q[0]) / (2.0 * np.pi))
        mask |= int(((q >= low) & (q < low + 2.0 * np.pi)).all()) << bit
    return mask


@given(st.integers(0, 10**6), st.sampled_from([STRAIGHT, ARC]), st.integers(0, EVERY_BRANCH))
@settings(max_examples=40, deadline=None)
def test_limbs_hold_where_their_joints_stay_in_their_windows(seed, kind, some):
    """On all of their branches, and on some that are asked for."""
    path = path_between(random_ends(seed), kind)
    able = certified(path) & windowed(path)
    for mask in (EVERY_BRANCH, some):
        both = called(held_branches)(HERE, FLANGE, path, FLOOR, mask, Holding.row())
        assert both == able & mask


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_followed_joints_are_continuous_and_stay_on_their_branch(seed):
    path = path_between(random_ends(seed), STRAIGHT)
    branches = certified(path)
    for c in range(4):
        if not branches >> (2 * c) & 1:
            continue
        coarse, fine = (followed(path, 2 * c, samples) for samples in (int(MANY), 256))
        np.testing.assert_allclose(coarse["q"], fine["q"], atol=1e-9)
        assert (coarse["low"] >= fine["low"] - 1e-9).all()
        assert (coarse["high"] <= fine["high"] + 1e-9).all()


@given(st.integers(0, 10**6), st.sampled_from([4, 32]))
@settings(max_examples=25, deadline=None)
def test_the_farthest_turn_between_places_is_that_of_any_joint_anywhere(seed, samples):
    path, arm = path_between(random_ends(seed), STRAIGHT), arm_of(LIMB)
    mounts = (poses := base_poses(path, np.linspace(0.0, 1.0, samples + 1)))[1] @ MOUNT
    places = np.einsum("kji,kj->ki", mounts, GRIP - poses[0] - poses[1] @ ORIGIN)
    for branch in range(8):
        angles = [
            angles_on(arm, p, m.T @ TOOL, branch) for p, m in zip(places, mounts, strict=True)
        ]
        if all(q is not None for q in angles):
            turns = np.abs(np.diff(np.unwrap(np.array(angles), axis=0), axis=0))
            found = followed(path, branch, samples)["farthest"]
            assert found == pytest.approx(turns.max(), abs=1e-9)


def test_joint_limits_take_branches_away():
    paths = (path_between(random_ends(seed), STRAIGHT) for seed in range(100))
    path = next(path for path in paths if certified(path))

    def inside(limits, mask):
        arm = mounted(replace(LIMB, joint_limits=tuple(map(tuple, limits.tolist()))))
        found = called(in_windows)(arm, FLANGE, path, mask, Track.row())
        both = called(held_branches)(arm, FLANGE, path, FLOOR, mask, Holding.row())
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


def test_joints_that_turn_back_at_a_limit_between_samples_leave_it():
    """The extremes of a path in 2000 intervals, against limits between them and those of few."""
    passed = 0
    for seed in range(60):
        path = path_between(random_ends(seed), STRAIGHT)
        branches = certified(path)
        for bit in (bit for bit in range(8) if branches >> bit & 1):
            coarse, fine = (followed(path, bit, samples) for samples in (int(FEW), 2000))
            beyond = fine["high"] - coarse["high"], coarse["low"] - fine["low"]
            for joint in np.flatnonzero(np.maximum(*beyond) > 1e-4):
                limits = np.stack([fine["low"] - 0.5, fine["high"] + 0.5], axis=1)
                side = int(beyond[0][joint] > beyond[1][joint])
                inward = (1 - 2 * side) * np.array([0.5, 0.0, -1.0]) * beyond[1 - side][joint]
                found = []
                for limit in (fine["low"], fine["high"])[side][joint] + inward:
                    limits[joint, side] = limit
                    arm = mounted(replace(LIMB, joint_limits=tuple(map(tuple, limits.tolist()))))
                    found.append(called(in_windows)(arm, FLANGE, path, 1 << bit, Track.row()))
                assert found[0] == 0
                passed += found[2] != 0
    assert passed > 10
