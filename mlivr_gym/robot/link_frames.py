"""Frames of the links of a limb, those of the manufacturer's description."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.limb import Limb
from mlivr_gym.values import Triple

QUARTER = 0.5 * np.pi
"""A quarter turn [rad]."""


def link_origins(limb: Limb) -> tuple[tuple[Triple, float], ...]:
    """Return the frame of each moving link in that of the link before at joint angle 0, six pairs.

    A pair has the origin [m] and the turn about x [rad]; joints turn about z.
    """
    return (
        ((0.0, 0.0, limb.d1), 0.0),
        ((0.0, 0.0, 0.0), QUARTER),
        ((limb.a2, 0.0, 0.0), 0.0),
        ((limb.a3, 0.0, limb.d4), 0.0),
        ((0.0, -limb.d5, 0.0), QUARTER),
        ((0.0, limb.d6, 0.0), -QUARTER),
    )


def link_frames(limb: Limb, angles: Array) -> Array:
    """Return the frames of the base and the six links in the limb's base frame, shape (7, 4, 4).

    Parameters
    ----------
    limb
        The limb.
    angles
        Joint angles [rad], shape (6,).
    """
    frames = np.empty((7, 4, 4))
    frames[0] = np.eye(4)
    for k, (origin, turn) in enumerate(link_origins(limb)):
        c, s, ca, sa = np.cos(angles[k]), np.sin(angles[k]), np.cos(turn), np.sin(turn)
        step = np.eye(4)
        step[:3, :3] = [[c, -s, 0.0], [s * ca, c * ca, -sa], [s * sa, c * sa, ca]]
        step[:3, 3] = origin
        frames[k + 1] = frames[k] @ step
    return frames


def inverse(frame: Array) -> Array:
    """Return the inverse of a rigid transform, shape (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = frame[:3, :3].T
    out[:3, 3] = -frame[:3, :3].T @ frame[:3, 3]
    return out
