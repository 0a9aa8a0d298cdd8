"""Plates that cover the flat parts of a mesh, such as floors and walls, without excess across them.

Rails lie on panels, so what covers a panel must not stand out beyond it. Triangles at right angles
to an axis of a frame become boxes along the axes of this frame. The frames are those of the largest
triangles that are left, one after the other, and for small ones that of the world.

Which cubes of a grid a triangle touches is told by the separating axis test of triangle and box
(Akenine-Moeller 2001).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray

PADDING = 1e-4
"""Distance by which a plate exceeds its triangles on each side [m], for rounding, as in a file of
single precision."""

MOST_FRAMES = 50
"""Maximum number of frames."""

LEAST_AREA = 8.0
"""Area of a triangle, in faces of cubes, from which on it has a frame of its own."""

LONGEST_EDGE = 6.0
"""Edge of a triangle above which it is divided before it is compared with cubes."""


class Plates(NamedTuple):
    """Boxes along the axes of a frame, k of them."""

    rotation: Array
    """Rotation from the frame to the world, shape (3, 3); both have the same origin."""
    low: Array
    """Lower corners in the frame [m], shape (k, 3)."""
    high: Array
    """Upper corners, shape (k, 3)."""


def areas(corners: Array) -> Array:
    """Return the areas of triangles from their corners, shape (t, 3, 3)."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(0.5 * np.linalg.norm(across, axis=1), dtype=np.float64)


def flat_parts(corners: Array, resolution: float) -> tuple[list[Plates], Array]:
    """Return plates that cover flat parts of a mesh, and the triangles that are left.

    Along a plate its edges exceed the triangles by less than a cube of the edge `resolution` [m].
    Triangles are given by their corners, shape (t, 3, 3) [m].
    """
    parts = []
    for _ in range(MOST_FRAMES):
        sizes = areas(corners)
        is_last = sizes.max(initial=0.0) < LEAST_AREA * resolution**2
        rotation = np.eye(3) if is_last else _frame(corners[sizes.argmax()])
        turned = corners @ rotation
        thickness, width, _ = np.sort(np.ptp(turned, axis=1), axis=1).T
        is_flat = (thickness <= 0.25 * PADDING) & (width >= 4.0 * PADDING)
        if is_flat.any():
            low, high = _plates(turned[is_flat], resolution)
            parts.append(Plates(rotation, low - PADDING, high + PADDING))
        corners = corners[~is_flat]
        if is_last:
            break
    return parts, corners


def _frame(corners: Array) -> Array:
    """Return the rotation of a frame with z across a triangle, x along a side of its panel.

    Panels are rectangles as a rule, so x is the longer side of the angle that is nearest to a right
    one. The world's frame stands for any along the same axes.
    """
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    units = edges / lengths[:, None]
    corner = np.abs((units * np.roll(units, 1, axis=0)).sum(axis=1)).argmin()
    along = units[max(corner, corner - 1, key=lambda edge: lengths[edge])]
    normal = np.cross(edges[0], edges[1])
    normal /= np.linalg.norm(normal)
    rotation = np.column_stack([along, np.cross(normal, along), normal])
    is_upright = np.abs(rotation).max(axis=0).min() > 1.0 - 1e-12
    return np.eye(3) if is_upright else rotation


def _plates(corners: Array, resolution: float) -> tuple[Array, Array]:
    """Return corners of boxes without thickness, shape (k, 3) [m], that cover flat triangles.

    The triangles, of shape (t, 3, 3) [m], are at right angles to an axis.
    """
    # A margin of half a cube, so that edges do not lie on the faces of cubes.
    origin = corners.min(axis=(0, 1)) - 0.5 * resolution
    found = list(cubes_of_triangles((corners - origin) / resolution))
    cubes, bounds = (np.concatenate(part) for part in zip(*found, strict=True))
    bounds = np.round(bounds * (resolution / PADDING))
    extent = np.ptp(bounds, axis=1)
    # Cubes that a triangle only touches with its edge have it in a neighbour.
    is_inside = np.sort(extent, axis=1)[:, 1] > 0.0
    cubes, bounds, axis = cubes[is_inside], bounds[is_inside], extent[is_inside].argmin(axis=1)
    row = np.arange(len(axis))
    bounds[row, 1, axis] = plane = bounds[row, 0, axis]
    # What lies in the same cube and plane becomes one.
    keys = np.column_stack([cubes, axis, plane])
    order = np.lexsort(keys.T)
    begins = np.flatnonzero(np.append(True, (np.diff(keys[order], axis=0) != 0).any(axis=1)))
    low = np.minimum.reduceat(bounds[order, 0], begins)
    high = np.maximum.reduceat(bounds[order, 1], begins)
    low, high = merged_neighbours(low, high)
    return low * PADDING + origin, high * PADDING + origin


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


def cubes_of_triangles(corners: Array) -> Iterator[tuple[IntArray, Array]]:
    """Yield the cubes that triangles touch, and bounds of the triangles in them.

    Lengths are in cubes, which are those between whole numbers. Shapes are (t, 3, 3), (k, 3) and
    (k, 2, 3). A cube comes once for each triangle, or part of a divided one.
    """
    for triangles in _divided(corners):
        bounds = np.stack([triangles.min(axis=1), triangles.max(axis=1)], axis=1)
        first = np.floor(bounds[:, 0] - 1e-9).astype(np.int64)
        size = np.floor(bounds[:, 1] + 1e-9).astype(np.int64) - first + 1
        for shape in np.unique(size, axis=0):
            of_shape = np.flatnonzero((size == shape).all(axis=1))
            offsets = np.argwhere(np.ones(shape, dtype=np.bool_))
            for part in np.array_split(of_shape, 1 + len(of_shape) * len(offsets) // 200_000):
                cubes = first[part][:, None] + offsets
                centres = np.asarray(cubes + 0.5, dtype=np.float64)
                row, place = np.nonzero(_touches(triangles[part][:, None], centres))
                hit = cubes[row, place]
                yield hit, np.clip(bounds[part[row]], hit[:, None], hit[:, None] + 1)


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
