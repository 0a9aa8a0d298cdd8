"""Boxes in the form the compiled checks read: rows and a grid of cells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.distances import CABIN, HANDRAIL, OBSTACLE
from mlivr_gym.compiled.records import Matrix, Record, Vector
from mlivr_gym.world.boxes import Box

CELL_EDGE = 0.25
"""Edge of a grid cell [m], or more where that would make too many; a matter of speed only."""

MOST_CELLS = 1 << 18
"""Most cells of a grid; the JEM has 5,616."""

MOST_ENTRIES = 1 << 20
"""Most boxes in the cells, counted in every cell that they reach into."""

CAUSES = {"handrail": HANDRAIL, "stanchion": HANDRAIL, "obstacle": OBSTACLE}
"""Cause of a collision with a box of some kind; `CABIN` with all others."""


class BoundingBox(Record):
    """Two opposite corners of an upright box in the world."""

    low: Vector
    """Least coordinates [m]."""
    high: Vector
    """Largest coordinates [m]."""


class GridBox(Record):
    """A box in the world."""

    bounds: BoundingBox
    """What it reaches."""
    centre: Vector
    """Its middle [m]."""
    half: Vector
    """Half edges along its axes [m]."""
    rotation: Matrix
    """Its axes, in columns."""
    is_rotated: bool
    """Whether they are not those of the world."""
    cause: int
    """What touching it is called, see `distances`."""


class GridFrame(Record):
    """Where the cells of a grid are."""

    empty_region: BoundingBox
    """A large room without boxes; an impossible one if there is none."""
    hull: BoundingBox
    """What all boxes reach."""
    origin: Vector
    """Lower corner of the first cell [m]."""
    edge: float
    """Edge of a cell [m]."""
    cells: Annotated[IntArray, (3,), np.int64]
    """Number of cells along each axis."""


class BoxGrid(NamedTuple):
    """Boxes by cell."""

    frames: Any
    """Where the cells are: a row of `GridFrame`, shape (1,)."""
    boxes: Any
    """Rows of `GridBox`, shape (n,)."""
    start: IntArray
    """Where the boxes of each cell begin in `items`, shape (cells + 1,)."""
    items: IntArray
    """Boxes of each cell, one after the other."""
    fill_bounds: Any
    """What the boxes fill of each cell, rows of `BoundingBox`, shape (cells,)."""


def box_grid(boxes: Sequence[Box]) -> BoxGrid:
    """Sort boxes into cells."""
    rows = GridBox.rows(len(boxes))
    for row, box in zip(rows, boxes, strict=True):
        row["centre"][:], row["half"][:], row["rotation"][:] = box.centre, box.half, box.rotation
        row["is_rotated"] = bool(np.abs(row["rotation"] - np.eye(3)).max() > 1e-12)
        row["cause"] = CAUSES.get(box.kind, CABIN)
    reach = np.einsum("nij,nj->ni", np.abs(rows["rotation"]), rows["half"])
    low, high = rows["centre"] - reach, rows["centre"] + reach
    rows["bounds"]["low"], rows["bounds"]["high"] = low, high
    frames = _grid_frames(low, high)
    frame = frames[0]
    cells, owners = [], []
    for b in range(len(boxes)):
        ends = (low[b] - frame["origin"], high[b] - frame["origin"])
        first, last = (
            np.clip((end / frame["edge"]).astype(np.int64), 0, frame["cells"] - 1) for end in ends
        )
        i, j, k = np.ix_(*(np.arange(a, z + 1) for a, z in zip(first, last, strict=True)))
        here = ((i * frame["cells"][1] + j) * frame["cells"][2] + k).ravel()
        cells.append(here)
        owners.append(np.full(len(here), b, dtype=np.int64))
    nothing = np.zeros(0, dtype=np.int64)
    cell, owner = np.concatenate([nothing, *cells]), np.concatenate([nothing, *owners])
    order = np.argsort(cell, kind="stable")
    start = np.searchsorted(cell[order], np.arange(int(frame["cells"].prod()) + 1))
    return BoxGrid(frames, rows, start, owner[order], _fill_bounds(low, high, cell, owner, frame))


def _grid_frames(low: Array, high: Array) -> Any:
    """Where the cells are for boxes of given corners, shape (n, 3) [m]: a row of `GridFrame`.

    The edge is doubled until there are few enough cells, and few enough boxes in them.
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
    low, high, edge = low - frame["origin"], high - frame["origin"], CELL_EDGE
    while True:
        dims = np.maximum(np.ceil(high.max(axis=0, initial=0.0) / edge), 1.0)
        reached = np.minimum(np.floor(high / edge), dims - 1.0) - np.floor(low / edge) + 1.0
        if dims.prod() <= MOST_CELLS and reached.prod(axis=1).sum() <= max(MOST_ENTRIES, len(low)):
            frame["edge"], frame["cells"][:] = edge, dims.astype(np.int64)
            return frames
        edge *= 2.0


def _fill_bounds(low: Array, high: Array, cell: IntArray, owner: IntArray, frame: GridFrame) -> Any:
    """What the boxes fill of each cell, rows of `BoundingBox`, shape (cells,)."""
    origin, edge, dims = frame["origin"], frame["edge"], frame["cells"]
    corner = origin + edge * np.stack(np.unravel_index(cell, tuple(dims)), axis=1)
    out = BoundingBox.rows(int(dims.prod()))
    out["low"], out["high"] = np.inf, -np.inf
    # What reaches out of the outermost cells counts as in them.
    last = corner >= origin + edge * (dims - 1) - 1e-9
    np.minimum.at(out["low"], cell, np.maximum(low[owner], corner))
    np.maximum.at(
        out["high"], cell, np.where(last, high[owner], np.minimum(high[owner], corner + edge))
    )
    return out


def _empty_region(low: Array, high: Array, hull: Array) -> Array:
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
