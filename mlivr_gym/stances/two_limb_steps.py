"""Edges of two limbs, and the steps that leave a state along them (compiled).

The edge table has a record for each ordered pair of stances of a row, which `TwoLimbGraph` fills on
demand with the results of `transitions.steps`.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Record
from mlivr_gym.transitions.rule import kept_on_edge


class TwoLimbEdge(Record):
    """Edge from a stance to another one of the row of its support limb, once it is checked."""

    kept: Annotated[int, np.uint16]
    """Branches and flips that the support limb keeps; 0 if there is no edge."""
    known: Annotated[int, np.uint16]
    """1 if the edge was checked."""


class TwoLimbTable(NamedTuple):
    """The n stances of two limbs on m points, and the edges checked so far.

    Row p of limb i has the stances in which limb i holds point p.
    """

    check: bool
    """Whether steps are checked."""
    points: IntArray
    """Point of each limb, shape (n, 2)."""
    base: Array
    """Base positions in the world [m], shape (n, 3)."""
    branch_sets: IntArray
    """Branches and flips on which each limb may hold, shape (n, 2)."""
    releases: Any
    """Rows of `ReleaseRecord`, shape (n, 2)."""
    rows: IntArray
    """Stances by the point of limb 0 and of limb 1, shape (2, n)."""
    row_start: IntArray
    """Start of the row of each point in `rows`, shape (2, m + 1)."""
    row_base: Array
    """Base positions in the order of `rows` [m], shape (2, n, 3)."""
    degree: IntArray
    """Number of stances in each row, shape (2, m)."""
    offset: IntArray
    """First edge of each row, shape (2, m)."""
    local: IntArray
    """Position of each stance in its rows, shape (2, n)."""
    edges: Any
    """Rows of `TwoLimbEdge`."""


@kernel
def branches_kept(edge: TwoLimbEdge) -> int:
    """Return the holds that the support limb keeps on an edge."""
    kept: Any = np.int64(edge.kept)
    return kept  # type: ignore[no-any-return]


@kernel
def edge_index(support: int, before: int, after: int, table: TwoLimbTable) -> int:
    """Return the index of the edge between two stances of a row in which limb `support` holds."""
    point, local = table.points[before, support], table.local
    first = table.offset[support, point] + local[support, before] * table.degree[support, point]
    index: int = first + local[support, after]
    return index


def edge_indices(support: Any, before: Any, after: Any, table: TwoLimbTable) -> Any:
    """Return the indices of edges as `edge_index` does, of numbers or arrays, shape (k,)."""
    point, local = table.points[before, support], table.local
    first = table.offset[support, point] + local[support, before] * table.degree[support, point]
    return first + local[support, after]


@entry
def longest_step(
    support: int, rows: IntArray, row_start: IntArray, base: Array, out: Array
) -> None:
    """Write the largest squared base displacement in each row of limb `support` into `out` [m^2].

    Rows as in `TwoLimbTable`, base positions of stances, shape (n, 3) [m], `out` of points, shape
    (m,).
    """
    for point in range(len(out)):
        for i in range(row_start[support, point], row_start[support, point + 1]):
            for j in range(row_start[support, point], i):
                a, b = rows[support, i], rows[support, j]
                square = 0.0
                for axis in range(3):
                    square += (base[a, axis] - base[b, axis]) ** 2
                out[point] = max(out[point], square)


@entry
def gather_steps(
    table: TwoLimbTable, start: IntArray, after: NDArray[np.int32], kept: NDArray[np.uint16]
) -> None:
    """Write the steps that leave each stance, and where those of each limb start.

    `start` has zeros, shape (2 n + 1,); `after` and `kept`, long enough for all edges, receive the
    stances after the steps and the branches kept.
    """
    branch_set, row_start, rows = table.branch_sets, table.row_start, table.rows
    count = 0
    for s in range(len(table.points)):
        for moving in range(2):
            support = 1 - moving
            point = table.points[s, support]
            for k in range(row_start[support, point], row_start[support, point + 1]):
                s2 = rows[support, k]
                if s2 == s or branch_set[s2, moving] == 0:
                    continue
                branches = kept_on_edge(branch_set[s, support], branch_set[s2, support])
                if table.check:
                    edge = table.edges[edge_index(support, s, s2, table)]
                    branches = kept_on_edge(branches, branches_kept(edge))
                if branches:
                    after[count], kept[count] = s2, branches
                    count += 1
            start[2 * s + moving + 1] = count
