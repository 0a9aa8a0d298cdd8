"""Postures of stances in arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.postures.turns import permuted_limbs, turned_frames


@dataclass(frozen=True)
class Postures:
    """Postures of k stances.

    Attributes
    ----------
    base_position
        Base positions in the world [m], shape (k, 3).
    base_rotation
        Base rotations in the world, shape (k, 3, 3).
    w_m
        Limb manipulability, shape (k, N); 0 where the stance cannot be held.
    w_b
        Base manipulability, shape (k,).
    branch
        Branch of each limb that gives the margin, shape (k, N).
    mask
        Branches and flips each limb may hold on, 16-bit masks, shape (k, N).
    tried
        Which of the base poses tried it is, see `tried_poses`; -1 for one that was given and
        where there is none, shape (k,).
    cause
        What the best posture touches where that alone keeps the stance from being held,
        shape (k,); one of the causes in `distances`.
    """

    base_position: Array
    base_rotation: Array
    w_m: Array
    w_b: Array
    branch: IntArray
    mask: IntArray
    tried: IntArray
    cause: IntArray

    @property
    def reachable(self) -> BoolArray:
        """Whether inverse kinematics has a solution, shape (k,)."""
        reachable: BoolArray = (self.w_b > 0.0) | (self.cause > 0)
        return reachable

    @property
    def base_rows(self) -> Any:
        """The bases as compiled code reads them: rows of `Pose`, shape (k,)."""
        rows = Pose.rows(len(self.w_b))
        rows["position"], rows["rotation"] = self.base_position, self.base_rotation
        return rows

    def take(self, index: NDArray[np.intp] | BoolArray | slice) -> Postures:
        """Postures of the chosen stances."""
        return Postures(*(getattr(self, name)[index] for name in FIELDS))

    def permuted_limbs(self, turns: IntArray) -> Postures:
        """The same postures of the robot after turns, shape (k,); see `turns`."""
        return Postures(
            self.base_position,
            turned_frames(self.base_rotation, turns, self.w_m.shape[1]),
            permuted_limbs(self.w_m, turns),
            self.w_b,
            permuted_limbs(self.branch, turns),
            permuted_limbs(self.mask, turns),
            self.tried,
            self.cause,
        )


FIELDS = tuple(field.name for field in fields(Postures))
"""Names of a posture's arrays."""


class PostureTable:
    """Solved postures in arrays that grow by doubling."""

    def __init__(self, limbs: int) -> None:
        """Start empty, for robots of some number of limbs."""
        shapes: list[tuple[tuple[int, ...], type]] = [
            ((3,), float),
            ((3, 3), float),
            ((limbs,), float),
            ((), float),
            ((limbs,), np.int64),
            ((limbs,), np.int64),
            ((), np.int64),
            ((), np.int64),
        ]
        self._arrays: list[NDArray[Any]] = [
            np.zeros((0, *shape), dtype=kind) for shape, kind in shapes
        ]
        self.used = 0
        """Number of postures."""

    def append(self, new: Postures) -> None:
        """Add postures at the end."""
        parts = [getattr(new, name) for name in FIELDS]
        end = self.used + len(new.w_b)
        for i, part in enumerate(parts):
            if end > len(self._arrays[i]):
                grown = np.zeros(
                    (max(end, 2 * len(self._arrays[i])), *part.shape[1:]), dtype=part.dtype
                )
                grown[: self.used] = self._arrays[i][: self.used]
                self._arrays[i] = grown
            self._arrays[i][self.used : end] = part
        self.used = end

    def take(self, index: IntArray) -> Postures:
        """Postures by index."""
        return Postures(*(array[index] for array in self._arrays))
