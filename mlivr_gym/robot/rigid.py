"""Masses and inertias of bodies that are fixed to each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.description import LEAST_MASS
from mlivr_gym.values import Triple

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Rows and columns of an inertia in the order xx, yy, zz, xy, xz, yz."""


class RigidBody(NamedTuple):
    """A mass with its centre and inertia."""

    mass: float
    """Mass [kg]."""
    centre: Triple
    """Centre of mass [m]."""
    inertia: tuple[float, ...]
    """Inertia about it, in the order of `PAIRS` [kg m^2]."""

    def moved(self, frame: Array) -> RigidBody:
        """Return the body, given in a frame (4, 4), in the frame in which that one is given."""
        turn = frame[:3, :3]
        x, y, z = (frame[:3, 3] + turn @ np.array(self.centre)).tolist()
        inertia = turn @ _inertia_matrix(self) @ turn.T
        return RigidBody(self.mass, (x, y, z), tuple(float(inertia[pair]) for pair in PAIRS))


def joined(model: Any, data: Any, numbers: Iterable[int], frame: Array) -> RigidBody:
    """Return bodies of a model, by their numbers, as one, as seen from a frame.

    The frame in the world has shape (4, 4); the data have the poses of bodies.
    """
    parts = []
    for body in numbers:
        mass = float(model.body_mass[body])
        if mass <= 2.0 * LEAST_MASS:
            continue
        turn = data.xmat[body].reshape(3, 3)
        centre = data.xpos[body] + turn @ model.body_ipos[body]
        axes = turn @ _matrix(model.body_iquat[body])
        parts.append((mass, centre, axes @ np.diag(model.body_inertia[body]) @ axes.T))
    mass, centre, inertia = _sum(parts)
    if not mass:
        return RigidBody(0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
    turn = frame[:3, :3].T
    inertia = turn @ inertia @ turn.T
    x, y, z = (turn @ (centre - frame[:3, 3])).tolist()
    return RigidBody(mass, (x, y, z), tuple(float(inertia[pair]) for pair in PAIRS))


def _sum(parts: Sequence[tuple[float, Array, Array]]) -> tuple[float, Array, Array]:
    """Return mass, centre and inertia about it of parts in one frame (parallel axis theorem)."""
    mass = sum(part[0] for part in parts)
    centre = sum((m * c for m, c, _ in parts), np.zeros(3)) / (mass or 1.0)
    inertia = np.zeros((3, 3))
    for m, c, about in parts:
        away = c - centre
        inertia += about + m * ((away @ away) * np.eye(3) - np.outer(away, away))
    return mass, centre, inertia


def combined(parts: Iterable[RigidBody]) -> RigidBody:
    """Return parts in one frame as one body."""
    mass, centre, inertia = _sum([(p.mass, np.array(p.centre), _inertia_matrix(p)) for p in parts])
    x, y, z = centre.tolist()
    return RigidBody(mass, (x, y, z), tuple(float(inertia[pair]) for pair in PAIRS))


def _inertia_matrix(body: RigidBody) -> Array:
    """Return the inertia of a body about its centre as a matrix, shape (3, 3)."""
    matrix = np.zeros((3, 3))
    for (row, column), value in zip(PAIRS, body.inertia, strict=True):
        matrix[row, column] = matrix[column, row] = value
    return matrix


def box_inertia(mass: float, edges: Array) -> tuple[float, ...]:
    """Return the inertia of a homogeneous box about its middle [kg m^2]."""
    square = edges**2
    return (*(mass * (square.sum() - square) / 12.0).tolist(), 0.0, 0.0, 0.0)


def _matrix(quaternion: Array) -> Array:
    w, x, y, z = quaternion
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def cylinder(mass: float, radius: float, length: float, height: float) -> RigidBody:
    """Return a cylinder along z whose middle is at a height [kg, m]."""
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    return RigidBody(
        mass, (0.0, 0.0, height), (across, across, 0.5 * mass * radius**2, 0.0, 0.0, 0.0)
    )
