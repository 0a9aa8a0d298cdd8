"""Pairs of points within a span, against a comparison of all with all."""

import itertools

import numpy as np
import pytest

from mlivr_gym.stances.point_pairs import pairs_within


@pytest.mark.parametrize("span", [0.05, 0.4, 1.6, 12.0])
def test_pairs_are_those_of_a_plain_comparison(jem, span):
    here = jem.positions
    near = {
        (a, b)
        for a, b in itertools.combinations(range(len(jem)), 2)
        if np.sqrt(((here[a] - here[b]) ** 2).sum()) <= span + 1e-9
    }
    found = pairs_within(jem, span)
    assert found.dtype == np.int64
    assert {tuple(sorted(pair)) for pair in found.tolist()} == near
    assert len(found) == len(near)
