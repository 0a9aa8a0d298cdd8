"""Boxes that cover the surface of a triangle mesh, for collision checks against a module's CAD.

Space is divided into cubes of one size. Each cube that a triangle touches is kept, by the
separating axis test of triangle and box (Akenine-Moeller 2001), and neighbouring cubes are merged
into boxes. So every point of the surface lies in a box, and no point of a box is farther from the
surface than the diagonal of a cube. The inside of a closed mesh stays free: it may be a cabin.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.errors import MapError, path_shown
from mlivr_gym.extras import require
from mlivr_gym.values import MAX_LENGTH, MAX_PARTS, as_triple
from mlivr_gym.world.boxes import Box

RESOLUTION = 0.05
"""Default edge of a cube [m]."""

MOST_CUBES = 20_000_000
"""Most cubes of the grid round a mesh: 20 MB."""

LONGEST_EDGE = 6.0
"""Edge of a triangle, in cubes, above which it is divided before it is compared with cubes."""


def largest_excess(resolution: float) -> float:
    """Return the largest distance [m] of a point of a box from the surface that it covers."""
    return float(np.sqrt(3.0)) * resolution


def mesh_boxes(
    path: str | Path, resolution: float = RESOLUTION, scale: float = 1.0
) -> tuple[Box, ...]:
    """Return boxes that cover the surface of a mesh.

    Parameters
    ----------
    path
        A glTF, OBJ, STL or PLY file; needs the extra `mesh`.
    resolution
        Edge of the cubes of which the boxes consist [m]; see `largest_excess`.
    scale
        Metres per unit of the file, 0.001 for one in millimetres.

    Raises
    ------
    MapError
        If the file cannot be read, holds no triangle, is larger than a map may be, or needs
        more cubes or boxes than are allowed.
    """
    corners = _triangles(path) * scale
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    extent = float((high - low).max())
    if max(extent, float(np.abs(corners).max())) > MAX_LENGTH:
        raise MapError(
            f"mesh {path_shown(path)} is {extent:g} m long, a map at most {MAX_LENGTH:g} m; for a "
            "file in millimetres give scale 0.001"
        )
    # A margin of half a cube, so that faces of the mesh do not lie on those of cubes.
    origin = low - 0.5 * resolution
    counts = np.floor((high - origin) / resolution).astype(np.int64) + 1
    if counts.prod() > MOST_CUBES:
        raise MapError(
            f"mesh {path_shown(path)} is {extent:g} m long and needs {counts.prod():,} cubes of "
            f"{resolution:g} m, at most {MOST_CUBES:,} are allowed; give a larger resolution, or "
            "scale 0.001 for a file in millimetres"
        )
    touched = np.zeros(counts, dtype=np.bool_)
    for part in _divided((corners - origin) / resolution):
        _mark(part, touched)
    cells = merged_cells(touched)
    if len(cells) > MAX_PARTS:
        raise MapError(
            f"mesh {path_shown(path)} needs {len(cells):,} boxes at a resolution of "
            f"{resolution:g} m, at most {MAX_PARTS:,} are allowed; give a larger resolution"
        )
    name = Path(path).stem
    edge = 0.5 * resolution
    return tuple(
        Box(
            f"{name}/{k}",
            "panel",
            as_triple(np.asarray(origin + edge * (first + last), dtype=np.float64)),
            as_triple(np.asarray(edge * (last - first), dtype=np.float64)),
        )
        for k, (first, last) in enumerate(cells)
    )


def _triangles(path: str | Path) -> Array:
    """Return the corners of all triangles in the units of the file, shape (t, 3, 3)."""
    require("trimesh", extra="mesh")
    import trimesh

    try:
        mesh: Any = trimesh.load(path, force="mesh")
        corners = np.asarray(mesh.triangles, dtype=np.float64)
    except Exception as fault:  # trimesh has no error type of its own
        reason = str(fault).splitlines()[0] if str(fault) else type(fault).__name__
        raise MapError(f"cannot read mesh {path_shown(path)}: {reason}") from None
    if not len(corners):
        raise MapError(f"mesh {path_shown(path)} holds no triangle")
    if not np.isfinite(corners).all():
        raise MapError(f"mesh {path_shown(path)} has a corner that is not finite")
    return corners


def _divided(corners: Array) -> list[Array]:
    """Return triangles no longer than `LONGEST_EDGE`, halved at their longest edges."""
    done, waiting = [], corners
    while len(waiting):
        edges = np.linalg.norm(waiting - np.roll(waiting, -1, axis=1), axis=2)
        small = edges.max(axis=1) <= LONGEST_EDGE
        done.append(waiting[small])
        large, longest = waiting[~small], edges[~small].argmax(axis=1)
        rows = np.arange(len(large))
        a, b, c = (large[rows, (longest + k) % 3] for k in range(3))
        middle = 0.5 * (a + b)
        waiting = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
    return done


def _mark(corners: Array, touched: BoolArray) -> None:
    """Mark the cubes that triangles touch, in units of cubes; triangles of about equal extent."""
    if not len(corners):
        return
    low = np.floor(corners.min(axis=1) - 1e-9).astype(np.int64)
    size = np.floor(corners.max(axis=1) + 1e-9).astype(np.int64) - low + 1
    for shape in np.unique(size, axis=0):
        some = np.flatnonzero((size == shape).all(axis=1))
        offsets = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3)
        for part in np.array_split(some, 1 + len(some) * len(offsets) // 200_000):
            cubes = low[part][:, None] + offsets
            hit = _touches(corners[part][:, None], cubes + 0.5)
            inside = cubes[hit]
            inside = np.clip(inside, 0, np.array(touched.shape) - 1)
            touched[tuple(inside.T)] = True


def _touches(corners: Array, centres: Array) -> BoolArray:
    """Return whether triangles touch cubes of edge 1.

    There are k triangles with corners (k, 1, 3, 3), and c cubes with centres (k, c, 3) for each.
    """
    a, b, c = (corners[:, :, i] - centres for i in range(3))
    edges = [b - a, c - b, a - c]
    hit = np.ones(centres.shape[:2], dtype=np.bool_)
    for axis in range(3):
        values = np.stack([a[..., axis], b[..., axis], c[..., axis]])
        hit &= (values.min(axis=0) <= 0.5 + 1e-9) & (values.max(axis=0) >= -0.5 - 1e-9)
    directions = [np.cross(edges[0], edges[1])]
    directions += [np.cross(np.eye(3)[axis], edge) for axis in range(3) for edge in edges]
    for direction in directions:
        values = np.stack([(corner * direction).sum(axis=-1) for corner in (a, b, c)])
        radius = 0.5 * np.abs(direction).sum(axis=-1) + 1e-9
        hit &= (values.min(axis=0) <= radius) & (values.max(axis=0) >= -radius)
    return hit


def merged_cells(
    touched: BoolArray, allowed: BoolArray | None = None
) -> list[tuple[IntArray, IntArray]]:
    """Return boxes of whole cells that cover the marked cells, and others only if allowed.

    Each box begins at the first marked cell that is not covered yet and grows along z, then y, then
    x. Without `allowed` each marked cell is covered once.
    """
    waiting, boxes = touched.copy(), []
    free = waiting if allowed is None else allowed
    for x, y, z in np.argwhere(touched).tolist():
        if not waiting[x, y, z]:
            continue
        top, side, end = z + 1, y + 1, x + 1
        while top < touched.shape[2] and free[x, y, top]:
            top += 1
        while side < touched.shape[1] and free[x, side, z:top].all():
            side += 1
        while end < touched.shape[0] and free[end, y:side, z:top].all():
            end += 1
        waiting[x:end, y:side, z:top] = False
        boxes.append((np.array([x, y, z]), np.array([end, side, top])))
    return boxes
