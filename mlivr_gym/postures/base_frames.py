"""Body axes of a stance at roll zero, from which the candidate base poses are made (compiled)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.kinematics.poses import cross, dot, vector
from mlivr_gym.postures.rule import TIE

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

OPPOSED = 0.2
"""A mean surface normal shorter than this marks a stance between opposite walls."""


def mount_azimuths(limbs: int) -> Array:
    """Return directions of mounts at equal angles across the body's z axis, shape (N, 2)."""
    angles = 2.0 * np.pi * np.arange(limbs) / limbs
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


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
    count, limbs = positions.shape[:2]
    frames, outward, lines = np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 3))
    opposed = np.empty(count, dtype=np.bool_)
    directions = mount_azimuths(limbs) if mounts is None else mounts
    grasps = tuple(np.ascontiguousarray(one, dtype=float) for one in (positions, normals, rails))
    _set_frames(grasps, directions, (frames, outward, lines), opposed)
    return frames, outward, lines, opposed


@entry
def _set_frames(
    grasps: tuple[Array, ...], mounts: Array, axes: tuple[Array, Array, Array], opposed: BoolArray
) -> None:
    """Write the results of `base_frames` for positions, normals and rails of grasps."""
    (positions, normals, rails), (frames, outward, lines) = grasps, axes
    for k in range(len(opposed)):
        opposed[k] = set_frame(
            positions[k], normals[k], vector(rails[k]), mounts, (frames[k], outward[k], lines[k])
        )


@kernel
def set_frame(
    positions: Array,
    normals: Array,
    rail: Triple,
    mounts: Array,
    axes: tuple[Array, Array, Array],
) -> bool:
    """Write body axes, outward direction and roll axis of a stance, see `base_frames`.

    Returned is whether the held walls are opposite.
    """
    limbs, line = len(positions), vector(positions[0])
    if dot(line, line) < 1e-12:
        line = rail
    line = scaled_to_one(line)
    outward = mean_over_limbs(normals)
    if limbs == 2:
        outward = perpendicular(outward, line)
    opposed = dot(outward, outward) < OPPOSED * OPPOSED
    side = cross(vector(normals[0]), rail)
    if opposed:
        outward = perpendicular(rail, line)
        if dot(outward, outward) < 1e-6:
            outward = perpendicular(side, line)
    outward = scaled_to_one(outward)
    e1 = perpendicular(rail, outward)
    if dot(e1, e1) < 1e-6:
        e1 = perpendicular(side, outward)
    e1 = scaled_to_one(e1)
    e2 = cross(outward, e1)
    cosine, sine, is_mirrored = _fit_yaw(positions, e1, e2, mounts)
    x = (
        cosine * e1[0] + sine * e2[0],
        cosine * e1[1] + sine * e2[1],
        cosine * e1[2] + sine * e2[2],
    )
    z = (-outward[0], -outward[1], -outward[2]) if is_mirrored else outward
    y = cross(z, x)
    frame, out, roll_axis = axes
    for k in range(3):
        frame[k, 0], frame[k, 1], frame[k, 2] = x[k], y[k], z[k]
        out[k], roll_axis[k] = outward[k], line[k]
    return bool(opposed)


@part
def _fit_yaw(positions: Array, e1: Triple, e2: Triple, mounts: Array) -> tuple[float, float, bool]:
    """Fit the mounts' azimuths to the grasps by Procrustes, in axes across the body's z axis.

    Returned are cosine and sine of the yaw, and whether the reversed order of the mounts fits
    better.
    """
    fit_c = fit_s = mirrored_c = mirrored_s = 0.0
    for limb in range(len(positions)):
        c, s, grasp = mounts[limb, 0], mounts[limb, 1], vector(positions[limb])
        u, v = dot(grasp, e1), dot(grasp, e2)
        fit_c, fit_s = fit_c + (u * c + v * s), fit_s + (v * c - u * s)
        mirrored_c, mirrored_s = mirrored_c + (u * c - v * s), mirrored_s + (v * c + u * s)
    size = np.sqrt(fit_c * fit_c + fit_s * fit_s)
    mirrored_size = np.sqrt(mirrored_c * mirrored_c + mirrored_s * mirrored_s)
    is_mirrored = mirrored_size > size * (1.0 + TIE) + TIE
    if is_mirrored:
        fit_c, fit_s, size = mirrored_c, mirrored_s, mirrored_size
    if size == 0.0:
        return 1.0, fit_s, is_mirrored
    return fit_c / size, fit_s / size, is_mirrored


@kernel
def mean_over_limbs(values: Array) -> Triple:
    """Return the mean of vectors of the limbs, shape (N, 3)."""
    x, y, z = vector(values[0])
    for limb in range(1, len(values)):
        x, y, z = x + values[limb, 0], y + values[limb, 1], z + values[limb, 2]
    limbs = len(values)
    return x / limbs, y / limbs, z / limbs


@kernel
def scaled_to_one(v: Triple) -> Triple:
    """Return a vector scaled to length 1."""
    size = np.sqrt(dot(v, v))
    return v[0] / size, v[1] / size, v[2] / size


@kernel
def perpendicular(v: Triple, axis: Triple) -> Triple:
    """Return the part of a vector that is perpendicular to a unit axis."""
    share = dot(v, axis)
    return v[0] - axis[0] * share, v[1] - axis[1] * share, v[2] - axis[2] * share
