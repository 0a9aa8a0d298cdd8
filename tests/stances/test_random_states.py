"""Points of random stances in the order of the mounts."""

from itertools import pairwise

import numpy as np
import pytest

from mlivr_gym.stances.random_states import order_around_body


def test_three_points_are_in_order_as_they_are(jem):
    """Every order of three is one of the three turns, in one of the two senses."""
    rows = np.random.default_rng(0).permuted(np.tile(np.arange(len(jem)), (200, 1)), axis=1)[:, :3]
    np.testing.assert_array_equal(order_around_body(jem, rows), rows)


@pytest.mark.parametrize("limbs", [4, 5, 6, 8])
def test_points_run_round_their_centroid(jem, limbs):
    deck, rng = np.flatnonzero(np.array(jem.faces) == "deck"), np.random.default_rng(limbs)
    rows = np.array([rng.choice(deck, limbs, replace=False) for _ in range(200)])
    found = order_around_body(jem, rows)
    np.testing.assert_array_equal(found[:, 0], rows[:, 0])
    np.testing.assert_array_equal(np.sort(found), np.sort(rows))
    senses = set()
    for row, drawn in zip(found, rows, strict=True):
        x, y, _ = (jem.positions[row] - jem.positions[row].mean(axis=0)).T
        # Once round: every turn in one sense, and together less than a whole one.
        turns = np.cumsum([(b - a) % (2 * np.pi) for a, b in pairwise(np.arctan2(y, x))])
        sense = turns[-1] < 2 * np.pi
        if not sense:
            turns = np.cumsum([(a - b) % (2 * np.pi) for a, b in pairwise(np.arctan2(y, x))])
        assert turns[-1] < 2 * np.pi + 1e-9
        senses.add(bool(sense))
        order = row.tolist()
        assert order.index(drawn[1]) < order.index(drawn[2])
    assert senses == {True, False}
