"""Cubes of a grid that triangles touch.

A triangle and a cube are compared by the separating axis test of triangle and box (Akenine-Moeller
2001). All lengths are in cubes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray

LONGEST_EDGE = 6.0
"""Edge of a triangle above which it is divided before it is compared with cubes."""


def cubes_of_triangles(corners: Array) -> Iterator[tuple[IntArray, Array]]:
    """Yield the cubes that triangles touch, and bounds of the triangles in them.

    The cubes are those between whole numbers. Shapes are (t, 3, 3), (k, 3) and (k, 2, 3). A cube
    comes once for each triangle, or part of a divided one.
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
