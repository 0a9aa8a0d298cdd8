"""Cyclic relabellings of the limbs, which stand for turns of the robot about its own axis.

If the limbs are alike and mounted at equal angles, a stance whose points are exchanged cyclically
among the limbs is the same stance of a robot that has turned. With more than two limbs its posture
is the same too: the rule of postures starts with a limb that the grasps determine, not with limb 0,
see `first_limbs`. Upper bounds of its steps are the same if the body, a cube, also looks the same,
which holds for four limbs, see `is_symmetric_after_relabelling`. Steps themselves may differ, since
of two branches that come too close the one of the higher limb number is removed, see
`transitions.supports`. A relabelling `t` puts limb `(t + i) % N` in the place of limb `i`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.kinematics.batches import chain
from mlivr_gym.postures.geometries import RESOLUTION
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.world.grasp_map import GraspMap


def is_symmetric_after_relabelling(robot: RobotSpec) -> bool:
    """Return whether the robot, its cubic body included, is unchanged by cyclic relabellings.

    With two limbs it is not, since the rule of postures starts with limb 0.
    """
    return robot.limbs == 4 and robot.is_symmetric


def relabelled(values: NDArray[Any], relabellings: NDArray[Any]) -> NDArray[Any]:
    """Return values of the limbs after relabellings, shape (k, N, ...) and (k,) -> (k, N, ...)."""
    limbs = np.arange(values.shape[1])
    sources = (limbs + relabellings[:, None]) % len(limbs)
    taken: NDArray[Any] = values[np.arange(len(values))[:, None], sources]
    return taken


def relabelled_frames(rotations: Array, relabellings: IntArray, limbs: int) -> Array:
    """Return base rotations after relabellings, shape (k, 3, 3) and (k,) -> (k, 3, 3).

    The x axis of the base points to the mount of limb 0.
    """
    angles = 2.0 * np.pi * np.arange(limbs) / limbs
    yaw = np.zeros((limbs, 3, 3))
    yaw[:, 0, 0] = yaw[:, 1, 1] = np.cos(angles)
    yaw[:, 1, 0], yaw[:, 0, 1] = np.sin(angles), -np.sin(angles)
    yaw[:, 2, 2] = 1.0
    return chain(rotations, yaw[relabellings % limbs])


def lowest_first(stances: IntArray) -> IntArray:
    """Return the relabellings after which limb 0 holds the lowest point index, (k, N) -> (k,)."""
    relabellings: IntArray = stances.argmin(axis=1)
    return relabellings


def first_limbs(grasp_map: GraspMap, stances: IntArray, is_symmetric: bool = True) -> IntArray:
    """Return the limbs with which the rule of postures starts, shape (k, N) -> (k,).

    It is the limb whose point is closest to the centroid. Among limbs at equal distances, it is the
    one from which on, limb by limb, the distances from the centroid and then the distances to the
    next point are smaller. Only in stances that are images of themselves the axes of the map
    decide: the lower x, y, z. Of two limbs it is limb 0, as of limbs that differ or are not mounted
    evenly.
    """
    if stances.shape[1] == 2 or not is_symmetric:
        return np.zeros(len(stances), dtype=np.int64)
    positions = grasp_map.positions[stances]
    away = _rounded(positions - positions.mean(axis=1, keepdims=True))
    limbs: IntArray = away.argmin(axis=1)
    tied = np.flatnonzero((away == away.min(axis=1, keepdims=True)).sum(axis=1) > 1)
    if len(tied):
        some = positions[tied]
        apart = _rounded(np.roll(some, -1, axis=1) - some)
        limbs[tied] = _smallest_relabelling(away[tied], apart, *np.moveaxis(some, 2, 0))
    return limbs


def _rounded(vectors: Array) -> Array:
    """Return lengths as whole multiples of `RESOLUTION`, shape (k, N, 3) -> (k, N)."""
    lengths: Array = np.rint(np.linalg.norm(vectors, axis=2) / RESOLUTION)
    return lengths


def _smallest_relabelling(*values: Array) -> IntArray:
    """Return the relabellings that make the values of the limbs lexicographically smallest.

    Each array of values has shape (k, N); the first array counts first.
    """
    count, limbs = values[0].shape
    alive = np.ones((count, limbs), dtype=np.bool_)
    for one in values:
        for i in range(limbs):
            here = np.where(alive, np.roll(one, -i, axis=1), np.inf)
            alive &= here == here.min(axis=1, keepdims=True)
    relabellings: IntArray = alive.argmax(axis=1)
    return relabellings
