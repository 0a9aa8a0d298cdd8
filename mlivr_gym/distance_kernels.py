"""Compiled distances between the axes of capsules and between an axis and a box, and how they compare with two lengths."""

from __future__ import annotations

from mlivr_gym.compiled import kernel

CLEAR, UNDECIDED, SELF, CABIN, HANDRAIL, OBSTACLE = 0, 1, 2, 3, 4, 5
"""Answers of a query: the last four are causes of a collision."""

PARTS = 4
"""Parts of a capsule that are compared one by one where the whole is undecided."""


@kernel
def segments_apart(p, u, q, v):
    """Squared distance [m^2] of the segments from `p` to `p + u` and from `q` to `q + v`, each three numbers [m].

    The closest points of the lines, clamped to each segment in turn (Ericson, Real-Time Collision Detection, 5.1.9).
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

    The squared distance along the segment is convex, and its derivative linear between the six places where the segment
    crosses a face's plane. Those places narrow the interval in which the derivative changes sign; there it is
    solved exactly.

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
    if at_p == at_u:
        return UNDECIDED
    # An end that moves far need not be the one that is near.
    part = 1.0 / PARTS
    short = u[0] * part, u[1] * part, u[2] * part
    for k in range(PARTS):
        a, b = k * part, (k + 1) * part
        outer = inner + more + max(at_p + a * (at_u - at_p), at_p + b * (at_u - at_p))
        if segments_apart((p[0] + a * u[0], p[1] + a * u[1], p[2] + a * u[2]), short, q, v) < outer * outer:
            return UNDECIDED
    return CLEAR


@kernel
def box_answer(p, d, half, inner, at_p, at_d):
    """A capsule and a box about the origin: `CLEAR`, `UNDECIDED` or `SELF`; arguments as in `segments_answer`."""
    square = segment_box_apart(p, d, half)
    if square < inner * inner:
        return SELF
    outer = inner + max(at_p, at_d)
    if square >= outer * outer:
        return CLEAR
    if at_p == at_d:
        return UNDECIDED
    part = 1.0 / PARTS
    short = d[0] * part, d[1] * part, d[2] * part
    for k in range(PARTS):
        a, b = k * part, (k + 1) * part
        outer = inner + max(at_p + a * (at_d - at_p), at_p + b * (at_d - at_p))
        if segment_box_apart((p[0] + a * d[0], p[1] + a * d[1], p[2] + a * d[2]), short, half) < outer * outer:
            return UNDECIDED
    return CLEAR
