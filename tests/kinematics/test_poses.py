"""Rotations, vectors and frames, alone and in batches, against SciPy and NumPy."""

import math

import numpy as np
import pytest
from branches import triple
from compiled import called
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mlivr_gym.kinematics.batches import distance, distances, dots
from mlivr_gym.kinematics.poses import (
    cross,
    into,
    out_of,
    pose,
    quaternion,
    relative_rotation,
    seen_from,
    turn,
)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi])
def test_relative_rotation_of_any_angle(angle):
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    start = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix()
    last = start @ Rotation.from_rotvec(angle * axis).as_matrix()
    value, found = called(relative_rotation)(start, last)
    assert value == pytest.approx(angle, abs=1e-7)
    turned = Rotation.from_rotvec(value * np.array(found)).as_matrix()
    np.testing.assert_allclose(turned, Rotation.from_rotvec(angle * axis).as_matrix(), atol=1e-7)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.0, -0.6, 0.8)])
def test_relative_rotation_by_half_a_turn(axis):
    """The axis is then found another way for each of its largest components."""
    last = Rotation.from_rotvec(np.pi * np.array(axis)).as_matrix()
    value, found = called(relative_rotation)(np.eye(3), last)
    assert value == pytest.approx(np.pi, abs=1e-12)
    assert abs(np.dot(found, axis)) == pytest.approx(1.0, abs=1e-12)


def test_quaternions_are_those_of_scipy():
    turns = Rotation.random(24, np.random.default_rng(0))
    found = quaternion(turns.as_matrix().reshape(4, 6, 3, 3)).reshape(24, 4)
    truth = turns.as_quat(canonical=True, scalar_first=True)
    assert (found[:, 0] >= 0.0).all()
    np.testing.assert_allclose(found, truth, atol=1e-9)
    np.testing.assert_allclose(quaternion(turns[0].as_matrix()), truth[0], atol=1e-9)


def test_frames_and_vectors():
    rng = np.random.default_rng(1)
    for _ in range(20):
        position, rotation = rng.normal(size=3), Rotation.random(None, rng).as_matrix()
        frame, v, w = pose(position, rotation), rng.normal(size=3), rng.normal(size=3)
        seen = called(seen_from)(frame, triple(v))
        np.testing.assert_allclose(seen, rotation.T @ (v - position), atol=1e-12)
        np.testing.assert_allclose(called(out_of)(frame, seen), v, atol=1e-12)
        np.testing.assert_allclose(called(into)(frame, triple(v)), rotation.T @ v, atol=1e-12)
        angle, axis = rng.uniform(-np.pi, np.pi), w / np.linalg.norm(w)
        turned = called(turn)(triple(axis), np.cos(angle), np.sin(angle), triple(v))
        truth = Rotation.from_rotvec(angle * axis).apply(v)
        np.testing.assert_allclose(turned, truth, atol=1e-12)
        product = called(cross)(triple(v), triple(w))
        np.testing.assert_allclose(product, np.cross(v, w), atol=1e-12)


def drawn(seed, count=40):
    """Vectors and others."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, 3)), rng.normal(size=(count, 3))


@pytest.mark.parametrize("seed", range(3))
def test_they_are_what_numpy_says(seed):
    a, b = drawn(seed)
    np.testing.assert_allclose(dots(a, b), np.einsum("ki,ki->k", a, b), atol=1e-14)
    np.testing.assert_allclose(distances(a, b), np.linalg.norm(a - b, axis=1), atol=1e-14)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9))
def test_a_row_is_the_same_alone_and_in_any_layout(seed, count):
    a, b = drawn(seed, count)
    for function in (dots, distances):
        whole = function(a, b)
        np.testing.assert_array_equal(whole, function(np.asfortranarray(a), np.asfortranarray(b)))
        for row in range(count):
            np.testing.assert_array_equal(whole[row], function(a[[row]], b[[row]])[0])
    for row in range(count):
        assert distance(a[row].tolist(), b[row].tolist()) == distances(a, b)[row]
        assert math.isclose(distances(a, b)[row], math.dist(a[row], b[row]), rel_tol=1e-12)
