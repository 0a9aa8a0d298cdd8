"""Rigid transforms, and masses and inertias of bodies that are fixed to each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from mlivr_gym.arrays import Array
from mlivr_gym.values import Triple

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Rows and columns of an inertia in the order xx, yy, zz, xy, xz, yz."""


def rigid(rotation: ArrayLike, position: ArrayLike) -> Array:
    """Return the rigid transform of a rotation (3, 3) and a position (3,), shape (4, 4)."""
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = rotation, position
    return frame


def inverse(frame: Array) -> Array:
    """Return the inverse of a rigid transform, shape (4, 4)."""
    return rigid(frame[:3, :3].T, -frame[:3, :3].T @ frame[:3, 3])


def frame_on(given: Array, z: Array, anchor: Array, place: Array) -> Array:
    """Return the frame with a z axis and its origin on that where a place is closest to it.

    Its x axis is that of a given frame, or where z is close to it the given y axis.
    """
    x = given[:3, 0] - (given[:3, 0] @ z) * z
    if np.linalg.norm(x) < 0.5:
        x = given[:3, 1] - (given[:3, 1] @ z) * z
    x /= np.linalg.norm(x)
    origin = anchor + ((place - anchor) @ z) * z
    return rigid(np.stack([x, np.cross(z, x), z], axis=1), origin)


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


class RigidBody(NamedTuple):
    """A mass with its centre and inertia."""

    mass: float
    """Mass [kg]."""
    centre: Triple
    """Centre of mass [m]."""
    inertia: tuple[float, ...]
    """Inertia about it, in the order of `PAIRS` [kg m^2]."""

    @property
    def principal_moments(self) -> Array:
        """Its principal moments of inertia, the least first [kg m^2], shape (3,)."""
        return np.asarray(np.linalg.eigvalsh(inertia_matrix(self.inertia)), dtype=np.float64)

    def moved(self, frame: Array) -> RigidBody:
        """Return the body, given in a frame (4, 4), in the frame in which that one is given."""
        turn = frame[:3, :3]
        x, y, z = (frame[:3, 3] + turn @ np.array(self.centre)).tolist()
        inertia = turn @ inertia_matrix(self.inertia) @ turn.T
        return RigidBody(self.mass, (x, y, z), tuple(float(inertia[pair]) for pair in PAIRS))


def combined(parts: Sequence[RigidBody]) -> RigidBody:
    """Return parts in one frame as one body (parallel axis theorem)."""
    mass = sum(part.mass for part in parts)
    centre = sum((part.mass * np.array(part.centre) for part in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        away = np.array(part.centre) - centre
        about = (away @ away) * np.eye(3) - np.outer(away, away)
        inertia += inertia_matrix(part.inertia) + part.mass * about
    x, y, z = centre.tolist()
    return RigidBody(mass, (x, y, z), tuple(float(inertia[pair]) for pair in PAIRS))


def inertia_matrix(inertia: Sequence[float]) -> Array:
    """Return an inertia in the order of `PAIRS` as a matrix, shape (3, 3)."""
    matrix = np.zeros((3, 3))
    for (row, column), value in zip(PAIRS, inertia, strict=True):
        matrix[row, column] = matrix[column, row] = value
    return matrix


def box_inertia(mass: float, edges: Array) -> tuple[float, ...]:
    """Return the inertia of a homogeneous box about its middle [kg m^2]."""
    square = edges**2
    return (*(mass * (square.sum() - square) / 12.0).tolist(), 0.0, 0.0, 0.0)


def cylinder(mass: float, radius: float, length: float, height: float) -> RigidBody:
    """Return a cylinder along z whose middle is at a height [kg, m]."""
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    return RigidBody(
        mass, (0.0, 0.0, height), (across, across, 0.5 * mass * radius**2, 0.0, 0.0, 0.0)
    )
