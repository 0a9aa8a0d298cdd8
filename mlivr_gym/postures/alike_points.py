"""Points of a map that have the same boxes around them, as in modules that are alike.

Stances of the same relative geometry touch the same there, so that one of them is compared with the
boxes for all.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.box_grid import CAUSES
from mlivr_gym.collisions.distances import CABIN
from mlivr_gym.postures.geometries import RESOLUTION
from mlivr_gym.world.grasp_map import GraspMap

CELL = 1.0
"""Edge of the cells whose points are compared with boxes at once [m]."""

MIX = np.random.default_rng(0).integers(1, 2**62, 16)
"""Weights of the numbers of a box in the order in which its neighbours are compared."""

FAR = -1
"""Cause of a collision with a box that is too far from a point."""


def classes_of_points(grasp_map: GraspMap, radius: float) -> IntArray:
    """Return a number for each of m points, equal if the boxes around them are the same, (m,).

    They are if, in the frames of the two points, the boxes within a radius [m] agree to
    `RESOLUTION`. Of boxes along the axes of a frame only what lies in a cube around the point
    counts, so a point at a long wall is like its neighbour.
    """
    boxes, positions = grasp_map.boxes, grasp_map.positions
    centres = np.array([box.centre for box in boxes]).reshape(-1, 3)
    halves = np.array([box.half for box in boxes]).reshape(-1, 3)
    axes = np.array([box.rotation for box in boxes]).reshape(-1, 3, 3)
    causes = np.array([CAUSES.get(box.kind, CABIN) for box in boxes], dtype=np.int64)
    away = np.linalg.norm(halves, axis=1) + np.sqrt(3.0) * radius + 0.5 * CELL
    known: dict[bytes, int] = {}
    found: IntArray = np.zeros(len(positions), dtype=np.int64)
    cells, cell = np.unique(np.floor(positions / CELL), axis=0, return_inverse=True)
    for number, middle in enumerate((cells + 0.5) * CELL):
        points = np.flatnonzero(cell.ravel() == number)
        close = (np.abs(centres - middle) <= away[:, None]).all(axis=1)
        frames = grasp_map.rotations[points]
        seen, is_far = _boxes_seen(
            (centres[close] - positions[points, None]) @ frames, halves[close],
            frames.transpose(0, 2, 1)[:, None] @ axes[close], radius,
        )  # fmt: skip
        rows = np.rint(seen / RESOLUTION).astype(np.int64)
        rows = np.concatenate([np.where(is_far, FAR, causes[close])[..., None], rows], axis=2)
        order = (rows * MIX).sum(axis=2).argsort(axis=1)
        for point, row, k in zip(points.tolist(), rows, order, strict=True):
            some = row[k]
            key = some[some[:, 0] != FAR].tobytes()
            found[point] = known.setdefault(key, len(known))
    return found


def _boxes_seen(
    centres: Array, halves: Array, axes: Array, radius: float
) -> tuple[Array, BoolArray]:
    """Return b boxes as they are seen from k points, (k, b, 15), and which are too far, (k, b).

    Given and returned are centres, shape (k, b, 3), half edges, (b, 3) [m], and axes, (k, b, 3, 3),
    in the frames of the points; of a box along these axes, the part in a cube.
    """
    matrices = (*centres.shape[:2], 9)
    extents = (np.abs(axes) @ halves[:, :, None])[..., 0]
    low, high = np.maximum(centres - extents, -radius), np.minimum(centres + extents, radius)
    whole = centres, np.broadcast_to(halves, centres.shape), axes.reshape(matrices)
    part = low + high, high - low, np.broadcast_to(np.eye(3).ravel(), matrices)
    is_along = (np.abs(axes) > 1.0 - RESOLUTION).sum(axis=(2, 3)) == 3
    seen = np.where(
        is_along[..., None], np.concatenate(part, axis=2), np.concatenate(whole, axis=2)
    )
    is_far: BoolArray = np.any(low >= high, axis=2)
    return seen, is_far
