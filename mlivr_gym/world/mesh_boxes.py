"""Boxes that cover the surface of a triangle mesh, for collision checks against a module's CAD.

Space is divided into cubes of one size. Each cube that a triangle touches is kept, by the
separating axis test of triangle and box (Akenine-Moeller 2001), and neighbouring cubes are merged
into boxes. A triangle at right angles to an axis, as those of floors and walls, becomes a plate
instead, so that rails may lie on a panel. So every point of the surface lies in a box, and no point
of a box is farther from the surface than the diagonal of a cube. The inside of a closed mesh stays
free: it may be a cabin.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.errors import MapError, path_shown
from mlivr_gym.extras import require
from mlivr_gym.values import MAX_LENGTH, MAX_PARTS
from mlivr_gym.world.boxes import Box

RESOLUTION = 0.05
"""Default edge of a cube [m]."""

MOST_CUBES = 20_000_000
"""Most cubes of the grid round a mesh: 20 MB."""

LONGEST_EDGE = 6.0
"""Edge of a triangle, in cubes, above which it is divided before it is compared with cubes."""

PADDING = 1e-6
"""Distance by which a box exceeds the triangles in it on each side [m], for rounding."""


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
    corners = (corners - origin) / resolution
    fine = PADDING / resolution
    thickness, width, _ = np.sort(np.ptp(corners, axis=1), axis=1).T
    is_flat = (thickness <= 0.25 * fine) & (width >= 4.0 * fine)
    touched = np.zeros(counts, dtype=np.bool_)
    for cubes, _ in _hits(corners[~is_flat], touched.shape):
        touched[tuple(cubes.T)] = True
    whole = np.array(merged_cells(touched), dtype=np.float64).reshape(-1, 2, 3)
    plates = _plates(corners[is_flat], touched, fine)
    low, high = np.swapaxes(np.concatenate([plates, whole]) * resolution + origin, 0, 1)
    if len(low) > MAX_PARTS:
        raise MapError(
            f"mesh {path_shown(path)} needs {len(low):,} boxes at a resolution of "
            f"{resolution:g} m, at most {MAX_PARTS:,} are allowed; give a larger resolution"
        )
    return Box.each_between(f"{Path(path).stem}/", "panel", low - PADDING, high + PADDING)


def _plates(corners: Array, covered: BoolArray, fine: float) -> Array:
    """Return boxes without thickness that cover flat triangles outside of covered cubes.

    The triangles, of shape (t, 3, 3) in cubes, are at right angles to an axis. The corners of the
    boxes are multiples of `fine`, shape (k, 2, 3).
    """
    found = list(_hits(corners, covered.shape))
    if not found:
        return np.zeros((0, 2, 3))
    cubes, bounds = (np.concatenate(part) for part in zip(*found, strict=True))
    is_free = ~covered[tuple(cubes.T)]
    cubes, bounds = cubes[is_free], np.round(bounds[is_free] / fine)
    extent = np.ptp(bounds, axis=1)
    # Cubes that a triangle only touches with its edge have it in a neighbour.
    is_inside = np.sort(extent, axis=1)[:, 1] > 0.0
    cubes, bounds, axis = cubes[is_inside], bounds[is_inside], extent[is_inside].argmin(axis=1)
    bounds[np.arange(len(axis)), 1, axis] = plane = bounds[np.arange(len(axis)), 0, axis]
    # What lies in the same cube and plane becomes one.
    keys = np.column_stack([cubes, axis, plane])
    order = np.lexsort(keys.T)
    is_first = np.append(True, (keys[order][1:] != keys[order][:-1]).any(axis=1))[: len(order)]
    begins = np.flatnonzero(is_first)
    low = np.minimum.reduceat(bounds[order, 0], begins)
    high = np.maximum.reduceat(bounds[order, 1], begins)
    return np.stack(merged_neighbours(low, high), axis=1) * fine


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


def _hits(corners: Array, grid: tuple[int, ...]) -> Iterator[tuple[IntArray, Array]]:
    """Yield the cubes of a grid that triangles touch, and bounds of the triangles in them.

    Shapes are (t, 3, 3), (k, 3) and (k, 2, 3), in cubes. A cube comes once for each triangle, or
    part of a divided one.
    """
    for triangles in _divided(corners):
        bounds = np.stack([triangles.min(axis=1), triangles.max(axis=1)], axis=1)
        first = np.floor(bounds[:, 0] - 1e-9).astype(np.int64)
        size = np.floor(bounds[:, 1] + 1e-9).astype(np.int64) - first + 1
        for shape in np.unique(size, axis=0):
            some = np.flatnonzero((size == shape).all(axis=1))
            offsets = np.argwhere(np.ones(shape, dtype=np.bool_))
            for part in np.array_split(some, 1 + len(some) * len(offsets) // 200_000):
                cubes = first[part][:, None] + offsets
                centres = np.asarray(cubes + 0.5, dtype=np.float64)
                row, place = np.nonzero(_touches(triangles[part][:, None], centres))
                hit = np.clip(cubes[row, place], 0, np.array(grid) - 1)
                yield hit, np.clip(bounds[part[row]], hit[:, None], hit[:, None] + 1)


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


def merged_neighbours(low: Array, high: Array) -> tuple[Array, Array]:
    """Return boxes of which neighbours are merged, from corners of disjoint ones, shape (k, 3).

    Neighbours along z become one box if their bounds along x and y are equal, then those along y,
    then along x.
    """
    if not len(low):
        return low, high
    for axis in (2, 1, 0):
        across = [k for k in range(3) if k != axis]
        order = np.lexsort([low[:, axis], *(c[:, k] for k in across for c in (high, low))])
        low, high = low[order], high[order]
        same = low[1:, axis] == high[:-1, axis]
        for k in across:
            same &= (low[1:, k] == low[:-1, k]) & (high[1:, k] == high[:-1, k])
        begins = np.flatnonzero(np.append(True, ~same))
        ends = np.append(begins[1:], len(low)) - 1
        low, high = low[begins], np.where(np.arange(3) == axis, high[ends], high[begins])
    return low, high
