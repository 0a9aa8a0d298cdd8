"""Body axes of a stance before it rolls about the line of its grasps."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.kinematics.batches import dots, mean_of_limbs, unit
from mlivr_gym.postures.rule import TIE

OPPOSED = 0.2
"""Mean normals shorter than this belong to stances between opposite walls."""


def base_frames(
    grasps: Array, normals: Array, rails: Array, mounts: Array | None = None
) -> tuple[Array, Array, Array, BoolArray]:
    """Unrolled body axes of stances, in the frame in which the grasps are given.

    Two limbs: x along the line through the grasps, z along the mean normal's part across that line.
    More limbs: z along the mean normal, or against it where that order of the mounts fits better; x
    by the Procrustes fit.

    Parameters
    ----------
    grasps
        Held points from their centroid [m], shape (k, N, 3).
    normals
        Surface normals, shape (k, N, 3).
    rails
        Rail directions at the first grasps, shape (k, 3).
    mounts
        Directions of the mounts across the body's z axis, shape (N, 2); None for equal angles.

    Returns
    -------
    tuple[Array, Array, Array, BoolArray]
        Body axes as columns, shape (k, 3, 3); outward directions (k, 3); roll axes (k, 3); and
        whether the held walls are opposed (k,).
    """
    count = grasps.shape[1]
    line = grasps[:, 0].copy()
    degenerate = dots(line, line) < 1e-12
    line[degenerate] = rails[degenerate]
    line = unit(line)
    out = mean_of_limbs(normals)
    if count == 2:
        out = _across(out, line)
    opposed = dots(out, out) < OPPOSED**2
    sides = np.cross(normals[:, 0], rails)
    around = _across(rails, line)
    along_rail = dots(around, around) < 1e-6
    around[along_rail] = _across(sides, line)[along_rail]
    out[opposed] = around[opposed]
    out = unit(out)
    e1 = _across(rails, out)
    upright = dots(e1, e1) < 1e-6
    e1[upright] = _across(sides, out)[upright]
    e1 = unit(e1)
    e2 = np.cross(out, e1)
    (cosine, sine), other = _best_yaw(grasps, e1, e2, mounts)
    x = cosine[:, None] * e1 + sine[:, None] * e2
    z = np.where(other[:, None], -out, out)
    return np.stack([x, np.cross(z, x), z], axis=2), out, line, opposed


def _best_yaw(
    grasps: Array, e1: Array, e2: Array, mounts: Array | None
) -> tuple[tuple[Array, Array], BoolArray]:
    """The Procrustes fit of the mounts' azimuths to the grasps, seen in axes across the body's z.

    Returns
    -------
    tuple[tuple[Array, Array], BoolArray]
        Cosine and sine of the yaw, each (k,), and whether the order of the mounts fits better the
        other way round, shape (k,).
    """
    limbs = grasps.shape[1]
    angles = 2.0 * np.pi * np.arange(limbs) / limbs
    across = (np.cos(angles), np.sin(angles)) if mounts is None else (mounts[:, 0], mounts[:, 1])
    fit, mirrored = np.zeros((2, len(grasps))), np.zeros((2, len(grasps)))
    for limb, (c, s) in enumerate(zip(*across, strict=True)):
        u, v = dots(grasps[:, limb], e1), dots(grasps[:, limb], e2)
        fit += u * c + v * s, v * c - u * s
        mirrored += u * c - v * s, v * c + u * s
    size, other_size = (np.sqrt(a * a + b * b) for a, b in (fit, mirrored))
    other = other_size > size * (1.0 + TIE) + TIE
    chosen, length = np.where(other, mirrored, fit), np.where(other, other_size, size)
    none = length == 0.0
    length[none], chosen[0, none] = 1.0, 1.0
    return (chosen[0] / length, chosen[1] / length), other


def _across(vectors: Array, axes: Array) -> Array:
    """Parts of `vectors` at right angles to the unit `axes`, both (k, 3)."""
    across: Array = vectors - axes * dots(vectors, axes)[:, None]
    return across
