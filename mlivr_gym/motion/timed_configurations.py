"""Samples of a motion of the robot: configurations at given times, with the step and phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray


@dataclass(frozen=True)
class TimedConfigurations:
    """Configurations of the robot at k times; subclasses add other arrays of k entries."""

    times: Array
    """Times since the start, shape (k,) [s]."""
    step: IntArray
    """Index of the step, shape (k,)."""
    phase: IntArray
    """Index into `joint_path.PHASES`, shape (k,)."""
    base_positions: Array
    """Base positions in the world, shape (k, 3) [m]."""
    base_quaternions: Array
    """Base orientations in the world w, x, y, z, shape (k, 4)."""
    joint_positions: Array
    """Joint angles, shape (k, N, 6) [rad]."""

    def configuration(self, k: int) -> tuple[Array, Array, Array]:
        """Return base position (3,), base quaternion (4,) and joint angles (N, 6) of a sample."""
        return self.base_positions[k], self.base_quaternions[k], self.joint_positions[k]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays by name."""
        return {name: each for name, each in vars(self).items() if isinstance(each, np.ndarray)}

    def part(self, chosen: slice | IntArray) -> Self:
        """Return a slice of the samples, or those at some indices."""
        return replace(self, **{name: array[chosen] for name, array in self.arrays().items()})

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Concatenate samples in time."""
        arrays = [part.arrays() for part in parts]
        whole = {name: np.concatenate([one[name] for one in arrays]) for name in arrays[0]}
        return replace(parts[0], **whole)
