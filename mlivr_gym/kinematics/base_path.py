"""Base paths between two postures (compiled).

The base moves on `t(s)`, `R(s)`, `s` in [0, 1]; timing is a matter of the trajectory. Rotation is
slerp. Translation is a straight line, or, where that fails, an arc about a pivot, the centroid of
the points held: the distance to the pivot changes linearly while the direction turns by slerp.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Record, Vector
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.poses import (
    Pose,
    along,
    angle_between,
    dot,
    into,
    length,
    minus,
    out_of,
    relative_rotation,
    seen_from,
    turn,
    vector,
)

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

STRAIGHT, ARC = (cast(int, k) for k in np.arange(2))
PATH_KINDS = ("straight", "arc")
"""Names of the path kinds, by number."""

HALF_TURN = 1e-6
"""Turns that fall short of half a turn by less count as one [rad]."""

LEANING = (0.2673, 0.5345, 0.8018)
"""A direction across no symmetry of a module."""

SAME_PLACE = 1e-6
"""Coordinates of two base positions that differ by less count as equal [m].

Many postures of a regular map are mirror images, whose coordinates are equal but for rounding: what
rounding leaves must not decide which way the base turns.
"""

CLOSEST_PIVOT = 1e-3
"""An arc whose pivot lies nearer to one of its ends than this is not taken [m]."""


class BasePath(Record):
    """A base path from one posture to another, in the world, computed once."""

    first: Pose
    """Base at the start."""
    last: Pose
    """Base at the end."""
    kind: int
    """`STRAIGHT` or `ARC`."""
    pivot: Vector
    """Centre of the arc [m]."""
    axis: Vector
    """Unit axis about which the base turns, in its axes at the start."""
    angle: float
    """How far it turns about that [rad]."""
    radius0: float
    """Distance from the pivot at the start [m]."""
    radius1: float
    """Distance from the pivot at the end [m]."""
    arc_angle: float
    """Angle between start and end, seen from the pivot [rad]."""
    speed: float
    """Upper bound of the speed of the base origin on a path of unit duration [m]."""


@entry
def set_path(path: BasePath, first: Pose, last: Pose, kind: int, pivot: Triple) -> None:
    """Fill `path` with the base path of a kind, `STRAIGHT` or `ARC`, from one base pose to another.

    Poses are in the world; an arc has the centre `pivot` [m].
    """
    for k in range(3):
        path.first.position[k], path.last.position[k] = first.position[k], last.position[k]
        path.pivot[k] = pivot[k]
        for column in range(3):
            path.first.rotation[k, column] = first.rotation[k, column]
            path.last.rotation[k, column] = last.rotation[k, column]
    path.kind = kind
    path.angle, axis = relative_rotation(first.rotation, last.rotation)
    if path.angle > np.pi - HALF_TURN:
        axis = _half_turn_axis(first, last, axis)
    path.axis[0], path.axis[1], path.axis[2] = axis
    start, end = vector(first.position), vector(last.position)
    from_pivot, to_pivot = minus(start, pivot), minus(end, pivot)
    path.radius0, path.radius1 = length(from_pivot), length(to_pivot)
    path.arc_angle = angle_between(from_pivot, to_pivot)
    path.speed = length(minus(end, start))
    if kind != STRAIGHT:
        far = max(path.radius0, path.radius1)
        path.speed = np.hypot(path.radius1 - path.radius0, far * path.arc_angle)


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
def resting(path: BasePath, base: Pose) -> None:
    """Fill `path` with that of a base that stays."""
    set_path(path, base, base, STRAIGHT, (0.0, 0.0, 0.0))


@kernel
def lift_path(path: BasePath, base: Pose, grasp: Grasp, lift: float) -> None:
    """Fill `path` with a departure: the base moves into the surface instead of the limb out of it.

    The base is given in the frame of the grasp that is left; `lift` is how far it moves [m].
    """
    set_path(path, base, base, STRAIGHT, (0.0, 0.0, 0.0))
    for k in range(3):
        path.last.position[k] -= lift * grasp.normal[k]
    path.speed = lift


@kernel
def velocity_on_path(path: BasePath, s: float) -> Triple:
    """Return the velocity of the base in the world at `s` on a path of unit duration [m]."""
    start, end = vector(path.first.position), vector(path.last.position)
    if path.kind == STRAIGHT:
        return minus(end, start)
    pivot, angle, growth = vector(path.pivot), path.arc_angle, path.radius1 - path.radius0
    a, b = minus(start, pivot), minus(end, pivot)
    f0, f1, g0, g1 = 1.0 - s, s, -1.0, 1.0
    if angle >= 1e-6:
        f0, f1 = np.sin((1.0 - s) * angle) / np.sin(angle), np.sin(s * angle) / np.sin(angle)
        g0 = -angle * np.cos((1.0 - s) * angle) / np.sin(angle)
        g1 = angle * np.cos(s * angle) / np.sin(angle)
    radius = path.radius0 + s * growth
    first = (growth * f0 + radius * g0) / path.radius0
    second = (growth * f1 + radius * g1) / path.radius1
    return (
        first * a[0] + second * b[0],
        first * a[1] + second * b[1],
        first * a[2] + second * b[2],
    )


@kernel
def travel_seen(path: BasePath, base: Pose, s: float, half: float, point: Triple) -> float:
    """Bound the travel of a point at rest in the world, seen from the base, on half an interval.

    Its speed y seen from the base, v being the base's, w its turn and t'' its acceleration, grows
    by y' <= w y + w v + |t''|; so after s it is at most exp(w s) (y0 + (w v + |t''|) s). The
    interval is `s - half` to `s + half` on the path, `base` the base in its middle; the bound [m]
    holds to either end.
    """
    seen, velocity = seen_from(base, point), into(base, velocity_on_path(path, s))
    x, y, z = vector(path.axis)
    w = path.angle
    speed = length(
        (
            w * (y * seen[2] - z * seen[1]) + velocity[0],
            w * (z * seen[0] - x * seen[2]) + velocity[1],
            w * (x * seen[1] - y * seen[0]) + velocity[2],
        )
    )
    bend = 0.0
    if path.kind != STRAIGHT:
        farthest = max(path.radius0, path.radius1)
        bend = path.arc_angle * (2.0 * abs(path.radius1 - path.radius0) + farthest * path.arc_angle)
    growth = w * path.speed + bend
    return float(half * np.exp(w * half) * (speed + 0.5 * growth * half))


@kernel
def turn_seen(path: BasePath, base: Pose, half: float, direction: Triple) -> float:
    """Bound the turn, seen from the base, of a unit vector at rest in the world [rad].

    The bound holds on half an interval of the path, from its middle to either end. The base turns
    about an axis that rests in it, so the rate is the same all along; `base` lies somewhere on it.
    """
    seen, (x, y, z) = into(base, direction), vector(path.axis)
    across = length(
        (y * seen[2] - z * seen[1], z * seen[0] - x * seen[2], x * seen[1] - y * seen[0])
    )
    return half * path.angle * across


@kernel
def position_on_path(path: BasePath, s: float) -> Triple:
    """Return the base position in the world at `s` on a path [m]."""
    start, end = vector(path.first.position), vector(path.last.position)
    if path.kind == STRAIGHT:
        return along(start, s, minus(end, start))
    pivot, angle = vector(path.pivot), path.arc_angle
    radius = path.radius0 + s * (path.radius1 - path.radius0)
    f0, f1 = 1.0 - s, s
    if angle >= 1e-6:
        f0, f1 = np.sin((1.0 - s) * angle) / np.sin(angle), np.sin(s * angle) / np.sin(angle)
    a, b = minus(start, pivot), minus(end, pivot)
    return (
        pivot[0] + radius * (f0 * a[0] / path.radius0 + f1 * b[0] / path.radius1),
        pivot[1] + radius * (f0 * a[1] / path.radius0 + f1 * b[1] / path.radius1),
        pivot[2] + radius * (f0 * a[2] / path.radius0 + f1 * b[2] / path.radius1),
    )


@kernel
def pose_on_path(path: BasePath, s: float, out: Pose) -> None:
    """Compute the base pose in the world at `s` on a path, into `out`."""
    out.position[0], out.position[1], out.position[2] = position_on_path(path, s)
    axis, rotation = vector(path.axis), path.first.rotation
    c, sine = np.cos(s * path.angle), np.sin(s * path.angle)
    for row in range(3):
        # A row of R exp(w) is the row of R turned back.
        here = turn(axis, c, -sine, (rotation[row, 0], rotation[row, 1], rotation[row, 2]))
        out.rotation[row, 0], out.rotation[row, 1], out.rotation[row, 2] = here


@entry
def poses_along(path: BasePath, s: Array, out: Any) -> None:
    """Compute base poses in the world, rows of `Pose`, at path parameters 0 to 1, shape (k,)."""
    for i in range(len(s)):
        pose_on_path(path, s[i], out[i])


def base_path(first: Pose, last: Pose, kind: int, pivot: Array) -> BasePath:
    """Return the base path, `STRAIGHT` or `ARC`, from one base pose in the world to another.

    An arc has the centre `pivot` in the world (3,) [m].
    """
    out: BasePath = BasePath.row()
    x, y, z = map(float, pivot)
    set_path(out, first, last, int(kind), (x, y, z))
    return out


def base_poses(path: BasePath, s: Array) -> tuple[Array, Array]:
    """Return base positions (k, 3) [m] and rotations (k, 3, 3) at path parameters, shape (k,)."""
    out = Pose.rows(len(s))
    poses_along(path, np.ascontiguousarray(s, dtype=np.float64), out)
    return out["position"], out["rotation"]
