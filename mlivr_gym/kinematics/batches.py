"""Products of many vectors and rotations, equal to the last bit whatever the number of rows.

NumPy's products of matrices and its sums along an axis add in an order that depends on the shape
and the layout of the whole array, so the last bit of a row depends on what it is worked out
together with. A step that barely keeps a limit would then pass or fail depending on what was
computed with it. Here each number is a sum of products in a fixed order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mlivr_gym.arrays import Array, IntArray

SLACK = 1e-9
"""Tolerance of the first comparison, axis by axis, of `rows_close` [m]."""


def dots(a: Array, b: Array) -> Array:
    """Return scalar products, shapes (..., 3) -> (...)."""
    products: Array = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return products


def distances(a: Array, b: Array) -> Array:
    """Return distances of points, shapes (..., 3) -> (...)."""
    away = a - b
    apart: Array = np.sqrt(dots(away, away))
    return apart


def rows_close(points: Array, low: Array, high: Array, reach: float) -> IntArray:
    """Return the rows of points, shape (n, 3), within `reach` of a box from `low` to `high`."""
    rows: IntArray = np.arange(len(points))
    wide = reach + SLACK
    for axis in range(3):
        along = points[rows, axis] if axis else points[:, 0]
        rows = rows[(along >= low[axis] - wide) & (along <= high[axis] + wide)]
    inside = distances(points[rows], np.clip(points[rows], low, high)) <= reach
    return np.asarray(rows[inside])


def distance(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the distance of two points, equal to that of `distances` to the last bit."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return math.sqrt(x * x + y * y + z * z)
