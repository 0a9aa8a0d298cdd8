"""Poses along a path, against SciPy."""

import numpy as np
from held_paths import random_ends
from scipy.spatial.transform import Rotation, Slerp

from mlivr_gym.kinematics.base_path import ARC, STRAIGHT
from mlivr_gym.kinematics.holding import base_path


def test_base_path_is_slerp_on_a_line_or_on_an_arc():
    ends, s = random_ends(3), np.linspace(0, 1, 11)
    positions, rotations = base_path((*ends, STRAIGHT, np.zeros(3)), s)
    np.testing.assert_allclose(positions, ends[0] + s[:, None] * (ends[2] - ends[0]), atol=1e-12)
    slerp = Slerp([0, 1], Rotation.from_matrix(np.array([ends[1], ends[3]])))
    np.testing.assert_allclose(rotations, slerp(s).as_matrix(), atol=1e-12)
    pivot = np.array([0.55, 0.0, -0.65])
    positions, _ = base_path((*ends, ARC, pivot), s)
    lengths = np.linalg.norm(positions - pivot, axis=1)
    np.testing.assert_allclose(np.diff(lengths, 2), 0.0, atol=1e-12)
    np.testing.assert_allclose(positions[[0, -1]], [ends[0], ends[2]], atol=1e-12)
