"""Body axes of a stance before it rolls about the line of its grasps."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.postures.rule import TIE

OPPOSED = 0.2
"""Mean normals shorter than this belong to stances between opposite walls."""


def base_frames(
    grasps: Array, normals: Array, rails: Array
) -> tuple[Array, Array, Array, BoolArray]:
    """Unrolled body axes of stances, in the frame in which the grasps are given.

    Two limbs: x along the line through the grasps, z along the mean normal's part across that line.
    More limbs: z along the mean normal, or against it where that order of the mounts fits better; x
    by the Procrustes fit.

    Args:
        grasps: Held points from their centroid [m], shape (k, N, 3).
        normals: Surface normals, shape (k, N, 3).
        rails: Rail directions at the first grasps, shape (k, 3).

    Returns:
        Body axes as columns, shape (k, 3, 3); outward directions (k, 3); roll axes (k, 3); and
        whether the held walls are opposed (k,).
    """
    count = grasps.shape[1]
    line = grasps[:, 0].copy()
    degenerate = (line**2).sum(axis=1) < 1e-12
    line[degenerate] = rails[degenerate]
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    out = normals.mean(axis=1)
    if count == 2:
        out = _across(out, line)
    opposed = (out**2).sum(axis=1) < OPPOSED**2
    sides = np.cross(normals[:, 0], rails)
    around = _across(rails, line)
    along_rail = (around**2).sum(axis=1) < 1e-6
    around[along_rail] = _across(sides, line)[along_rail]
    out[opposed] = around[opposed]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    e1 = _across(rails, out)
    upright = (e1**2).sum(axis=1) < 1e-6
    e1[upright] = _across(sides, out)[upright]
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    e2 = np.cross(out, e1)
    mounts = np.exp(-2j * np.pi * np.arange(count) / count)
    grasp = np.einsum("kni,ki->kn", grasps, e1) + 1j * np.einsum("kni,ki->kn", grasps, e2)
    fit, mirrored = grasp @ mounts, grasp.conj() @ mounts
    other = np.abs(mirrored) > np.abs(fit) * (1.0 + TIE) + TIE
    yaw = np.angle(np.where(other, mirrored.conj(), fit))[:, None]
    x = np.cos(yaw) * e1 + np.sin(yaw) * e2
    z = np.where(other[:, None], -out, out)
    return np.stack([x, np.cross(z, x), z], axis=2), out, line, opposed


def _across(vectors: Array, axes: Array) -> Array:
    """Parts of `vectors` at right angles to the unit `axes`, both (k, 3)."""
    across: Array = vectors - axes * (vectors * axes).sum(axis=1, keepdims=True)
    return across
