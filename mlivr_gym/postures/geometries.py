"""Relative geometry of the grasps of stances, on rounded figures: equal ones have one posture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.world.grasp_map import GraspMap

RESOLUTION = 1e-7
"""Relative positions [m] and directions that agree within this count as equal."""


class Grasps(NamedTuple):
    """Grasps of k stances about their centroids."""

    grasps: Array
    """Held points from their centroid [m], shape (k, N, 3)."""
    normals: Array
    """Surface normals, shape (k, N, 3)."""
    rails: Array
    """Rail directions, shape (k, N, 3)."""
    centres: Array
    """Centroids in the world of the collision model [m], shape (k, 3)."""


def relative_geometries(
    grasp_map: GraspMap, stances: IntArray
) -> tuple[IntArray, NDArray[np.intp]]:
    """Distinct relative geometries of stances, and which one each stance has.

    Args:
        grasp_map: The map.
        stances: Point indices, shape (k, N).

    Returns:
        One row a geometry, shape (g, 9 (N - 1)): positions, normals and rails of the grasps after
        the first, in the frame of the first, as whole multiples of `RESOLUTION`; and a row for
        each stance, shape (k,).
    """
    positions, rotations = grasp_map.positions, grasp_map.rotations
    first = stances[:, :1]
    frames = rotations[stances[:, 0]]
    moved = np.einsum("kij,kni->knj", frames, positions[stances[:, 1:]] - positions[first])
    normals = np.einsum("kij,kni->knj", frames, rotations[stances[:, 1:], :, 2])
    rails = np.einsum("kij,kni->knj", frames, rotations[stances[:, 1:], :, 0])
    rows = np.rint(np.concatenate([moved, normals, rails], axis=2) / RESOLUTION).astype(np.int64)
    rows = np.ascontiguousarray(rows.reshape(len(stances), 9 * (stances.shape[1] - 1)))
    rng = np.random.default_rng(0)
    mix = rng.integers(1, 2**62, rows.shape[1], dtype=np.int64) | 1
    with np.errstate(over="ignore"):
        code = (rows * mix).sum(axis=1)
    _, index, inverse = np.unique(code, return_index=True, return_inverse=True)
    if not np.array_equal(rows[index[inverse]], rows):
        _, index, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return rows[index], inverse


def grasps_of_geometries(rows: IntArray, count: int) -> tuple[Grasps, Array]:
    """Grasps about their centroids from rows of `relative_geometries`.

    Args:
        rows: Shape (k, 9 (N - 1)).
        count: Number of limbs N.

    Returns:
        The grasps, and their centroids in the frames of the first grasps, shape (k, 3) [m].
    """
    k = len(rows)
    blocks = rows.reshape(k, count - 1, 9) * RESOLUTION
    grasps = np.zeros((k, count, 3))
    normals, rails = np.zeros((k, count, 3)), np.zeros((k, count, 3))
    normals[:, 0, 2] = rails[:, 0, 0] = 1.0
    grasps[:, 1:] = blocks[:, :, :3]
    normals[:, 1:] = blocks[:, :, 3:6] / np.linalg.norm(blocks[:, :, 3:6], axis=2, keepdims=True)
    rails[:, 1:] = blocks[:, :, 6:] / np.linalg.norm(blocks[:, :, 6:], axis=2, keepdims=True)
    centroid = grasps.mean(axis=1, keepdims=True)
    return Grasps(grasps - centroid, normals, rails, np.zeros((k, 3))), centroid[:, 0]
