"""Compiled distances between the axes of capsules and between an axis and a box, and how they compare with two lengths."""

from __future__ import annotations

import numpy as np

from mlivr_gym.compiled.kernels import kernel

CLEAR, UNDECIDED, SELF, CABIN, HANDRAIL, OBSTACLE = 0, 1, 2, 3, 4, 5
"""Answers of a query: the last four are causes of a collision."""

ROUNDS = 8
"""Places on a capsule's axis that are looked at, besides its ends, before it counts as undecided."""


@kernel
def segments_apart(p, u, q, v):
    """Squared distance [m^2] of the segments from `p` to `p + u` and from `q` to `q + v`, each three numbers [m].

    The closest points of the lines, clamped to each segment in turn (Ericson, Real-Time Collision
    Detection, 5.1.9).
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
def _slope(t, p, d, half):
    """Half the derivative by `t` of the squared distance between a point `p + t d` and a box about the origin."""
    total = 0.0
    for k in range(3):
        x = p[k] + t * d[k]
        if x > half[k]:
            total += (x - half[k]) * d[k]
        elif x < -half[k]:
            total += (x + half[k]) * d[k]
    return total


@kernel
def segment_box_apart(p, d, half):
    """Squared distance [m^2] of the segment from `p` to `p + d` and a box of half edges `half` about the origin.

    The squared distance along the segment is convex, and its derivative linear between the six
    places where the segment crosses a face's plane. Those places narrow the interval in which the
    derivative changes sign; there it is solved exactly.

    Args:
        p: Three numbers [m].
        d: Three numbers [m].
        half: Three numbers [m].
    """
    low, high = 0.0, 1.0
    at_low, at_high = _slope(0.0, p, d, half), _slope(1.0, p, d, half)
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
                        slope = _slope(at, p, d, half)
                        if slope < 0.0:
                            low, at_low = at, slope
                        else:
                            high, at_high = at, slope
        t = low if at_high == at_low else low - at_low * (high - low) / (at_high - at_low)
    total = 0.0
    for k in range(3):
        x = abs(p[k] + t * d[k]) - half[k]
        if x > 0.0:
            total += x * x
    return total


@kernel
def box_from(t, p, d, half):
    """Squared distance [m^2] of `p + t d` from a box of half edges `half` about the origin, and half its derivative by `t`."""
    square = slope = 0.0
    for k in range(3):
        x = p[k] + t * d[k]
        out = x - half[k] if x > half[k] else x + half[k] if x < -half[k] else 0.0
        square += out * out
        slope += out * d[k]
    return square, slope


@kernel
def segment_from(t, p, d, q, v):
    """Squared distance [m^2] of `p + t d` from the segment from `q` to `q + v`, and half its derivative by `t`."""
    x, y, z = p[0] + t * d[0] - q[0], p[1] + t * d[1] - q[1], p[2] + t * d[2] - q[2]
    vv = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    s = min(max((x * v[0] + y * v[1] + z * v[2]) / vv, 0.0), 1.0) if vv > 1e-14 else 0.0
    x, y, z = x - s * v[0], y - s * v[1], z - s * v[2]
    return x * x + y * y + z * z, x * d[0] + y * d[1] + z * d[2]


@kernel
def stays_away(box, shape, along, p, d, at_p, at_d):
    """Whether every point of an axis is at least as far from a shape as a length that changes linearly along it.

    The distance from a convex shape is convex along a line, and so is what it exceeds the length
    by: it lies above its tangents, and where those from both sides meet above zero it is nowhere
    below.

    Args:
        box: Whether the shape is a box about the origin, or else a segment [m].
        shape: Half edges of the box, or one end of the segment.
        along: From there to the other end; of no account for a box.
        p: One end of the axis [m].
        d: From there to the other.
        at_p: The length at `p` [m], above 0.
        at_d: The length at the other end.

    Returns:
        True if it is shown; false also where `ROUNDS` places do not decide.
    """
    a, b, bend = 0.0, 1.0, at_d - at_p
    square, slope = box_from(a, p, d, shape) if box else segment_from(a, p, d, shape, along)
    if square <= at_p * at_p:
        return False
    root = np.sqrt(square)
    low, down = root - at_p, slope / root - bend
    if down >= 0.0:
        return True
    square, slope = box_from(b, p, d, shape) if box else segment_from(b, p, d, shape, along)
    if square <= at_d * at_d:
        return False
    root = np.sqrt(square)
    high, up = root - at_d, slope / root - bend
    if up <= 0.0:
        return True
    for _ in range(ROUNDS):
        t = (low - high + up * b - down * a) / (up - down)
        if low + down * (t - a) >= 0.0:
            return True
        length = at_p + t * bend
        square, slope = box_from(t, p, d, shape) if box else segment_from(t, p, d, shape, along)
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
def segments_answer(p, u, q, v, inner, more, at_p, at_u):
    """Two capsules: `CLEAR`, `UNDECIDED` or `SELF`.

    Args:
        p: One end of the first axis [m].
        u: From there to the other.
        q: One end of the second axis.
        v: From there to the other.
        inner: Radii and clearance [m].
        more: How far the second may move [m].
        at_p: How far the first may move at `p`.
        at_u: How far it may move at the other end; in between linearly.
    """
    square = segments_apart(p, u, q, v)
    if square < inner * inner:
        return SELF
    outer = inner + more + max(at_p, at_u)
    if square >= outer * outer:
        return CLEAR
    # An end that moves far need not be the one that is near.
    if at_p != at_u and stays_away(False, q, v, p, u, inner + more + at_p, inner + more + at_u):
        return CLEAR
    return UNDECIDED


@kernel
def box_answer(p, d, half, inner, at_p, at_d):
    """A capsule and a box about the origin: `CLEAR`, `UNDECIDED` or `SELF`; arguments as in `segments_answer`."""
    if stays_away(True, half, half, p, d, inner + at_p, inner + at_d):
        return CLEAR
    square = segment_box_apart(p, d, half)
    if square < inner * inner:
        return SELF
    outer = inner + max(at_p, at_d)
    return CLEAR if square >= outer * outer else UNDECIDED
