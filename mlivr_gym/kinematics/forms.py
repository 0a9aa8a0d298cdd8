"""Which solution serves a chain, and what it has to know, from the axes of the joints.

This is NumPy alone: robots are described without a compiler.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array

THREE_PARALLEL, SPHERICAL_WRIST, NUMERIC = 0, 1, 2
"""Kinds of solutions, see the modules `three_parallel`, `spherical_wrist` and `numeric`."""

CLOSE = 1e-3
"""Largest angle [rad] and distance [m] by which axes may miss a closed form that is a start for
least squares; lengths below it are none."""

EXACT = 1e-10
"""The same where the closed form is all."""

PARALLEL = 1e-6
"""Sine of the angle between axes below which they count as parallel."""


class Axes(NamedTuple):
    """Where the joints of a chain are at zero angles, as seen from its mount."""

    z: Array
    """Unit vectors along them, shape (6, 3); the first is the z axis."""
    o: Array
    """A point on each [m], shape (6, 3)."""
    tip: Array
    """Flange, on the last one [m], shape (3,)."""
    x: Array
    """First axis of the flange, shape (3,)."""

    def seen_from_flange(self, flange: Array) -> Axes:
        """Return the joints in opposite order, by the frame of the flange, shape (4, 4)."""
        over = flange[:3, :3] @ np.diag([1.0, -1.0, -1.0])
        seen = (self.o[::-1] - self.tip) @ over
        return Axes(-self.z[::-1] @ over, seen, -self.tip @ over, over[0])

    def foot(self, k: int, other: int) -> Array:
        """Return the point of an axis that is closest to another one [m]."""
        return foot(self.z, self.o, k, other)

    def sine(self, k: int, other: int) -> float:
        """Return the sine of the angle between two axes."""
        return float(np.linalg.norm(np.cross(self.z[k], self.z[other])))

    def cosine(self, k: int, other: int) -> float:
        """Return the size of the cosine of the angle between two axes."""
        return abs(float(self.z[k] @ self.z[other]))

    def gap(self, k: int, other: int) -> float:
        """Return how far two axes pass each other [m], of parallel ones 0."""
        return abs(float((self.o[other] - self.o[k]) @ np.cross(self.z[k], self.z[other])))


class ClosedForm(NamedTuple):
    """A chain in the terms of a closed form."""

    kind: int
    """`THREE_PARALLEL` or `SPHERICAL_WRIST`."""
    off: float
    """By how much its axes miss the form [rad, m]."""
    sign: tuple[float, ...]
    """1, or -1 if a joint of the form turns against that of the arm; joints 1 to 6."""
    zero: tuple[float, ...]
    """Angles of the form at zero angles of the arm [rad]."""
    figures: dict[str, float]
    """Lengths [m], cosines and sines by the fields of `Form`."""


def foot(axes: Array, points: Array, k: int, other: int) -> Array:
    """Return the point of an axis that is closest to another one, of parallel ones its own point.

    Axes are unit vectors and a point on each [m], both of shape (n, 3).
    """
    normal = np.cross(axes[other], np.cross(axes[k], axes[other]))
    across, point = float(axes[k] @ normal), points[k]
    if across > PARALLEL * PARALLEL:
        point = point + float((points[other] - point) @ normal) / across * axes[k]
    return np.asarray(point)


def frames_at(steps: Array, sense: Array, angles: Array) -> Array:
    """Return the frames of mount and links in the mount, shape (..., 7, 4, 4).

    The steps are frames (6, 4, 4), each in the one before, the joint angles have shape (..., 6)
    [rad].
    """
    turned, turns = np.zeros((*angles.shape, 4, 4)), sense * angles
    turned[..., 0, 0] = turned[..., 1, 1] = np.cos(turns)
    turned[..., 1, 0] = np.sin(turns)
    turned[..., 0, 1] = -turned[..., 1, 0]
    turned[..., 2, 2] = turned[..., 3, 3] = 1.0
    frames = np.empty((*angles.shape[:-1], 7, 4, 4))
    frames[..., 0, :, :], frames[..., 1:, :, :] = np.eye(4), steps @ turned
    for k in range(1, 7):
        frames[..., k, :, :] = frames[..., k - 1, :, :] @ frames[..., k, :, :]
    return frames


def closed_form(steps: Array) -> tuple[ClosedForm, bool] | None:
    """Return the closed form of a chain, and whether it is that seen from its flange; or None.

    Steps are the frames of its links, each in that of the link before, shape (6, 4, 4).
    """
    frames = frames_at(steps, np.ones(6), np.zeros(6))
    mine = Axes(frames[1:, :3, 2], frames[1:, :3, 3], frames[6, :3, 3], frames[6, :3, 0])
    tried = (
        (_three_parallel(mine), False),
        (_spherical_wrist(mine), False),
        (_spherical_wrist(mine.seen_from_flange(frames[6])), True),
    )
    for found, from_flange in tried:
        if found is not None and found.off <= CLOSE:
            return found, from_flange
    return None


def _three_parallel(axes: Axes) -> ClosedForm | None:
    """Return a chain as an arm with three parallel axes, None if it has no such lengths."""
    z, o, (up, normal, roll, out) = axes.z, axes.o, axes.z[[0, 1, 4, 5]]
    crossing = ((0, 1), (3, 4), (4, 5))
    off = max(axes.sine(1, 2), axes.sine(1, 3), *(axes.cosine(*pair) for pair in crossing))
    if off > CLOSE:
        return None
    off = max(off, *(axes.gap(*pair) for pair in crossing))
    shoulder, bend, wrist = axes.foot(0, 1), axes.foot(3, 4), axes.foot(4, 5)
    elbow, end = (point + ((shoulder - point) @ normal) * normal for point in o[2:4])
    first = _unit(np.cross(up, normal))
    second = np.cross(normal, first)
    a2, q2 = _signed(elbow - shoulder, first, second, 0.0)
    a3, q23 = _signed(end - elbow, first, second, q2)
    d4 = float((bend - end) @ normal)
    if min(abs(a2), abs(a3), abs(d4)) <= CLOSE:
        return None
    theta = float(np.arctan2(roll @ first, -roll @ second))
    fourth = np.cos(theta) * first + np.sin(theta) * second
    q5 = float(np.arctan2(-out @ fourth, out @ normal))
    fifth = np.cos(q5) * fourth + np.sin(q5) * normal
    q6 = float(np.arctan2(-axes.x @ roll, axes.x @ fifth))
    q1 = float(np.arctan2(normal[0], -normal[1]))
    zero = q1, q2, q23 - q2, theta - q23, q5, q6
    # Axes of joints 3 and 4 may point against that of joint 2.
    sign = (1.0, 1.0, float(np.sign(z[2] @ normal)), float(np.sign(z[3] @ normal)), 1.0, 1.0)
    lengths = {
        "d1": float(shoulder @ up), "a2": a2, "a3": a3, "d4": d4,
        "d5": float((wrist - bend) @ roll), "d6": float((axes.tip - wrist) @ out),
    }  # fmt: skip
    return ClosedForm(THREE_PARALLEL, off, sign, zero, lengths)


def _spherical_wrist(axes: Axes) -> ClosedForm | None:
    """Return a chain as an arm with a spherical wrist, None if it has no such lengths."""
    parallel, (up, second, third, roll, across, out) = axes.sine(1, 2) <= CLOSE, axes.z
    off = max(axes.cosine(2, 3), axes.cosine(3, 4), axes.cosine(4, 5))
    off = max(off, axes.sine(1, 2), axes.cosine(0, 1)) if parallel else off
    if off > CLOSE or axes.sine(0, 1) <= CLOSE:
        return None
    shoulder, wrist = axes.foot(1, 0), axes.foot(4, 5)
    apart = float(np.linalg.norm(wrist - axes.foot(4, 3)))
    off = max(off, axes.gap(3, 4), axes.gap(4, 5), apart, 0.0 if parallel else axes.gap(0, 1))
    sign = float(np.sign(second @ third)) if parallel else 1.0
    lean = sign * third
    elbow = axes.o[2] + ((wrist - axes.o[2]) @ lean) * lean
    arm, fore = elbow - shoulder, wrist - elbow
    along = arm - (arm @ second) * second if parallel else np.cross(second, lean)
    if np.linalg.norm(along) <= CLOSE or np.linalg.norm(fore) <= CLOSE:
        return None
    along, first = _unit(along), _unit(np.cross(up, second))
    rolled = np.cross(along, lean)
    x2, x3 = np.cross(along, second), np.cross(roll, lean)
    q4 = float(np.arctan2(across @ x3, across @ lean))
    x4 = np.cos(q4) * x3 - np.sin(q4) * lean
    q5 = float(np.arctan2(-out @ x4, out @ roll))
    x5, y4 = np.cos(q5) * x4 + np.sin(q5) * roll, -across
    zero = (
        float(np.arctan2(first[1], first[0])),
        float(np.arctan2(x2 @ np.cross(second, first), x2 @ first)),
        float(np.arctan2(x3 @ along, x3 @ rolled)),
        q4,
        q5,
        float(np.arctan2(axes.x @ y4, axes.x @ x5)),
    )
    beside = 0.0 if parallel else float(arm @ rolled)
    a2, a3, d4 = float(arm @ along), float(fore @ x3), float(fore @ roll)
    upper, forearm = float(np.hypot(a2, beside)), float(np.hypot(a3, d4))
    if upper <= CLOSE:
        return None
    fold = float(np.arctan2(beside, a2))
    bend = float(np.arctan2(a3, d4)) - fold
    figures = {
        "d1": float(axes.foot(0, 1) @ up),
        "a1": float((shoulder - axes.foot(0, 1)) @ first) if parallel else 0.0,
        "d2": float(arm @ lean), "a2": a2, "b2": beside, "a3": a3, "d4": d4,
        "d6": float((axes.tip - wrist) @ out),
        "upper": upper, "forearm": forearm, "c_fold": np.cos(fold), "s_fold": np.sin(fold),
        "c_bend": np.cos(bend), "s_bend": np.sin(bend),
        "c_twist": 0.0 if parallel else float(up @ second),
        "s_twist": 1.0 if parallel else axes.sine(0, 1),
        "c_lean": 1.0 if parallel else float(second @ lean),
        "s_lean": 0.0 if parallel else axes.sine(1, 2),
    }  # fmt: skip
    return ClosedForm(SPHERICAL_WRIST, off, (1.0, 1.0, sign, 1.0, 1.0, 1.0), zero, figures)


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def _signed(vector: Array, first: Array, second: Array, before: float) -> tuple[float, float]:
    """Return a link's length and its angle from `first` towards `second`.

    The length is negative where that leaves the joint before it closer to its zero, `before`.
    """
    length = float(np.linalg.norm(vector))
    angle = float(np.arctan2(vector @ second, vector @ first))
    opposite = np.cos(angle - before) < 0.0
    return (-length, angle + np.pi) if opposite else (length, angle)
