"""Body axes of a stance at roll zero, from which the candidate base poses are made."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.kinematics.batches import dots, mean_of_limbs, unit
from mlivr_gym.postures.rule import TIE

OPPOSED = 0.2
"""A mean surface normal shorter than this marks a stance between opposite walls."""


def base_frames(
    positions: Array, normals: Array, rails: Array, mounts: Array | None = None
) -> tuple[Array, Array, Array, BoolArray]:
    """Compute the body axes of stances at roll zero, in the frame in which the positions are given.

    With two limbs, x lies along the line through the grasps, and z along the part of the mean
    normal perpendicular to that line. With more limbs, z lies along the mean normal, or against it
    if the order of the mounts fits better that way, and x follows from the Procrustes fit of the
    mounts to the grasps. Held points relative to their centroid [m] and surface normals have shape
    (k, N, 3), rail directions at the first grasps (k, 3), and directions of the mounts across the
    body's z axis (N, 2), None for equal angles. Returned are body axes as columns (k, 3, 3),
    outward directions (k, 3), roll axes (k, 3), and whether the held walls are opposite (k,).
    """
    count = positions.shape[1]
    line = positions[:, 0].copy()
    degenerate = dots(line, line) < 1e-12
    line[degenerate] = rails[degenerate]
    line = unit(line)
    outward = mean_of_limbs(normals)
    if count == 2:
        outward = _perpendicular(outward, line)
    opposed = dots(outward, outward) < OPPOSED**2
    sides = np.cross(normals[:, 0], rails)
    around = _perpendicular(rails, line)
    along_rail = dots(around, around) < 1e-6
    around[along_rail] = _perpendicular(sides, line)[along_rail]
    outward[opposed] = around[opposed]
    outward = unit(outward)
    e1 = _perpendicular(rails, outward)
    upright = dots(e1, e1) < 1e-6
    e1[upright] = _perpendicular(sides, outward)[upright]
    e1 = unit(e1)
    e2 = np.cross(outward, e1)
    (cosine, sine), is_mirrored = _fit_yaw(positions, e1, e2, mounts)
    x = cosine[:, None] * e1 + sine[:, None] * e2
    z = np.where(is_mirrored[:, None], -outward, outward)
    return np.stack([x, np.cross(z, x), z], axis=2), outward, line, opposed


def _fit_yaw(
    positions: Array, e1: Array, e2: Array, mounts: Array | None
) -> tuple[tuple[Array, Array], BoolArray]:
    """Fit the mounts' azimuths to the grasps by Procrustes, in axes across the body's z axis.

    Returned are cosine and sine of the yaw, and whether the reversed order of the mounts fits
    better, shape (k,) each.
    """
    limbs = positions.shape[1]
    angles = 2.0 * np.pi * np.arange(limbs) / limbs
    across = (np.cos(angles), np.sin(angles)) if mounts is None else (mounts[:, 0], mounts[:, 1])
    fit, mirrored = np.zeros((2, len(positions))), np.zeros((2, len(positions)))
    for limb, (c, s) in enumerate(zip(*across, strict=True)):
        u, v = dots(positions[:, limb], e1), dots(positions[:, limb], e2)
        fit += u * c + v * s, v * c - u * s
        mirrored += u * c - v * s, v * c + u * s
    size, mirrored_size = (np.sqrt(a * a + b * b) for a, b in (fit, mirrored))
    is_mirrored = mirrored_size > size * (1.0 + TIE) + TIE
    chosen, length = (
        np.where(is_mirrored, mirrored, fit),
        np.where(is_mirrored, mirrored_size, size),
    )
    undefined = length == 0.0
    length[undefined], chosen[0, undefined] = 1.0, 1.0
    return (chosen[0] / length, chosen[1] / length), is_mirrored


def _perpendicular(vectors: Array, axes: Array) -> Array:
    """Return the parts of vectors that are perpendicular to unit axes, both of shape (k, 3)."""
    across: Array = vectors - axes * dots(vectors, axes)[:, None]
    return across
