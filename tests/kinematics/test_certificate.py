"""What is certified keeps the floor at every point of a path."""

import numpy as np
import pytest
from held_paths import FLOOR, GRIP, LIMB, MOUNT, ORIGIN, TOOL, random_ends
from hypothesis import given, settings
from hypothesis import strategies as st

from mlivr_gym.kinematics.base_path import ARC, STRAIGHT
from mlivr_gym.kinematics.certificate import certify
from mlivr_gym.kinematics.holding import base_path
from mlivr_gym.kinematics.ur import inverse_kinematics, jacobian


def determinants(ends, kind, pivot, branch, samples=400):
    """|det J| of one branch at points of the path; 0 where it does not exist."""
    positions, rotations = base_path((*ends, kind, pivot), np.linspace(0, 1, samples))
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
