"""Rows of a stance graph of two limbs: the stances that share the point of one limb."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from mlivr_gym.arrays import IntArray


class StanceRows(NamedTuple):
    """The rows of n stances on m points; an edge belongs to an ordered pair of stances of a row."""

    rows: IntArray
    """Stance indices sorted by the point of limb 0 and of limb 1, shape (2, n)."""
    row_start: IntArray
    """Start of the row of each point in `rows`, shape (2, m + 1)."""
    degree: IntArray
    """Number of stances in each row, shape (2, m)."""
    offset: IntArray
    """First edge of each row, shape (2, m)."""
    local: IntArray
    """Position of each stance in its rows, shape (2, n)."""


def rows_of(points: IntArray, m: int) -> StanceRows:
    """Return the rows of stances, given by their points, shape (n, 2), in lexical order."""
    n = len(points)
    by_second = np.lexsort((points[:, 0], points[:, 1]))
    rows: IntArray = np.stack([np.arange(n), by_second]).astype(np.int64)
    ordered = np.take_along_axis(points.T, rows, axis=1)
    row_start: IntArray = np.stack([np.searchsorted(row, np.arange(m + 1)) for row in ordered])
    degree: IntArray = np.diff(row_start, axis=1)
    offset: IntArray = np.cumsum(degree.ravel() ** 2).reshape(2, m) - degree**2
    local: IntArray = np.empty((2, n), dtype=np.int64)
    for limb in range(2):
        local[limb, rows[limb]] = np.arange(n) - row_start[limb, ordered[limb]]
    return StanceRows(rows, row_start, degree, offset, local)


def connected_parts(points: IntArray, m: int) -> tuple[int, NDArray[np.int32]]:
    """Return the number of connected components of stances (n, 2), and that of each, shape (n,).

    All steps are assumed to be possible; the map has m points.
    """
    pairs = scipy.sparse.coo_array(
        (np.ones(len(points)), (points[:, 0], m + points[:, 1])), shape=(2 * m, 2 * m)
    )
    _, component = scipy.sparse.csgraph.connected_components(pairs, directed=False)
    parts, part = np.unique(component[points[:, 0]], return_inverse=True)
    return len(parts), part.astype(np.int32)
