"""Relative geometries of stances, rounded so that equal ones share one posture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.kinematics.batches import chain, mean_of_limbs, rotate, unit
from mlivr_gym.world.grasp_map import GraspMap

RESOLUTION = 1e-7
"""Relative positions [m] and directions that agree to this resolution count as equal."""


class RelativeGeometries(NamedTuple):
    """The k stances as positions and directions of their grasps, relative to their centroids."""

    positions: Array
    """Held points relative to their centroid [m], shape (k, N, 3)."""
    normals: Array
    """Surface normals, shape (k, N, 3)."""
    rails: Array
    """Rail directions, shape (k, N, 3)."""
    centres: Array
    """Centroids in the world of the boxes [m], shape (k, 3)."""


def relative_geometries(
    grasp_map: GraspMap, stances: IntArray
) -> tuple[IntArray, NDArray[np.intp]]:
    """Find the g distinct relative geometries of stances (k, N), and that of each stance (k,).

    A geometry has 9 (N - 1) numbers: positions, normals and rails of the grasps after the first, in
    the frame of the first, as integer multiples of `RESOLUTION`.
    """
    positions, rotations = grasp_map.positions, grasp_map.rotations
    first = stances[:, :1]
    into_first = np.swapaxes(rotations[stances[:, :1]], 2, 3)
    others = stances[:, 1:]
    seen = positions[others] - positions[first], rotations[others, :, 2], rotations[others, :, 0]
    parts = [rotate(into_first, part) for part in seen]
    rows = np.rint(np.concatenate(parts, axis=2) / RESOLUTION).astype(np.int64)
    rows = np.ascontiguousarray(rows.reshape(len(stances), 9 * (stances.shape[1] - 1)))
    rng = np.random.default_rng(0)
    mix = rng.integers(1, 2**62, rows.shape[1], dtype=np.int64) | 1
    with np.errstate(over="ignore"):
        code = (rows * mix).sum(axis=1)
    _, index, inverse = np.unique(code, return_index=True, return_inverse=True)
    if not np.array_equal(rows[index[inverse]], rows):
        _, index, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return rows[index], inverse


def geometries_of_rows(rows: IntArray, count: int) -> tuple[RelativeGeometries, Array]:
    """Return the grasps of relative geometries (k, 9 (N - 1)), relative to their centroids.

    The centroids, shape (k, 3) [m], are given in the frames of the first grasps.
    """
    k = len(rows)
    blocks = rows.reshape(k, count - 1, 9) * RESOLUTION
    positions = np.zeros((k, count, 3))
    normals, rails = np.zeros((k, count, 3)), np.zeros((k, count, 3))
    normals[:, 0, 2] = rails[:, 0, 0] = 1.0
    positions[:, 1:] = blocks[:, :, :3]
    normals[:, 1:], rails[:, 1:] = unit(blocks[:, :, 3:6]), unit(blocks[:, :, 6:])
    centroid = mean_of_limbs(positions)
    return RelativeGeometries(
        positions - centroid[:, None], normals, rails, np.zeros((k, 3))
    ), centroid


def in_world(
    grasp_map: GraspMap, first: IntArray, positions: Array, rotations: Array
) -> tuple[Array, Array]:
    """Transform base poses from the frames of the first grasps to the world.

    `first` are the first points of stances, shape (k,); positions [m] have shape (k, 3), rotations
    (k, 3, 3).
    """
    frames = grasp_map.rotations[first]
    return grasp_map.positions[first] + rotate(frames, positions), chain(frames, rotations)
