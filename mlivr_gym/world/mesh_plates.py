"""Plates that cover the flat parts of a mesh, such as floors and walls, without excess across them.

Rails lie on panels, so what covers a panel must not stand out beyond it. Triangles at right angles
to an axis of a frame become boxes along the axes of this frame. The frames are those of the largest
triangles that are left, one after the other, and for small ones that of the world.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.world.triangle_cubes import cubes_of_triangles

PADDING = 1e-4
"""Distance by which a plate exceeds its triangles on each side [m], for rounding, as in a file of
single precision."""

MOST_FRAMES = 50
"""Maximum number of frames."""

LEAST_AREA = 8.0
"""Area of a triangle, in faces of cubes, from which on it has a frame of its own."""


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
