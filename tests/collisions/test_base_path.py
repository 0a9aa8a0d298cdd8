"""Poses along a path, against SciPy."""

import numpy as np
import pytest
from compiled import called
from held_paths import path_between, random_ends
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from mlivr_gym.collisions.base_path import BasePath, base_poses, lift_path
from mlivr_gym.kinematics.grasps import grasp_rows
from mlivr_gym.kinematics.poses import pose


def test_a_base_path_is_slerp_on_a_line():
    ends, s = random_ends(3), np.linspace(0, 1, 11)
    path = path_between(ends)
    positions, rotations = base_poses(path, s)
    np.testing.assert_allclose(positions, ends[0] + s[:, None] * (ends[2] - ends[0]), atol=1e-12)
    slerp = Slerp([0, 1], Rotation.from_matrix(np.array([ends[1], ends[3]])))
    np.testing.assert_allclose(rotations, slerp(s).as_matrix(), atol=1e-12)
    turned = (Rotation.from_matrix(ends[1]).inv() * Rotation.from_matrix(ends[3])).magnitude()
    assert path["angle"] == pytest.approx(turned, abs=1e-9)


@given(st.integers(0, 10**6), st.floats(-1e-9, 1e-9))
@settings(max_examples=60, deadline=None)
def test_the_way_back_is_the_way_there(seed, off):
    """Half turns too, of which both senses are equally short: noise must not choose."""
    rng, ends = np.random.default_rng(seed), random_ends(seed)
    if seed % 2:
        axis = rng.normal(size=3)
        half = Rotation.from_rotvec((np.pi + off) * axis / np.linalg.norm(axis))
        ends[3] = (Rotation.from_matrix(ends[1]) * half).as_matrix()
    s = np.linspace(0.0, 1.0, 9)
    there = base_poses(path_between(ends), s)
    back = base_poses(path_between(ends[2:] + ends[:2]), 1.0 - s)
    for a, b in zip(there, back, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-7)


@pytest.mark.parametrize("seed", range(2))
def test_a_departure_moves_the_base_into_the_surface(seed):
    """A limb that departs by some way along the normal sees its base go back by it."""
    (place, axes), rng, s = random_ends(seed)[:2], np.random.default_rng(seed), np.linspace(0, 1, 5)
    normal, rail, _ = Rotation.random(None, rng).as_matrix()
    path, grasp = BasePath.row(), grasp_rows(rng.normal(size=(1, 3)), normal, rail, 0.1)[0]
    called(lift_path)(path, pose(place, axes), grasp, 0.07)
    positions, rotations = base_poses(path, s)
    np.testing.assert_allclose(positions, place - 0.07 * s[:, None] * normal, atol=1e-12)
    np.testing.assert_allclose(rotations, np.broadcast_to(axes, (5, 3, 3)), atol=1e-12)
