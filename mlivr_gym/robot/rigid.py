"""Masses and inertias of bodies that are fixed to each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
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
