"""Turns of a robot about its own axis: every limb takes the place of another, and all is as before.

The limbs of a robot are alike and mounted at equal angles, so a stance whose points change limbs in
turn is the same stance of a robot that has turned. With more than two limbs its posture is the same
too: the rule of postures begins with a limb that the grasps decide, not with limb 0, see
`first_limbs`. So are its steps if the body looks the same too, which is a cube: with four limbs,
see `same_after_turns`; with three a few are not. A turn `t` puts limb `(t + i) % N` in the place of
limb `i`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.kinematics.batches import chain
from mlivr_gym.postures.geometries import RESOLUTION
from mlivr_gym.world.grasp_map import GraspMap


def same_after_turns(limbs: int) -> bool:
    """Whether all of a robot, the cube of its body too, is as before after any turn.

    Of two limbs the rule of postures begins with limb 0, which a half turn makes the other.
    """
    return limbs == 4


def permuted_limbs(values: NDArray[Any], turns: NDArray[Any]) -> NDArray[Any]:
    """Values of the limbs after turns, shape (k, N, ...) and (k,) -> (k, N, ...)."""
    limbs = np.arange(values.shape[1])
    places = (limbs + turns[:, None]) % len(limbs)
    taken: NDArray[Any] = values[np.arange(len(values))[:, None], places]
    return taken


def turned_frames(rotations: Array, turns: IntArray, limbs: int) -> Array:
    """Base rotations of a robot that has turned, shape (k, 3, 3) and (k,) -> (k, 3, 3).

    The x axis of the base points to the mount of limb 0.
    """
    angles = 2.0 * np.pi * np.arange(limbs) / limbs
    yaw = np.zeros((limbs, 3, 3))
    yaw[:, 0, 0] = yaw[:, 1, 1] = np.cos(angles)
    yaw[:, 1, 0], yaw[:, 0, 1] = np.sin(angles), -np.sin(angles)
    yaw[:, 2, 2] = 1.0
    return chain(rotations, yaw[turns % limbs])


def lowest_first(stances: IntArray) -> IntArray:
    """Turns after which limb 0 holds the point of lowest index, (k, N) -> (k,)."""
    turns: IntArray = stances.argmin(axis=1)
    return turns


def first_limbs(grasp_map: GraspMap, stances: IntArray, is_symmetric: bool = True) -> IntArray:
    """Limbs with which the rule of postures begins, (k, N) -> (k,), at most N - 1.

    The one whose point is nearest to the centroid; of equally near ones the one from which on, limb
    by limb, the distances from the centroid and then those to the next point are smaller. Only in
    stances that are their own image the axes of the map decide: the lower x, y, z. Of two limbs it
    is limb 0, as of limbs that differ or are not mounted evenly.
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
        limbs[tied] = _least_turn(away[tied], apart, *np.moveaxis(some, 2, 0))
    return limbs


def _rounded(vectors: Array) -> Array:
    """Lengths as whole multiples of `RESOLUTION`, shape (k, N, 3) -> (k, N)."""
    lengths: Array = np.rint(np.linalg.norm(vectors, axis=2) / RESOLUTION)
    return lengths


def _least_turn(*values: Array) -> IntArray:
    """Turns that make the values of the limbs, some after the others, least; each (k, N)."""
    count, limbs = values[0].shape
    alive = np.ones((count, limbs), dtype=np.bool_)
    for one in values:
        for i in range(limbs):
            here = np.where(alive, np.roll(one, -i, axis=1), np.inf)
            alive &= here == here.min(axis=1, keepdims=True)
    turns: IntArray = alive.argmax(axis=1)
    return turns
