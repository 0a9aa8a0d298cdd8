"""Products of batches against NumPy, and row by row."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym.kinematics.batches import distance, distances, dots


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
