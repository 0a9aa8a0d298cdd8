"""Hits: surface points that depth cameras measured, those of known boxes, and cubes of the rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.schema import Numbers, Tuples
from mlivr_gym.values import MAX_LENGTH
from mlivr_gym.world import Box, merged_cells

CUBE = 0.05
"""Edge of the cubes [m]."""

ENOUGH_HITS = 2
"""Number of hits that make a cube an obstacle; a single one may be noise."""

MARGINS = 0.01, -0.005
"""Distance by which a box extends beyond the hits in its cubes [m]; where no plan is left, they
extend less, as noise moves the outermost hits outwards."""

THINNEST = 0.002
"""Least thickness of a box [m]."""

LEAST_GROWTH = 0.005
"""Growth of what was seen in a cube that is no news [m]."""

EXPLAINED_DEVIATIONS = 5.0
"""Distance from a known box within which a hit belongs to it, in standard deviations."""

ROUNDING = 1e-4
"""Distance added to this for the rounding of numbers [m]."""

SENSED = "sensed/"
"""Beginning of the ids of boxes that were sensed."""

NOISE = Tuples((), 0.0, 0.1, "m")
"""Validator of the standard deviation of a measured distance."""

MOST_HITS = 100_000_000
"""Maximum number of hits of one look."""


HITS = Numbers((None, 3), most=MAX_LENGTH, unit="m", rows=(0, MOST_HITS))
"""Validator of measured positions of surfaces in the module frame."""


def unexplained(hits: Array, boxes: Sequence[Box], noise: float) -> Array:
    """Return the hits, shape (k, 3) [m], that lie neither on nor in a box, as far as noise tells.

    `noise` is the standard deviation of a measured distance [m].
    """
    if not boxes:
        return hits
    tolerance = EXPLAINED_DEVIATIONS * noise + ROUNDING
    hits = hits[np.argsort(hits[:, 0])]  # so that a box is compared with those at its place
    low, high = np.stack([box.bounds[:, 0] for box in boxes], axis=1)
    begins = np.searchsorted(hits[:, 0], low - tolerance).tolist()
    ends = np.searchsorted(hits[:, 0], high + tolerance).tolist()
    is_unknown = np.ones(len(hits), dtype=np.bool_)
    for box, begin, end in zip(boxes, begins, ends, strict=True):
        candidates = begin + np.flatnonzero(is_unknown[begin:end])
        local = np.abs((hits[candidates] - box.centre) @ np.array(box.rotation))
        excess = np.maximum(local - box.half, 0.0)
        is_unknown[candidates] = np.einsum("ij,ij->i", excess, excess) > tolerance**2
    return hits[is_unknown]


class HitCubes:
    """The cubes of a grid in which there are hits.

    Attributes
    ----------
    number
        Number of each of n cubes in the grid, in order, shape (n,).
    count
        Number of its hits, shape (n,).
    extent
        Extent of its hits: their negative minimum, and their maximum, shape (n, 2, 3) [m].
    told
        Extent that the graph was told of, shape (n, 2, 3) [m]; -inf if of none.
    margin
        Distance by which boxes extend beyond the hits [m], one of `MARGINS`.
    """

    def __init__(self, bounds: Array) -> None:
        """Begin without hits; the grid is between two corners, shape (2, 3) [m]."""
        self.origin, self.margin = bounds[0], MARGINS[0]
        self.shape = tuple(np.ceil((bounds[1] - bounds[0]) / CUBE).astype(int).tolist())
        self.number, self.count = np.zeros((2, 0), dtype=np.int64)
        self.extent, self.told = np.zeros((2, 0, 2, 3))

    def add(self, hits: Array) -> None:
        """Count hits, shape (k, 3) [m], in their cubes; those outside the grid are left out."""
        cells = np.floor((hits - self.origin) / CUBE).astype(np.int64)
        inside = ((cells >= 0) & (cells < self.shape)).all(axis=1)
        hits, cells = hits[inside], cells[inside]
        number = np.append(self.number, np.ravel_multi_index(tuple(cells.T), self.shape))
        if not len(number):
            return
        order = np.argsort(number, kind="stable")
        begins = np.flatnonzero(np.diff(number[order], prepend=-1))
        ones, single = np.ones(len(hits), dtype=np.int64), np.stack([-hits, hits], axis=1)
        self.number = number[order[begins]]
        self.count = np.add.reduceat(np.append(self.count, ones)[order], begins)
        self.extent, self.told = (
            np.maximum.reduceat(np.concatenate([known, new])[order], begins)
            for known, new in ((self.extent, single), (self.told, np.full(single.shape, -np.inf)))
        )

    @property
    def cells(self) -> IntArray:
        """Index of each cube along each axis of the grid, shape (n, 3)."""
        return np.stack(np.unravel_index(self.number, self.shape), axis=1)

    @property
    def is_solid(self) -> BoolArray:
        """Which cubes are obstacles, shape (n,)."""
        return self.count >= ENOUGH_HITS

    @property
    def is_new(self) -> BoolArray:
        """Which of these the graph does not have as they are, shape (n,)."""
        growth = max(self.margin, LEAST_GROWTH)
        return self.is_solid & (self.extent > self.told + growth).any(axis=(1, 2))

    def whole(self, chosen: IntArray) -> tuple[Box, ...]:
        """Return the chosen cubes as boxes, with the margin."""
        low = self.origin + CUBE * self.cells[chosen]
        return self._boxes(np.stack([-low, low + CUBE], axis=1))

    def merged(self, chosen: IntArray) -> tuple[Box, ...]:
        """Return boxes, each about the hits in some of the chosen cubes, with the margin."""
        row = np.full(self.shape, -1)
        row[tuple(self.cells[chosen].T)] = chosen
        extents = [
            self.extent[row[tuple(map(slice, first, last))].ravel()].max(axis=0)
            for first, last in merged_cells(row >= 0)
        ]
        return self._boxes(np.array(extents).reshape(-1, 2, 3))

    def _boxes(self, extents: Array) -> tuple[Box, ...]:
        """Return boxes of extents, shape (k, 2, 3) [m], with the margin."""
        below, high = extents.swapaxes(0, 1)
        by = np.maximum(self.margin, 0.5 * (THINNEST - below - high))
        return Box.each_between(SENSED, "obstacle", -below - by, high + by)
