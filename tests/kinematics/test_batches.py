"""Products of batches against NumPy, and row by row."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mlivr_gym.kinematics.batches import (
    chain,
    distance,
    distances,
    dots,
    mean_of_limbs,
    rotate,
    unit,
)


def drawn(seed, count=40):
    """Vectors, others, rotations and other rotations."""
    rng = np.random.default_rng(seed)
    turns = (Rotation.random(count, rng=rng).as_matrix() for _ in range(2))
    return rng.normal(size=(count, 3)), rng.normal(size=(count, 3)), *turns


@pytest.mark.parametrize("seed", range(3))
def test_they_are_what_numpy_says(seed):
    a, b, outer, inner = drawn(seed)
    np.testing.assert_allclose(dots(a, b), np.einsum("ki,ki->k", a, b), atol=1e-14)
    np.testing.assert_allclose(distances(a, b), np.linalg.norm(a - b, axis=1), atol=1e-14)
    np.testing.assert_allclose(unit(a), a / np.linalg.norm(a, axis=1)[:, None], atol=1e-14)
    np.testing.assert_allclose(rotate(outer, a), (outer @ a[:, :, None])[..., 0], atol=1e-14)
    np.testing.assert_allclose(chain(outer, inner), outer @ inner, atol=1e-14)
    limbs = a.reshape(-1, 4, 3)
    np.testing.assert_allclose(mean_of_limbs(limbs), limbs.mean(axis=1), atol=1e-14)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9))
def test_a_row_is_the_same_alone_and_in_any_layout(seed, count):
    a, b, outer, inner = drawn(seed, count)
    columns = [np.asfortranarray(one) for one in (a, b, outer, inner)]
    for function, parts in ((dots, (0, 1)), (distances, (0, 1)), (rotate, (2, 0)), (chain, (2, 3))):
        whole = function(*((a, b, outer, inner)[k] for k in parts))
        np.testing.assert_array_equal(whole, function(*(columns[k] for k in parts)))
        for row in range(count):
            alone = function(*((a, b, outer, inner)[k][row : row + 1] for k in parts))
            np.testing.assert_array_equal(whole[row], alone[0])
    for row in range(count):
        assert distance(a[row].tolist(), b[row].tolist()) == distances(a, b)[row]
        assert math.isclose(distances(a, b)[row], math.dist(a[row], b[row]), rel_tol=1e-12)
