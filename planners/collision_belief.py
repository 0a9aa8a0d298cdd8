"""Belief where obstacles block the robot, learned from the checks of a search.

Paths over a table fail mostly close to obstacles, and after a failure the cheapest path is often
one beside it that fails as well. So a first path is searched for with an additional cost for places
at which checks failed, as in Pareto-optimal search over beliefs (POMP: Choudhury, Dellin and
Srinivasa 2016). A place is a cube that contains the base position. The cost is the negative
logarithm of the believed probability that a check there succeeds, which adds up along a path to the
probability that all its checks succeed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray

CELL_EDGE = 0.1
"""Edge of a cell [m]."""

PRIOR_CHECKS = 3.0
"""Number of checks that are assumed to have succeeded in every cell."""

INITIAL_WEIGHT = 4.0
"""Initial weight of the additional cost, in steps."""

MAX_GROWTH = 10, 2000
"""The weight is halved after a search that expands more labels than the smallest search of the
query, by this factor and this number: lower bounds do not know the additional cost, so that a
search which cannot avoid it expands ever more."""


class FailureWeight:
    """Weight of the additional cost in the searches of one query.

    Attributes
    ----------
    value
        The weight, in steps.
    """

    def __init__(self) -> None:
        """Start with the initial weight."""
        self.value, self._fewest = INITIAL_WEIGHT, math.inf

    def update(self, expanded: int) -> None:
        """Take into account how many labels a search expanded."""
        self._fewest = min(self._fewest, expanded)
        if expanded > MAX_GROWTH[0] * self._fewest + MAX_GROWTH[1]:
            self.value *= 0.5


def cells_of(positions: Array) -> NDArray[np.int32]:
    """Return the cells of base positions [m], shape (n, 3), by their numbers, shape (n,)."""
    indices = np.floor(positions / CELL_EDGE).astype(np.int32)
    indices -= indices.min(axis=0, initial=np.iinfo(np.int32).max)
    _, width, height = (indices.max(axis=0, initial=0) + 1).tolist()
    cells: NDArray[np.int32] = (indices[:, 0] * width + indices[:, 1]) * height + indices[:, 2]
    return cells


class CollisionBelief:
    """Believed probability that obstacles block the robot, by the cell of its base position.

    Attributes
    ----------
    cells
        Cell of each node, shape (n,).
    """

    def __init__(self, cells: NDArray[np.int32]) -> None:
        """Believe that nothing is blocked; `cells` are those of the nodes."""
        self.cells = cells
        self._checks = np.full(int(cells.max(initial=-1)) + 1, PRIOR_CHECKS)
        self._failures = np.zeros(len(self._checks))

    def record(self, nodes: IntArray, failures: Array) -> None:
        """Record checks at nodes, each with the share of it that failed, both of shape (k,)."""
        np.add.at(self._checks, self.cells[nodes], 1.0)
        np.add.at(self._failures, self.cells[nodes], failures)

    def costs(self) -> Array:
        """Return the negative logarithm of the probability of success in each cell."""
        return np.asarray(-np.log1p(-self._failures / self._checks))
