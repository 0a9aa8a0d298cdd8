"""Straight ways of the base between two postures (compiled).

The base moves on `t(s)`, `R(s)`, `s` in [0, 1]; timing is a matter of the trajectory. Translation
is a straight line, rotation is slerp.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Record, Vector
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.poses import (
    Pose,
    along,
    dot,
    minus,
    out_of,
    relative_rotation,
    turn,
    vector,
)

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

HALF_TURN = 1e-6
"""Turns that fall short of half a turn by less count as one [rad]."""

LEANING = (0.2673, 0.5345, 0.8018)
"""A direction across no symmetry of a module."""

SAME_PLACE = 1e-6
"""Coordinates of two base positions that differ by less count as equal [m].

Many postures of a regular map are mirror images, whose coordinates are equal but for rounding: what
rounding leaves must not decide which way the base turns.
"""


class BasePath(Record):
    """A way of the base from one posture to another, in the world, computed once."""

    first: Pose
    """Base at the start."""
    last: Pose
    """Base at the end."""
    axis: Vector
    """Unit axis about which the base turns, in its axes at the start."""
    angle: float
    """How far it turns about that [rad]."""


@entry
def set_path(path: BasePath, first: Pose, last: Pose) -> None:
    """Fill `path` with the straight way from one base pose in the world to another."""
    for k in range(3):
        path.first.position[k], path.last.position[k] = first.position[k], last.position[k]
        for column in range(3):
            path.first.rotation[k, column] = first.rotation[k, column]
            path.last.rotation[k, column] = last.rotation[k, column]
    path.angle, axis = relative_rotation(first.rotation, last.rotation)
    if path.angle > np.pi - HALF_TURN:
        axis = _half_turn_axis(first, last, axis)
    path.axis[0], path.axis[1], path.axis[2] = axis


@kernel
def _half_turn_axis(first: Pose, last: Pose, axis: Triple) -> Triple:
    """Return the axis of a half turn, whose senses are equally short, in the first pose's axes.

    The sense is such that the path back is the path there: of the turn that begins where the base
    comes first by coordinates, the axis leans to `LEANING` in the world.
    """
    in_world = minus(out_of(first, axis), vector(first.position))
    sense = 1.0 if dot(in_world, LEANING) > 0.0 else -1.0
    for k in range(3):
        ahead = last.position[k] - first.position[k]
        if abs(ahead) > SAME_PLACE:
            sense *= 1.0 if ahead > 0.0 else -1.0
            break
    return sense * axis[0], sense * axis[1], sense * axis[2]


@kernel
def comes_first(a: Triple, b: Triple) -> bool:
    """Return whether a point comes before another by its coordinates, x first."""
    for k in range(3):
        if abs(a[k] - b[k]) > SAME_PLACE:
            return a[k] < b[k]
    return False


@kernel
def lift_path(path: BasePath, base: Pose, grasp: Grasp, lift: float) -> None:
    """Fill `path` with a departure: the base moves into the surface instead of the limb out of it.

    The base is given in the frame of the grasp that is left; `lift` is how far it moves [m].
    """
    set_path(path, base, base)
    for k in range(3):
        path.last.position[k] -= lift * grasp.normal[k]


@kernel
def pose_on_path(path: BasePath, s: float, out: Pose) -> None:
    """Compute the base pose in the world at `s` on a path, into `out`."""
    start = vector(path.first.position)
    here = along(start, s, minus(vector(path.last.position), start))
    out.position[0], out.position[1], out.position[2] = here
    axis, rotation = vector(path.axis), path.first.rotation
    c, sine = math.cos(s * path.angle), math.sin(s * path.angle)
    for row in range(3):
        # A row of R exp(w) is the row of R turned back.
        axes = turn(axis, c, -sine, (rotation[row, 0], rotation[row, 1], rotation[row, 2]))
        out.rotation[row, 0], out.rotation[row, 1], out.rotation[row, 2] = axes


@entry
def poses_along(path: BasePath, s: Array, out: Any) -> None:
    """Compute base poses in the world, rows of `Pose`, at path parameters 0 to 1, shape (k,)."""
    for i in range(len(s)):
        pose_on_path(path, s[i], out[i])


def base_path(first: Pose, last: Pose) -> BasePath:
    """Return the straight way from one base pose in the world to another."""
    out: BasePath = BasePath.row()
    set_path(out, first, last)
    return out


def base_rows(path: BasePath, s: Array) -> Any:
    """Return base poses in the world, rows of `Pose`, at path parameters 0 to 1, shape (k,)."""
    out = Pose.rows(len(s))
    poses_along(path, np.ascontiguousarray(s, dtype=np.float64), out)
    return out


def base_poses(path: BasePath, s: Array) -> tuple[Array, Array]:
    """Return base positions (k, 3) [m] and rotations (k, 3, 3) at path parameters, shape (k,)."""
    out = base_rows(path, s)
    return out["position"], out["rotation"]
