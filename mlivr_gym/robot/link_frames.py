"""Rigid transforms, and the frames of the links of a limb."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.forms import frames_at


class ChainOfLinks(Protocol):
    """A chain of links, such as a `Limb`."""

    @property
    def steps(self) -> Array:
        """Frames of the six links, each in that of the link before, shape (6, 4, 4)."""

    @property
    def senses(self) -> Array:
        """1 or -1 for each joint, shape (6,): against the z axis of its link if -1."""


def link_frames(limb: ChainOfLinks, angles: Array) -> Array:
    """Return the frames of base and links in the limb's base frame, shape (..., 7, 4, 4).

    Joint angles have shape (..., 6) [rad].
    """
    return frames_at(limb.steps, limb.senses, angles)


def rigid(rotation: ArrayLike, position: ArrayLike) -> Array:
    """Return the rigid transform of a rotation (3, 3) and a position (3,), shape (4, 4)."""
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = rotation, position
    return frame


def inverse(frame: Array) -> Array:
    """Return the inverse of a rigid transform, shape (4, 4)."""
    return rigid(frame[:3, :3].T, -frame[:3, :3].T @ frame[:3, 3])


def turn_about_z(angle: float) -> Array:
    """Return the rigid transform of a turn about the z axis [rad], shape (4, 4)."""
    c, s = np.cos(angle), np.sin(angle)
    return rigid([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], (0.0, 0.0, 0.0))


def axes_of(quaternion: Sequence[float]) -> Array:
    """Return the rotation matrix of a unit quaternion w, x, y, z, shape (3, 3)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def quaternion_of(rotation: Array) -> Array:
    """Return the quaternions w, x, y, z of rotation matrices, shapes (..., 3, 3) -> (..., 4)."""
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True)
    return np.asarray(turns + 0.0, dtype=np.float64)
