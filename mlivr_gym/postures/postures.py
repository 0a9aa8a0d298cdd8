"""Postures of many stances as arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.queries import CheckedPostures
from mlivr_gym.kinematics.poses import Pose


@dataclass(frozen=True)
class Postures:
    """Postures of k stances with N limbs."""

    base_position: Array
    """Base positions in the world [m], shape (k, 3)."""
    base_rotation: Array
    """Base rotations in the world, shape (k, 3, 3)."""
    w_m: Array
    """Limb manipulability, shape (k, N); 0 where the stance cannot be held."""
    w_b: Array
    """Base manipulability, shape (k,)."""
    branch: IntArray
    """Branch of each limb at which the posture has its margin, shape (k, N)."""
    branch_sets: IntArray
    """Branches and flips on which each limb may hold, as 16-bit branch sets, shape (k, N)."""
    pose_number: IntArray
    """Index of the base pose among the candidates, see `base_poses`, shape (k,); -1 for a
    given base pose, and where no candidate was chosen."""
    cause: IntArray
    """Cause of the collision where only a collision keeps the stance from being held, else 0, shape
    (k,); see `distances`."""

    @property
    def reachable(self) -> BoolArray:
        """Whether inverse kinematics has a solution for all limbs, shape (k,)."""
        reachable: BoolArray = (self.w_b > 0.0) | (self.cause > 0)
        return reachable

    @property
    def base_rows(self) -> Any:
        """Base poses as compiled code reads them: records of `Pose`, shape (k,)."""
        rows = Pose.rows(len(self.w_b))
        rows["position"], rows["rotation"] = self.base_position, self.base_rotation
        return rows

    def checked(
        self, points: IntArray, every: bool, first: IntArray | None = None
    ) -> CheckedPostures:
        """Return them as checks against boxes read them, with the points held, shape (k, N).

        `every` says whether all branches are checked and removed from the branch sets; otherwise
        only the causes on the branches of the postures are set. Both are changed in place. Limbs
        are checked from the `first` on, shape (k,), by default from limb 0.
        """
        points, every_branch = np.ascontiguousarray(points), np.array([every])
        first = np.zeros(len(points), dtype=np.int64) if first is None else first
        return CheckedPostures(
            points, first, self.base_rows, self.branch, self.branch_sets, self.cause, every_branch
        )

    def take(self, index: NDArray[np.intp] | BoolArray | slice) -> Postures:
        """Return the postures of selected stances."""
        return Postures(*(getattr(self, name)[index] for name in FIELDS))


FIELDS = tuple(field.name for field in fields(Postures))
"""Names of the arrays of `Postures`."""
