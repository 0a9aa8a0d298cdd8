"""Rigid transforms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from mlivr_gym.arrays import Array

PARALLEL = 1e-6
"""Sine of the angle between axes below which they count as parallel."""


def rigid(rotation: ArrayLike, position: ArrayLike) -> Array:
    """Return the rigid transform of a rotation (3, 3) and a position (3,), shape (4, 4)."""
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = rotation, position
    return frame


def inverse(frame: Array) -> Array:
    """Return the inverse of a rigid transform, shape (4, 4)."""
    return rigid(frame[:3, :3].T, -frame[:3, :3].T @ frame[:3, 3])


def foot(axes: Array, points: Array, k: int, other: int) -> Array:
    """Return the point of an axis that is closest to another one, of parallel ones its own point.

    Axes are unit vectors and a point on each, both of shape (n, 3).
    """
    across = np.cross(axes[other], np.cross(axes[k], axes[other]))
    share = float(axes[k] @ across)
    point: Array = points[k]
    if share > PARALLEL * PARALLEL:
        point = point + float((points[other] - points[k]) @ across) / share * axes[k]
    return point


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
    """Return the quaternions w, x, y, z of rotation matrices, shapes (..., 3, 3) -> (..., 4).

    The first number that is not 0 is positive. SciPy has the same, and takes long to load.
    """
    m = np.asarray(rotation, dtype=np.float64)
    trace, diagonal = np.trace(m, axis1=-2, axis2=-1), np.diagonal(m, axis1=-2, axis2=-1)
    # Products of the largest of the four numbers with each are sums of entries.
    w = (1.0 + trace, m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0],
         m[..., 1, 0] - m[..., 0, 1])  # fmt: skip
    rows = [np.stack(w, axis=-1)]
    for i in range(3):
        row = m[..., i, :] + m[..., :, i]
        row[..., i] = 1.0 - trace + 2.0 * m[..., i, i]
        rows.append(np.concatenate([w[i + 1][..., None], row], axis=-1))
    largest = np.argmax(np.concatenate([trace[..., None], diagonal], axis=-1), axis=-1)
    found = np.take_along_axis(np.stack(rows, axis=-2), largest[..., None, None], axis=-2)[
        ..., 0, :
    ]
    found = found / np.linalg.norm(found, axis=-1, keepdims=True)
    first = np.take_along_axis(found, np.argmax(found != 0.0, axis=-1)[..., None], axis=-1)
    return np.asarray(np.where(first < 0.0, -found, found) + 0.0)
