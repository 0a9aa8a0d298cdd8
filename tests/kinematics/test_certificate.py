"""What is certified keeps the floor at every point of a path."""

import numpy as np
import pytest
from branches import angles_on
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

from mlivr_gym.kinematics.base_path import ARC, CLOSEST_PIVOT, STRAIGHT, base_poses
from mlivr_gym.kinematics.certificate import Proof, certify
from mlivr_gym.kinematics.ur import jacobian

HERE = mounted()


def certified(path, mask=EVERY_BRANCH):
    return called(certify)(HERE, FLANGE, path, FLOOR, mask, Proof.row())


def determinants(path, branch, samples=200):
    """|det J| of one branch at points of the path; 0 where it does not exist."""
    positions, rotations = base_poses(path, np.linspace(0, 1, samples))
    mounts = rotations @ MOUNT
    origins = positions + rotations @ ORIGIN
    flanges = np.einsum("kji,kj->ki", mounts, GRIP - origins), mounts.transpose(0, 2, 1) @ TOOL
    jacobians = np.zeros((samples, 6, 6))
    for k, flange in enumerate(zip(*flanges, strict=True)):
        q = angles_on(HERE["arm"], *flange, branch)
        if q is not None:
            jacobians[k] = jacobian(q, LIMB.lengths)
    return np.abs(np.linalg.det(jacobians))


@pytest.mark.parametrize("kind", [STRAIGHT, ARC])
@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_certified_choices_keep_the_floor_at_every_point(kind, seed):
    path = path_between(random_ends(seed), kind, (0.55, 0.0, -0.65))
    branches = certified(path)
    for c in range(4):
        least, of_class = determinants(path, 2 * c).min(), 0x0303 << (2 * c)
        if branches & of_class:
            assert branches & of_class == of_class
            assert least >= FLOOR * (1 - 1e-9)
        else:
            # The proof may only fail close to the floor: conservatism is bounded.
            assert least < FLOOR * 1.02


@given(st.integers(0, 10**6))
@settings(max_examples=25, deadline=None)
def test_certificates_are_the_same_in_both_directions(seed):
    ends = random_ends(seed)
    there = certified(path_between(ends, STRAIGHT))
    back = certified(path_between([*ends[2:], *ends[:2]], STRAIGHT))
    assert there == back


@given(st.integers(0, 10**6), st.integers(0, EVERY_BRANCH))
@settings(max_examples=25, deadline=None)
def test_branches_are_certified_each_as_if_alone(seed, mask):
    path = path_between(random_ends(seed), STRAIGHT)
    assert certified(path, mask) == certified(path) & mask


def test_an_arc_through_its_pivot_is_not_certified():
    ends = random_ends(next(s for s in range(99) if certified(path_between(random_ends(s), 0))))
    assert certified(path_between(ends, ARC, ends[0] + [0.0, 0.0, 0.9 * CLOSEST_PIVOT])) == 0
