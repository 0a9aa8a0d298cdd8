"""Frames of the links of a limb, those of the manufacturer's description."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mlivr_gym.arrays import Array
from mlivr_gym.robot.file_joints import axes_of
from mlivr_gym.robot.limb import LimbBase


def link_frames(limb: LimbBase, angles: Array) -> Array:
    """Return the frames of base and links in the limb's base frame, shape (..., 7, 4, 4).

    Joint angles have shape (..., 6) [rad].
    """
    frames = np.empty((*angles.shape[:-1], 7, 4, 4))
    frames[..., 0, :, :] = np.eye(4)
    for k, (origin, quaternion) in enumerate(limb.link_offsets):
        step, turns = np.zeros((*angles.shape[:-1], 4, 4)), limb.signs[k] * angles[..., k]
        step[..., 0, 0] = step[..., 1, 1] = np.cos(turns)
        step[..., 1, 0] = np.sin(turns)
        step[..., 0, 1] = -step[..., 1, 0]
        step[..., 2, 2] = step[..., 3, 3] = 1.0
        step[..., :3, :3] = axes_of(quaternion) @ step[..., :3, :3]
        step[..., :3, 3] = origin
        frames[..., k + 1, :, :] = frames[..., k, :, :] @ step
    return frames


def rigid(rotation: ArrayLike, position: ArrayLike) -> Array:
    """Return the rigid transform of a rotation (3, 3) and a position (3,), shape (4, 4)."""
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = rotation, position
    return frame


def inverse(frame: Array) -> Array:
    """Return the inverse of a rigid transform, shape (4, 4)."""
    return rigid(frame[:3, :3].T, -frame[:3, :3].T @ frame[:3, 3])
