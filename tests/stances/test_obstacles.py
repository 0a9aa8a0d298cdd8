"""Positions by cells, and which of them are close to obstacles."""

import numpy as np
import pytest

from mlivr_gym.stances.obstacles import CELL_EDGE, PositionCells, mark_close_cells


@pytest.mark.parametrize("count", [0, 1, 500])
def test_each_position_lies_in_its_cell_and_each_cell_has_positions(count):
    rng = np.random.default_rng(count)
    positions = rng.uniform(-0.4, 0.3, (count, 3))
    cells = PositionCells.of(positions)
    place = np.floor(positions / CELL_EDGE)
    expected, cell = np.unique(place, axis=0, return_inverse=True)
    np.testing.assert_allclose(cells.low, CELL_EDGE * expected, atol=1e-12)
    np.testing.assert_array_equal(cells.cell, cell.reshape(-1))


def test_cells_are_close_to_a_box_that_one_of_their_positions_may_reach():
    rng = np.random.default_rng(2)
    low = CELL_EDGE * rng.integers(-20, 20, (400, 3))
    corners = np.sort(rng.uniform(-2.0, 2.0, (6, 2, 3)), axis=1)
    close, least = np.zeros(len(low), dtype=np.bool_), np.full(len(low), np.inf)
    mark_close_cells(low, corners, 0.5, close)
    for first, last in corners:
        # The position of a cell that is closest to a box, and that of the box closest to it.
        position = np.clip(np.clip(low, first, last), low, low + CELL_EDGE)
        apart = np.linalg.norm(position - np.clip(position, first, last), axis=1)
        least = np.minimum(least, apart)
    assert 50 < close.sum() < 350
    np.testing.assert_array_equal(close, least <= 0.5)
