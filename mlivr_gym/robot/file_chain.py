"""The joints of a limb exactly as a file has them, which may deviate from its family a little.

The axes of a calibrated arm are neither quite parallel nor quite perpendicular. Plans are made with
the exact axes of its family, whose branches have a closed form. Where its flange is to be on a
branch, the arm of the file has angles close to those of the family, which Newton's method finds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError

STEPS = 12
"""Largest number of Newton's steps; three are usual."""

ACCURACY = 1e-11
"""Distance [m] and angle [rad] of a flange from where it is to be that counts as 0."""

FARTHEST = 0.1
"""Largest difference of an angle from that of the family [rad]; more is another solution."""


class FileChain(NamedTuple):
    """Joints that move, in the base frame of the limb, where their angles are 0 in the file."""

    axes: Array
    """Unit vectors along them, shape (6, 3)."""
    anchors: Array
    """A point on each [m], shape (6, 3)."""
    flange: Array
    """Frame of the flange, its axes those that the family has, shape (4, 4)."""

    def seen_from(self, frame: Array) -> FileChain:
        """Return the chain as seen from a frame (4, 4) of the present one."""
        turn, place = frame[:3, :3], frame[:3, 3]
        return FileChain(
            self.axes @ turn, (self.anchors - place) @ turn, np.linalg.inv(frame) @ self.flange
        )

    def flange_at(self, angles: Array) -> Array:
        """Return the frame of the flange by the angles of the file [rad], (6,) -> (4, 4)."""
        return self._moved(angles)[2]

    def solved(self, target: Array, angles: Array, names: Sequence[str]) -> Array:
        """Return the angles at which the flange is in a frame (4, 4), close to given ones (6,).

        Raises a `RobotError` with the names of the joints if there are none so close.
        """
        from scipy.spatial.transform import Rotation

        found = np.array(angles, dtype=np.float64)
        for _ in range(STEPS):
            axes, anchors, flange = self._moved(found)
            turn = Rotation.from_matrix(target[:3, :3] @ flange[:3, :3].T).as_rotvec()
            error = np.concatenate([target[:3, 3] - flange[:3, 3], turn])
            if np.abs(error).max() <= ACCURACY:
                return found
            velocities = np.cross(axes, flange[:3, 3] - anchors)
            found += np.linalg.lstsq(np.hstack([velocities, axes]).T, error)[0]
            if not np.abs(found - angles).max() <= FARTHEST:
                break
        raise RobotError(
            f"the limb of joints {names[0]!r} to {names[-1]!r} does not bring its flange where the "
            f"plan has it within {FARTHEST:g} rad of the plan's angles; they are too close to a "
            "singular posture"
        )

    def _moved(self, angles: Array) -> tuple[Array, Array, Array]:
        """Return axes, anchors [m] and the flange where the joints have turned."""
        from scipy.spatial.transform import Rotation

        turn, place = np.eye(3), np.zeros(3)
        axes, anchors = np.empty((6, 3)), np.empty((6, 3))
        turns = Rotation.from_rotvec(np.asarray(angles)[:, None] * self.axes).as_matrix()
        for k in range(6):
            axes[k], anchors[k] = turn @ self.axes[k], place + turn @ self.anchors[k]
            place = place + turn @ (self.anchors[k] - turns[k] @ self.anchors[k])
            turn = turn @ turns[k]
        flange = self.flange.copy()
        flange[:3, :3], flange[:3, 3] = turn @ flange[:3, :3], place + turn @ flange[:3, 3]
        return axes, anchors, flange
