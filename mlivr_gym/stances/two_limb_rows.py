"""Rows of a stance graph of two limbs: the stances that share the point of one limb."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from mlivr_gym.arrays import IntArray
from mlivr_gym.stances.two_limb_steps import TwoLimbEdge, TwoLimbTable
from mlivr_gym.transitions.records import StanceArrays


def table_of_rows(stances: StanceArrays, m: int, check: bool, edges: Any = None) -> TwoLimbTable:
    """Return the table of n stances on m points, in lexical order, with the edges of their rows.

    An edge belongs to an ordered pair of stances of a row. If `edges` has not one for each, none is
    known.
    """
    points, n = stances.points, len(stances.points)
    rows: IntArray = np.stack([np.arange(n), np.lexsort((points[:, 0], points[:, 1]))])
    ordered = np.take_along_axis(points.T, rows, axis=1)
    row_start: IntArray = np.stack([np.searchsorted(row, np.arange(m + 1)) for row in ordered])
    degree: IntArray = np.diff(row_start, axis=1)
    offset: IntArray = np.cumsum(degree.ravel() ** 2).reshape(2, m) - degree**2
    local: IntArray = np.empty((2, n), dtype=np.int64)
    for limb in range(2):
        local[limb, rows[limb]] = np.arange(n) - row_start[limb, ordered[limb]]
    count = int((degree**2).sum()) if check else 1
    if edges is None or len(edges) != count:
        edges = TwoLimbEdge.rows(count)
    base = stances.base["position"].copy()
    return TwoLimbTable(
        check, points, base, stances.branch_sets, stances.releases, rows, row_start, base[rows],
        degree, offset, local, edges,
    )  # fmt: skip


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
