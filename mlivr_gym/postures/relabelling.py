"""Cyclic relabellings of the limbs, which stand for turns of the robot about its own axis.

If the limbs are alike and mounted at equal angles, a stance whose points are exchanged cyclically
among the limbs is the same stance of a robot that has turned. With more than two limbs its posture
is the same too: the rule of postures starts with a limb that the grasps determine, not with limb 0,
see `base_poses.first_limb`. Its steps are the same if the body, a cube, also looks the same, which
holds for four limbs, see `is_symmetric_after_relabelling`. A relabelling `t` puts limb
`(t + i) % N` in the place of limb `i`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.robot.specification import RobotSpec


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
