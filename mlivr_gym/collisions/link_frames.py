"""Where the links of a limb and the capsules on them are (compiled)."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.kinematics.ur import limb_axes


@kernel
def frames_of_branch(p: Array, z: Array, lengths: Array, branch: int, frames: Array) -> bool:
    """Link frames in the limb base frame of one branch, without forming joint angles.

    Args:
        p: Flange position in the limb base frame [m], shape (3,).
        z: Flange axis in the limb base frame, shape (3,).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        branch: Branch label.
        frames: Shape (7, 4, 3), filled for links 0 (fixed) to 6 with origin [m] and axes x, y, z,
            those of the manufacturer's link frames; x and y of link 6 are any pair across the
            flange axis.

    Returns:
        Whether the pose is within reach.
    """
    axes, origins = floats(6, 3), floats(6, 3)
    if not limb_axes(p, z, lengths, branch, axes, origins):
        return False
    a2, a3, d4 = lengths[1], lengths[2], lengths[3]
    _fixed_frames(lengths, -axes[1, 1], axes[1, 0], frames)
    for k in range(3):
        frames[2, 0, k] = origins[1, k]
        frames[2, 1, k] = (origins[2, k] - origins[1, k]) / a2
        frames[3, 0, k] = origins[2, k]
        frames[3, 1, k] = (origins[3, k] - origins[2, k]) / a3
        frames[4, 0, k] = origins[3, k] + d4 * axes[1, k]
        frames[4, 2, k] = -axes[4, k]
        frames[5, 0, k] = origins[4, k]
        frames[5, 2, k] = axes[5, k]
        frames[5, 3, k] = axes[4, k]
        frames[6, 0, k] = p[k]
        frames[6, 3, k] = z[k]
        for link in range(2, 5):
            frames[link, 3, k] = axes[1, k]
    _cross(frames, 2, 3, 1, 2)
    _cross(frames, 3, 3, 1, 2)
    _cross(frames, 4, 2, 3, 1)
    _cross(frames, 5, 2, 3, 1)
    for k in range(3):
        frames[6, 1, k] = frames[5, 1, k]
    _cross(frames, 6, 3, 1, 2)
    return True


@kernel
def frames_of_angles(q: Array, lengths: Array, frames: Array) -> None:
    """Link frames in the limb base frame of joint angles `q`, shape (6,) [rad].

    Fills `frames` like `frames_of_branch`.
    """
    _, a2, a3, d4, d5, d6 = lengths
    c1, s1 = np.cos(q[0]), np.sin(q[0])
    _fixed_frames(lengths, c1, s1, frames)
    angle = 0.0
    for link in range(2, 5):
        angle += q[link - 1]
        c, s = np.cos(angle), np.sin(angle)
        frames[link, 1, 0], frames[link, 1, 1], frames[link, 1, 2] = c * c1, c * s1, s
        frames[link, 2, 0], frames[link, 2, 1], frames[link, 2, 2] = -s * c1, -s * s1, c
        frames[link, 3, 0], frames[link, 3, 1], frames[link, 3, 2] = s1, -c1, 0.0
    c5, s5 = np.cos(q[4]), np.sin(q[4])
    for k in range(3):
        frames[2, 0, k] = frames[1, 0, k]
        frames[3, 0, k] = frames[2, 0, k] + a2 * frames[2, 1, k]
        frames[4, 0, k] = frames[3, 0, k] + a3 * frames[3, 1, k] + d4 * frames[4, 3, k]
        frames[5, 0, k] = frames[4, 0, k] - d5 * frames[4, 2, k]
        frames[5, 1, k] = c5 * frames[4, 1, k] + s5 * frames[4, 3, k]
        frames[5, 2, k] = c5 * frames[4, 3, k] - s5 * frames[4, 1, k]
        frames[5, 3, k] = -frames[4, 2, k]
        frames[6, 0, k] = frames[5, 0, k] + d6 * frames[5, 2, k]
        frames[6, 1, k] = frames[5, 1, k]
        frames[6, 2, k] = -frames[5, 3, k]
        frames[6, 3, k] = frames[5, 2, k]


@kernel
def _fixed_frames(lengths: Array, c1: float, s1: float, frames: Array) -> None:
    """Frames of the limb's base and of the shoulder, whose joint has cosine `c1` and sine `s1`."""
    for link in range(2):
        for row in range(4):
            for k in range(3):
                frames[link, row, k] = 1.0 if row == k + 1 else 0.0
    frames[1, 0, 2] = lengths[0]
    frames[1, 1, 0], frames[1, 1, 1] = c1, s1
    frames[1, 2, 0], frames[1, 2, 1] = -s1, c1


@kernel
def _cross(frames: Array, link: int, a: int, b: int, out: int) -> None:
    """Cross product of two rows of a link's frame into a third."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        frames[link, out, k] = (
            frames[link, a, i] * frames[link, b, j] - frames[link, a, j] * frames[link, b, i]
        )


@kernel
def place(
    frames: Array,
    shapes: tuple[Any, ...],
    mount_rotation: Array,
    mount_position: Array,
    ends: Array,
) -> None:
    """Put the capsules of a limb in place.

    Args:
        frames: Link frames in the limb base frame, shape (7, 4, 3).
        shapes: `LimbShapes.arrays`.
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        ends: Filled with the capsules' ends in the body frame [m], shape (c, 2, 3).
    """
    link, local = shapes[0], shapes[1]
    for c in range(len(link)):
        f = link[c]
        for e in range(2):
            x, y, z = local[c, e, 0], local[c, e, 1], local[c, e, 2]
            u = frames[f, 0, 0] + x * frames[f, 1, 0] + y * frames[f, 2, 0] + z * frames[f, 3, 0]
            v = frames[f, 0, 1] + x * frames[f, 1, 1] + y * frames[f, 2, 1] + z * frames[f, 3, 1]
            w = frames[f, 0, 2] + x * frames[f, 1, 2] + y * frames[f, 2, 2] + z * frames[f, 3, 2]
            for k in range(3):
                ends[c, e, k] = (
                    mount_position[k]
                    + mount_rotation[k, 0] * u
                    + mount_rotation[k, 1] * v
                    + mount_rotation[k, 2] * w
                )


@kernel
def to_world(ends: Array, position: Array, rotation: Array, out: Array) -> None:
    """Capsule ends in the world from those in the body frame.

    Args:
        ends: In the body frame [m], shape (c, 2, 3).
        position: Base position in the world [m], shape (3,).
        rotation: Base rotation in the world, shape (3, 3).
        out: Filled, shape (c, 2, 3) [m].
    """
    for c in range(ends.shape[0]):
        for e in range(2):
            x, y, z = ends[c, e, 0], ends[c, e, 1], ends[c, e, 2]
            for k in range(3):
                out[c, e, k] = (
                    position[k] + rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
                )
