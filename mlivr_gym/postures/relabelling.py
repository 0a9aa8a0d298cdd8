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
from mlivr_gym.compiled.kernels import entry, kernel
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
    return chain(rotations, turns_to_mounts(limbs)[relabellings % limbs])


def turns_to_mounts(limbs: int) -> Array:
    """Return the rotations that turn the mount of limb 0 to those of all limbs, (N, 3, 3)."""
    angles = 2.0 * np.pi * np.arange(limbs) / limbs
    yaw = np.zeros((limbs, 3, 3))
    yaw[:, 0, 0] = yaw[:, 1, 1] = np.cos(angles)
    yaw[:, 1, 0], yaw[:, 0, 1] = np.sin(angles), -np.sin(angles)
    yaw[:, 2, 2] = 1.0
    return yaw


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
    first = np.zeros(len(stances), dtype=np.int64)
    if stances.shape[1] > 2 and is_symmetric:
        _set_first_limbs(grasp_map.positions, stances, sorting_keys(stances.shape[1]), first)
    return first


def sorting_keys(limbs: int) -> Array:
    """Return the array in which `first_limb` writes what it compares of each limb."""
    return np.empty((5, limbs))


@entry
def _set_first_limbs(positions: Array, stances: IntArray, keys: Array, first: IntArray) -> None:
    """Write the first limb of each stance, see `first_limbs`."""
    for k in range(len(stances)):
        first[k] = first_limb(positions, stances[k], keys)


@kernel
def first_limb(positions: Array, stance: IntArray, keys: Array) -> int:
    """Return the first limb of a stance, see `first_limbs`, with work space of `sorting_keys`."""
    limbs, first = len(stance), 0
    for axis in range(3):
        total = positions[stance[0], axis]
        for limb in range(1, limbs):
            total += positions[stance[limb], axis]
        for limb in range(limbs):
            here, after = positions[stance[limb], axis], positions[stance[(limb + 1) % limbs], axis]
            keys[2 + axis, limb] = here
            away, apart = here - total / limbs, after - here
            keys[0, limb] = away * away + (keys[0, limb] if axis else 0.0)
            keys[1, limb] = apart * apart + (keys[1, limb] if axis else 0.0)
    for limb in range(limbs):
        for kind in range(2):
            keys[kind, limb] = np.rint(np.sqrt(keys[kind, limb]) / RESOLUTION)
    for limb in range(1, limbs):
        if _comes_before(limb, first, keys):
            first = limb
    return first


@kernel
def _comes_before(one: int, other: int, keys: Array) -> bool:
    """Return whether the keys of all limbs from one on, by kind, are smaller than from another."""
    limbs = keys.shape[1]
    for kind in range(len(keys)):
        for i in range(limbs):
            a, b = keys[kind, (one + i) % limbs], keys[kind, (other + i) % limbs]
            if a != b:
                return bool(a < b)
    return False
