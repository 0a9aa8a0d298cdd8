"""Poses, vectors and rotations (compiled)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Matrix, Record, Vector

if TYPE_CHECKING:
    from mlivr_gym.values import Triple


class Pose(Record):
    """Where a frame is in another one; a name says which, as in `base_in_mount`."""

    position: Vector
    """Its origin [m]."""
    rotation: Matrix
    """Its axes, in columns."""


def pose(position: Array, rotation: Array) -> Pose:
    """Return a pose of a position, shape (3,) [m], and a rotation, shape (3, 3)."""
    out: Pose = Pose.row()
    out["position"], out["rotation"] = position, rotation
    return out


def poses(positions: Array, rotations: Array) -> Any:
    """Return rows of `Pose` from positions, shape (k, 3) [m], and rotations, shape (k, 3, 3)."""
    out = Pose.rows(len(positions))
    out["position"], out["rotation"] = positions, rotations
    return out


@kernel
def vector(a: Array) -> Triple:
    """Return the three numbers of an array, shape (3,)."""
    return a[0], a[1], a[2]


@kernel
def columns(a: Array) -> tuple[Triple, Triple, Triple]:
    """Return the three columns of an array, shape (3, 3)."""
    return (
        (a[0, 0], a[1, 0], a[2, 0]),
        (a[0, 1], a[1, 1], a[2, 1]),
        (a[0, 2], a[1, 2], a[2, 2]),
    )


@kernel
def into(frame: Pose, v: Triple) -> Triple:
    """Return a vector in the axes of a frame."""
    r, (x, y, z) = frame.rotation, v
    return (
        r[0, 0] * x + r[1, 0] * y + r[2, 0] * z,
        r[0, 1] * x + r[1, 1] * y + r[2, 1] * z,
        r[0, 2] * x + r[1, 2] * y + r[2, 2] * z,
    )


@kernel
def seen_from(frame: Pose, p: Triple) -> Triple:
    """Return the coordinates in a frame of a point of the outer frame [m]."""
    o = frame.position
    return into(frame, (p[0] - o[0], p[1] - o[1], p[2] - o[2]))


@kernel
def out_of(frame: Pose, p: Triple) -> Triple:
    """Return the point of the outer frame that has the coordinates `p` in a frame [m]."""
    r, o, (x, y, z) = frame.rotation, frame.position, p
    return (
        o[0] + r[0, 0] * x + r[0, 1] * y + r[0, 2] * z,
        o[1] + r[1, 0] * x + r[1, 1] * y + r[1, 2] * z,
        o[2] + r[2, 0] * x + r[2, 1] * y + r[2, 2] * z,
    )


@kernel
def turn(axis: Triple, c: float, s: float, v: Triple) -> Triple:
    """Rotate a vector about the unit `axis` by an angle of cosine `c` and sine `s` (Rodrigues)."""
    (kx, ky, kz), (x, y, z) = axis, v
    dot = (kx * x + ky * y + kz * z) * (1.0 - c)
    return (
        x * c + (ky * z - kz * y) * s + kx * dot,
        y * c + (kz * x - kx * z) * s + ky * dot,
        z * c + (kx * y - ky * x) * s + kz * dot,
    )


@kernel
def relative_rotation(r0: Array, r1: Array) -> tuple[float, Triple]:
    """Return the angle in [0, pi] [rad] and the unit axis of the rotation from `r0` to `r1`.

    Both have shape (3, 3), in the same frame; the axis is that of `r0^T r1` in the first frame's
    axes.
    """
    a, d, g = columns(r0)
    p, s, v = columns(r1)
    m00, m11, m22 = dot(a, p), dot(d, s), dot(g, v)
    m01, m10, m02, m20 = dot(a, s), dot(d, p), dot(a, v), dot(g, p)
    m12, m21 = dot(d, v), dot(g, s)
    x, y, z = m21 - m12, m02 - m20, m10 - m01
    sine2 = np.sqrt(x * x + y * y + z * z)
    angle: float = math.atan2(sine2, m00 + m11 + m22 - 1.0)
    if sine2 < 1e-7:
        x, y, z = 1.0, 0.0, 0.0
        if angle > 1.0:
            # A half turn is 2 a a^T - 1: its longest column plus the unit vector is parallel to a.
            x, y, z = m00 + 1.0, m10, m20
            if m11 > m00:
                x, y, z = m01, m11 + 1.0, m21
            if m22 > m00 and m22 > m11:
                x, y, z = m02, m12, m22 + 1.0
        sine2 = np.sqrt(x * x + y * y + z * z)
    return angle, (x / sine2, y / sine2, z / sine2)


@kernel
def dot(a: Triple, b: Triple) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Triple, b: Triple) -> Triple:
    """Return the vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def minus(a: Triple, b: Triple) -> Triple:
    """Return the vector from `b` to `a`."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def along(a: Triple, share: float, b: Triple) -> Triple:
    """Return `a` plus `share` times `b`."""
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@kernel
def length(a: Triple) -> float:
    """Return the length of a vector."""
    out: float = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    return out


@entry
def _quaternions(poses: Any, out: Array) -> None:
    """Write quaternions of the poses after the first, in its axes, into `out`, shape (k, 4)."""
    for k in range(len(out)):
        angle, axis = relative_rotation(poses[0].rotation, poses[k + 1].rotation)
        out[k, 0] = math.cos(0.5 * angle)
        for c in range(3):
            out[k, c + 1] = math.sin(0.5 * angle) * axis[c]


def quaternion(rotation: Array) -> Array:
    """Return quaternions w, x, y, z, w >= 0, of rotations, shape (..., 3, 3) -> (..., 4)."""
    turned = rotation.reshape(-1, 3, 3)
    poses, out = Pose.rows(len(turned) + 1), np.empty((len(turned), 4))
    poses["rotation"][0], poses["rotation"][1:] = np.eye(3), turned
    _quaternions(poses, out)
    return out.reshape(*rotation.shape[:-2], 4)
