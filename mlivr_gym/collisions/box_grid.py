"""Boxes of the surroundings as records for compiled code, sorted into a uniform grid of cells.

The grid is the broad phase of the collision checks in `against_boxes`: a capsule is compared only
with the boxes of the cells that it reaches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.distances import CABIN, HANDRAIL, OBSTACLE
from mlivr_gym.compiled.records import Matrix, Record, Vector
from mlivr_gym.world.boxes import UNIT, Box

CELL_EDGE = 0.25
"""Edge of a grid cell [m], doubled where that would make too many cells."""

MOST_CELLS = 1 << 18
"""Maximum number of cells in a grid; the JEM has 5,616."""

MOST_ENTRIES = 1 << 20
"""Maximum number of entries in all cells, where a box counts once in each cell that it reaches."""

CAUSES = {"handrail": HANDRAIL, "stanchion": HANDRAIL, "obstacle": OBSTACLE}
"""Cause of a collision with a box of a given kind; `CABIN` for all other kinds."""


class BoundingBox(Record):
    """Axis-aligned bounding box in the world frame."""

    low: Vector
    """Lower bound of each coordinate [m]."""
    high: Vector
    """Upper bound of each coordinate [m]."""


class GridBox(Record):
    """A box in the world frame."""

    bounds: BoundingBox
    """Its axis-aligned bounding box."""
    centre: Vector
    """Its centre [m]."""
    half: Vector
    """Half edges along its own axes [m]."""
    rotation: Matrix
    """Rotation matrix, with the axes of the box as columns."""
    is_rotated: bool
    """Whether its axes differ from those of the world."""
    cause: int
    """Cause of a collision with it, see `distances`."""


class GridFrame(Record):
    """Position and size of a grid, and regions that need no look-up in its cells."""

    empty_region: BoundingBox
    """A large region without boxes; its lower bounds exceed its upper bounds if none was found."""
    hull: BoundingBox
    """Bounding box of all boxes."""
    origin: Vector
    """Lower corner of the first cell [m]."""
    edge: float
    """Edge of a cell [m]."""
    cells: Annotated[IntArray, (3,), np.int64]
    """Number of cells along each axis."""


class BoxGrid(NamedTuple):
    """Boxes sorted by grid cell."""

    frames: Any
    """Position and size of the grid, a record of `GridFrame`, shape (1,)."""
    boxes: Any
    """The boxes, records of `GridBox`, shape (n,)."""
    start: IntArray
    """Index of the first entry of each cell in `items`, shape (cells + 1,)."""
    items: IntArray
    """Box indices, cell by cell."""
    fill_bounds: Any
    """Bounds of what the boxes fill of each cell, records of `BoundingBox`, shape (cells,)."""


def box_grid(boxes: Sequence[Box], edge: float = CELL_EDGE) -> BoxGrid:
    """Sort boxes into the cells of a grid, whose edge [m] affects the speed only."""
    rows = GridBox.rows(len(boxes))
    if boxes:
        rows["centre"], rows["half"] = [box.centre for box in boxes], [box.half for box in boxes]
        rows["rotation"] = np.eye(3)
        turned = [k for k, box in enumerate(boxes) if box.rotation is not UNIT]
        if turned:
            rows["rotation"][turned] = [boxes[k].rotation for k in turned]
            rows["is_rotated"] = np.abs(rows["rotation"] - np.eye(3)).max(axis=(1, 2)) > 1e-12
        rows["cause"] = [CAUSES.get(box.kind, CABIN) for box in boxes]
    reach = np.einsum("nij,nj->ni", np.abs(rows["rotation"]), rows["half"])
    low, high = rows["centre"] - reach, rows["centre"] + reach
    rows["bounds"]["low"], rows["bounds"]["high"] = low, high
    frames = _grid_frames(low, high, edge)
    frame = frames[0]
    first, last = (
        np.clip(((end - frame["origin"]) / frame["edge"]).astype(np.int64), 0, frame["cells"] - 1)
        for end in (low, high)
    )
    counts = last - first + 1
    total = counts.prod(axis=1)
    owner = np.repeat(np.arange(len(boxes)), total)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(total) - total, total)
    _, side, top = counts[owner].T
    offsets = np.stack([number // (side * top), number // top % side, number % top])
    i, j, k = first[owner].T + offsets
    cell = (i * frame["cells"][1] + j) * frame["cells"][2] + k
    order = np.argsort(cell, kind="stable")
    start = np.searchsorted(cell[order], np.arange(int(frame["cells"].prod()) + 1))
    return BoxGrid(frames, rows, start, owner[order], _fill_bounds(low, high, cell, owner, frame))


def _grid_frames(low: Array, high: Array, edge: float) -> Any:
    """Return the grid frame of boxes with given corners, a record of shape (1,).

    The corners have shape (n, 3) [m]. The edge is doubled until the numbers of cells and of their
    entries are within their limits.
    """
    frames = GridFrame.rows(1)
    frame = frames[0]
    hull = np.array([[np.inf] * 3, [-np.inf] * 3])
    if len(low):
        hull = np.stack([low.min(axis=0), high.max(axis=0)])
        frame["origin"][:] = hull[0]
    frame["hull"]["low"][:], frame["hull"]["high"][:] = hull
    frame["empty_region"]["low"][:], frame["empty_region"]["high"][:] = _empty_region(
        low, high, hull
    )
    low, high = low - frame["origin"], high - frame["origin"]
    while True:
        dims = np.maximum(np.ceil(high.max(axis=0, initial=0.0) / edge), 1.0)
        reached = np.minimum(np.floor(high / edge), dims - 1.0) - np.floor(low / edge) + 1.0
        if dims.prod() <= MOST_CELLS and reached.prod(axis=1).sum() <= max(MOST_ENTRIES, len(low)):
            frame["edge"], frame["cells"][:] = edge, dims.astype(np.int64)
            return frames
        edge *= 2.0


def _fill_bounds(low: Array, high: Array, cell: IntArray, owner: IntArray, frame: GridFrame) -> Any:
    """Return the bounds of what boxes fill of each cell: `BoundingBox` records, shape (cells,)."""
    origin, edge, dims = frame["origin"], frame["edge"], frame["cells"]
    corner = origin + edge * np.stack(np.unravel_index(cell, tuple(dims)), axis=1)
    out = BoundingBox.rows(int(dims.prod()))
    out["low"], out["high"] = np.inf, -np.inf
    # Parts of boxes outside the outermost cells count as inside them.
    last = corner >= origin + edge * (dims - 1) - 1e-9
    np.minimum.at(out["low"], cell, np.maximum(low[owner], corner))
    np.maximum.at(
        out["high"], cell, np.where(last, high[owner], np.minimum(high[owner], corner + edge))
    )
    return out


def _empty_region(low: Array, high: Array, hull: Array) -> Array:
    """Return a large region without boxes about the middle of the hull [m], shape (2, 3).

    If a box contains the middle, the lower bounds of the region exceed its upper bounds.
    """
    empty = np.array([[np.inf] * 3, [-np.inf] * 3])
    if not len(low):
        return empty
    seed = hull.mean(axis=0)
    if ((low <= seed) & (seed <= high)).all(axis=1).any():
        return empty
    core = hull.copy()
    away = np.maximum(np.maximum(low - seed, seed - high), 0.0).max(axis=1)
    order = np.argsort(away, kind="stable")
    low, high = low[order], high[order]
    for _ in range(len(low) + 1):
        overlap = ((low < core[1]) & (high > core[0])).all(axis=1)
        if not overlap.any():
            return core
        core = _cut(core, low[overlap.argmax()], high[overlap.argmax()], seed)
    return empty


def _cut(core: Array, low: Array, high: Array, seed: Array) -> Array:
    """Return the largest part of a region (2, 3) beside a box that has a point inside it, (3,)."""
    best, largest = -1.0, core
    for axis in range(3):
        for side, face in ((1, low[axis]), (0, high[axis])):
            part = core.copy()
            part[side, axis] = face
            if part[0, axis] < seed[axis] < part[1, axis]:
                volume = float((part[1] - part[0]).prod())
                if volume > best:
                    best, largest = volume, part
    return largest
