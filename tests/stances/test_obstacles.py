"""Positions by cells, and which of them are close to obstacles."""

import numpy as np
import pytest

from mlivr_gym.stances.obstacles import CELL_EDGE, PositionCells


@pytest.mark.parametrize("count", [0, 1, 500])
def test_each_position_lies_in_its_cell_and_each_cell_has_positions(count):
    rng = np.random.default_rng(count)
    positions = rng.uniform(-0.4, 0.3, (count, 3))
    cells = PositionCells.of(positions)
    place = np.floor(positions / CELL_EDGE)
    expected, cell = np.unique(place, axis=0, return_inverse=True)
    np.testing.assert_allclose(cells.low, CELL_EDGE * expected, atol=1e-12)
    np.testing.assert_array_equal(cells.cell, cell.reshape(-1))
