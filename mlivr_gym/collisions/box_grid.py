"""Boxes in the form the compiled checks read: arrays and a grid of cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.distances import CABIN, HANDRAIL, OBSTACLE
from mlivr_gym.world.boxes import Box

CELL = 0.25
"""Edge of a grid cell [m], or more where that would make too many; a matter of speed only."""

MOST_CELLS = 1 << 18
"""Most cells of a grid; the JEM has 5,616."""

MOST_ENTRIES = 1 << 20
"""Most boxes in the cells, counted in every cell that they reach into."""

CAUSES = {"handrail": HANDRAIL, "stanchion": HANDRAIL, "obstacle": OBSTACLE}
"""Cause of a collision with a box of some kind; `CABIN` with all others."""


class BoxWorld:
    """A set of boxes that shapes are checked against.

    Attributes:
        boxes: The boxes.
        arrays: What `link_capsules.against_boxes` takes: for each box its bounds, centre, half
            edges, rotation by rows, whether it is turned and the cause it gives, shape (n, 23); a
            large empty box inside, the hull, the grid's origin, edge and number of cells, shape
            (19,); where the boxes of each cell begin in a list, that list, and what the boxes fill
            of each cell, shape (cells, 2, 3).
    """

    def __init__(self, boxes: Sequence[Box]) -> None:
        """Sort the boxes into cells."""
        self.boxes = tuple(boxes)
        n = len(self.boxes)
        centre = np.array([box.centre for box in self.boxes]).reshape(n, 3)
        half = np.array([box.half for box in self.boxes]).reshape(n, 3)
        rotation = np.array([box.rotation for box in self.boxes]).reshape(n, 3, 3)
        tilted = np.abs(rotation - np.eye(3)).reshape(n, 9).max(axis=1, initial=0.0) > 1e-12
        reach = np.einsum("nij,nj->ni", np.abs(rotation), half)
        low, high = centre - reach, centre + reach
        kind = np.array([CAUSES.get(box.kind, CABIN) for box in self.boxes], dtype=np.int64)
        hull = (
            np.stack([low.min(axis=0), high.max(axis=0)])
            if n
            else np.array([[np.inf] * 3, [-np.inf] * 3])
        )
        origin = hull[0] if n else np.zeros(3)
        grid = _grid(origin, low - origin, high - origin)
        edge, dims = grid.edge, grid.dims
        cells, owners = [], []
        for b in range(n):
            first = np.clip(((low[b] - origin) / edge).astype(np.int64), 0, dims - 1)
            last = np.clip(((high[b] - origin) / edge).astype(np.int64), 0, dims - 1)
            i, j, k = np.ix_(*(np.arange(a, z + 1) for a, z in zip(first, last, strict=True)))
            here = ((i * dims[1] + j) * dims[2] + k).ravel()
            cells.append(here)
            owners.append(np.full(len(here), b, dtype=np.int64))
        cell = np.concatenate(cells) if cells else np.zeros(0, dtype=np.int64)
        order = np.argsort(cell, kind="stable")
        items = np.concatenate(owners)[order] if owners else np.zeros(0, dtype=np.int64)
        start = np.searchsorted(cell[order], np.arange(int(dims.prod()) + 1))
        filled = _filled(low, high, cell, np.concatenate(owners) if owners else items, grid)
        flat = np.column_stack([low, high, centre, half, rotation.reshape(n, 9), tilted, kind])
        head = np.concatenate(
            [_core(low, high, hull).ravel(), hull.ravel(), origin, [edge], dims]
        ).astype(np.float64)
        self.arrays: tuple[Any, ...] = np.ascontiguousarray(flat), head, start, items, filled

    def __len__(self) -> int:
        """Number of boxes."""
        return len(self.boxes)


class _Grid(NamedTuple):
    """Cubic cells in rows."""

    origin: Array
    """Lower corner of the first in the world [m], shape (3,)."""
    edge: float
    """Edge of a cell [m]."""
    dims: IntArray
    """Number of cells along each axis, shape (3,)."""


def _grid(origin: Array, low: Array, high: Array) -> _Grid:
    """A grid for boxes whose corners, seen from the origin, lie from 0 on.

    The edge is doubled until there are few enough cells, and few enough boxes in them.
    """
    edge = CELL
    while True:
        dims = np.maximum(np.ceil(high.max(axis=0, initial=0.0) / edge), 1.0)
        reached = np.minimum(np.floor(high / edge), dims - 1.0) - np.floor(low / edge) + 1.0
        if dims.prod() <= MOST_CELLS and reached.prod(axis=1).sum() <= max(MOST_ENTRIES, len(low)):
            return _Grid(origin, edge, dims.astype(np.int64))
        edge *= 2.0


def _filled(low: Array, high: Array, cell: IntArray, owner: IntArray, grid: _Grid) -> Array:
    """Lower and upper corner of what the boxes fill of each cell [m], shape (cells, 2, 3)."""
    origin, edge, dims = grid
    corner = origin + edge * np.stack(np.unravel_index(cell, tuple(dims)), axis=1)
    out = np.empty((int(dims.prod()), 2, 3))
    out[:, 0], out[:, 1] = np.inf, -np.inf
    # What reaches out of the outermost cells counts as in them.
    last = corner >= origin + edge * (dims - 1) - 1e-9
    np.minimum.at(out[:, 0], cell, np.maximum(low[owner], corner))
    np.maximum.at(
        out[:, 1], cell, np.where(last, high[owner], np.minimum(high[owner], corner + edge))
    )
    return out


def _core(low: Array, high: Array, hull: Array) -> Array:
    """A large empty box round the middle of the hull [m], shape (2, 3).

    An impossible one where the middle is occupied.
    """
    empty = np.array([[np.inf] * 3, [-np.inf] * 3])
    if not len(low):
        return empty
    seed = hull.mean(axis=0)
    if ((low <= seed) & (seed <= high)).all(axis=1).any():
        return empty
    core = hull.copy()
    away = np.maximum(np.maximum(low - seed, seed - high), 0.0).max(axis=1)
    for b in np.argsort(away, kind="stable"):
        if (low[b] >= core[1]).any() or (high[b] <= core[0]).any():
            continue
        best, cut = -1.0, core
        for axis in range(3):
            for side, face in ((1, low[b, axis]), (0, high[b, axis])):
                trial = core.copy()
                trial[side, axis] = face
                if trial[0, axis] < seed[axis] < trial[1, axis]:
                    volume = float((trial[1] - trial[0]).prod())
                    if volume > best:
                        best, cut = volume, trial
        core = cut
    return core
