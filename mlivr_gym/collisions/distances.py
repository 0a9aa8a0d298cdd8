"""Distances between capsule axes, and between a capsule axis and a box (compiled).

A check compares such a distance with an inner length, the radii plus the clearance, and with an
outer length, which adds how far the shapes may move; see `against_boxes` for the results.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.kinematics.poses import minus

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

CLEAR, UNDECIDED, SELF, CABIN, HANDRAIL, OBSTACLE = 0, 1, 2, 3, 4, 5
"""Results of a comparison. The last four are collisions and name their cause."""

SEGMENT, BOX = (cast(int, k) for k in np.arange(2))
"""Kinds of shape with which a capsule axis is compared."""

MOST_PLACES = 8
"""Maximum number of inner places of an axis that `keeps_distance` evaluates."""


@kernel
def segment_distance_squared(p: Triple, u: Triple, q: Triple, v: Triple) -> float:
    """Return the squared distance between two segments [m^2].

    The segments run from `p` to `p + u` and from `q` to `q + v` [m]. The closest points of their
    lines are clamped to each segment in turn (Ericson, Real-Time Collision Detection, 5.1.9).
    """
    ux, uy, uz = u
    vx, vy, vz = v
    rx, ry, rz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    uv = ux * vx + uy * vy + uz * vz
    ur, vr = ux * rx + uy * ry + uz * rz, vx * rx + vy * ry + vz * rz
    s = t = 0.0
    if uu <= 1e-14:
        if vv > 1e-14:
            t = min(max(vr / vv, 0.0), 1.0)
    elif vv <= 1e-14:
        s = min(max(-ur / uu, 0.0), 1.0)
    else:
        span = uu * vv - uv * uv
        if span > 1e-12 * uu * vv:
            s = min(max((uv * vr - ur * vv) / span, 0.0), 1.0)
        t = (uv * s + vr) / vv
        if t < 0.0:
            t = 0.0
            s = min(max(-ur / uu, 0.0), 1.0)
        elif t > 1.0:
            t = 1.0
            s = min(max((uv - ur) / uu, 0.0), 1.0)
    dx, dy, dz = rx + s * ux - t * vx, ry + s * uy - t * vy, rz + s * uz - t * vz
    return dx * dx + dy * dy + dz * dz


@kernel
def box_distance_on_line(t: float, p: Triple, d: Triple, half: Triple) -> tuple[float, float]:
    """Return the squared distance [m^2] of `p + t d` from a box, and half its derivative by `t`.

    The box is axis-aligned, centred at the origin, and has the half edges `half` [m].
    """
    square = slope = 0.0
    for k in range(3):
        x = p[k] + t * d[k]
        out = x - half[k] if x > half[k] else x + half[k] if x < -half[k] else 0.0
        square += out * out
        slope += out * d[k]
    return square, slope


@kernel
def segment_box_distance_squared(p: Triple, d: Triple, half: Triple) -> float:
    """Return the squared distance between a segment and a box centred at the origin [m^2].

    The segment runs from `p` to `p + d`. Along it the squared distance is convex, and its
    derivative is linear between the six places where the segment crosses the plane of a face. Those
    places narrow the interval in which the derivative changes its sign; there its zero is computed
    exactly.
    """
    low, high = 0.0, 1.0
    at_low, at_high = (
        box_distance_on_line(0.0, p, d, half)[1],
        box_distance_on_line(1.0, p, d, half)[1],
    )
    if at_low >= 0.0:
        t = 0.0
    elif at_high <= 0.0:
        t = 1.0
    else:
        for k in range(3):
            if d[k] != 0.0:
                for side in (-1.0, 1.0):
                    at = (side * half[k] - p[k]) / d[k]
                    if low < at < high:
                        slope = box_distance_on_line(at, p, d, half)[1]
                        if slope < 0.0:
                            low, at_low = at, slope
                        else:
                            high, at_high = at, slope
        t = low if at_high == at_low else low - at_low * (high - low) / (at_high - at_low)
    return box_distance_on_line(t, p, d, half)[0]


@kernel
def segment_distance_on_line(
    t: float, p: Triple, d: Triple, q: Triple, v: Triple
) -> tuple[float, float]:
    """Return the squared distance [m^2] of `p + t d` from a segment, half its derivative by `t`.

    The segment runs from `q` to `q + v` [m].
    """
    x, y, z = p[0] + t * d[0] - q[0], p[1] + t * d[1] - q[1], p[2] + t * d[2] - q[2]
    vv = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    s = min(max((x * v[0] + y * v[1] + z * v[2]) / vv, 0.0), 1.0) if vv > 1e-14 else 0.0
    x, y, z = x - s * v[0], y - s * v[1], z - s * v[2]
    return x * x + y * y + z * z, x * d[0] + y * d[1] + z * d[2]


@kernel
def keeps_distance(
    kind: int, shape: Triple, along: Triple, p: Triple, d: Triple, at_p: float, at_d: float
) -> bool:
    """Return whether an axis from `p` to `p + d` provably keeps a required distance from a shape.

    The shape is a `BOX` centred at the origin, by its half edges, or a `SEGMENT` from `shape` to
    `shape + along` [m]. The required distance varies linearly along the axis, from `at_p`, greater
    than 0, to `at_d` [m]. The distance from a convex shape is convex along a line, and so is its
    excess over the required distance. The excess therefore lies above its tangents: if the tangents
    from both sides intersect above zero, it is positive everywhere between. The answer is False if
    the axis comes closer, or if `MOST_PLACES` places do not decide it.
    """
    a, b, bend = 0.0, 1.0, at_d - at_p
    square, slope = (
        box_distance_on_line(a, p, d, shape)
        if kind == BOX
        else segment_distance_on_line(a, p, d, shape, along)
    )
    if square <= at_p * at_p:
        return False
    root = np.sqrt(square)
    low, down = root - at_p, slope / root - bend
    if down >= 0.0:
        return True
    square, slope = (
        box_distance_on_line(b, p, d, shape)
        if kind == BOX
        else segment_distance_on_line(b, p, d, shape, along)
    )
    if square <= at_d * at_d:
        return False
    root = np.sqrt(square)
    high, up = root - at_d, slope / root - bend
    if up <= 0.0:
        return True
    for _ in range(MOST_PLACES):
        t = (low - high + up * b - down * a) / (up - down)
        if low + down * (t - a) >= 0.0:
            return True
        length = at_p + t * bend
        square, slope = (
            box_distance_on_line(t, p, d, shape)
            if kind == BOX
            else segment_distance_on_line(t, p, d, shape, along)
        )
        if square <= length * length:
            return False
        root = np.sqrt(square)
        grade = slope / root - bend
        if grade < 0.0:
            a, low, down = t, root - length, grade
        elif grade > 0.0:
            b, high, up = t, root - length, grade
        else:
            return True
    return False


@kernel
def has_separating_plane(
    first: tuple[Triple, Triple], second: tuple[Triple, Triple], outer: float
) -> bool:
    """Return whether a plane normal to a coordinate axis separates two segments.

    Their distance from each other is then greater than `outer`. The segments are given by their
    ends [m].
    """
    (p, p_end), (q, q_end) = first, second
    for k in range(3):
        if (
            min(p[k], p_end[k]) - max(q[k], q_end[k]) > outer
            or min(q[k], q_end[k]) - max(p[k], p_end[k]) > outer
        ):
            return True
    return False


@kernel
def compare_capsules(
    first: tuple[Triple, Triple],
    second: tuple[Triple, Triple],
    inner: float,
    more: float,
    moves: tuple[float, float],
) -> int:
    """Compare two capsules given by both ends of their axes [m].

    `inner` is the sum of the radii and the clearance; the second capsule may move by `more`, the
    first by `moves` at either end, linear in between [m]. The result is `CLEAR`, `UNDECIDED` or
    `SELF`.
    """
    (p, p_end), (q, q_end), (at_p, at_end) = first, second, moves
    outer = inner + more + max(at_p, at_end)
    if has_separating_plane(first, second, outer):
        return CLEAR
    u, v = minus(p_end, p), minus(q_end, q)
    square = segment_distance_squared(p, u, q, v)
    if square < inner * inner:
        return SELF
    if square >= outer * outer:
        return CLEAR
    # The end that moves farther need not be the one closer to the other axis.
    if at_p != at_end and keeps_distance(
        SEGMENT, q, v, p, u, inner + more + at_p, inner + more + at_end
    ):
        return CLEAR
    return UNDECIDED


@kernel
def compare_capsule_with_box(
    p: Triple, d: Triple, half: Triple, inner: float, moves: tuple[float, float]
) -> int:
    """Compare a capsule with a box centred at the origin: `CLEAR`, `UNDECIDED` or `SELF`.

    Its axis runs from `p` to `p + d` [m]; for the rest see `compare_capsules`.
    """
    at_p, at_d = moves
    if keeps_distance(BOX, half, half, p, d, inner + at_p, inner + at_d):
        return CLEAR
    square = segment_box_distance_squared(p, d, half)
    if square < inner * inner:
        return SELF
    outer = inner + max(at_p, at_d)
    return CLEAR if square >= outer * outer else UNDECIDED


@entry
def segments_distance(p: Triple, u: Triple, q: Triple, v: Triple) -> float:
    """Return the distance between two segments [m], see `segment_distance_squared`."""
    distance: float = np.sqrt(segment_distance_squared(p, u, q, v))
    return distance


@entry
def segment_box_distance(p: Triple, d: Triple, half: Triple) -> float:
    """Return the distance between a segment and a box centred at the origin [m].

    See `segment_box_distance_squared`.
    """
    distance: float = np.sqrt(segment_box_distance_squared(p, d, half))
    return distance
