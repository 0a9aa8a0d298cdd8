"""Least squares of five unknowns and six equations (compiled)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.poses import cross, dot, minus

if TYPE_CHECKING:
    from mlivr_gym.values import Triple


class Angles5(NamedTuple):
    """Angles of joints 1 to 5 [rad]."""

    q1: float
    q2: float
    q3: float
    q4: float
    q5: float


class Column(NamedTuple):
    """What turning one joint changes, per radian."""

    v: Triple
    """Of the wrist point [m]."""
    a: Triple
    """Of the flange axis, times a length [m]."""


class Columns(NamedTuple):
    """The Jacobian of wrist point and flange axis."""

    c1: Column
    c2: Column
    c3: Column
    c4: Column
    c5: Column


class Factors(NamedTuple):
    """Factors L and D of a symmetric matrix `L D L^T` of five rows."""

    d1: float
    d2: float
    d3: float
    d4: float
    d5: float
    l21: float
    l31: float
    l32: float
    l41: float
    l42: float
    l43: float
    l51: float
    l52: float
    l53: float
    l54: float


@kernel
def column_of(origin: Triple, z: Triple, w: Triple, axis: Triple) -> Column:
    """Return the column of a joint, by a point on it and its axis."""
    return Column(cross(z, minus(w, origin)), cross(z, axis))


@kernel
def times(one: Column, other: Column) -> float:
    """Return the scalar product of two columns."""
    return dot(one.v, other.v) + dot(one.a, other.a)


@kernel
def factors_of(columns: Columns, damping: float) -> Factors:
    """Return the factors of `J^T J` plus the damping on its diagonal [m^2]."""
    c1, c2, c3, c4, c5 = columns
    d1 = times(c1, c1) + damping
    g21, g31, g41, g51 = times(c2, c1), times(c3, c1), times(c4, c1), times(c5, c1)
    l21, l31, l41, l51 = g21 / d1, g31 / d1, g41 / d1, g51 / d1
    d2 = times(c2, c2) + damping - l21 * g21
    g32, g42 = times(c3, c2) - l31 * g21, times(c4, c2) - l41 * g21
    g52 = times(c5, c2) - l51 * g21
    l32, l42, l52 = g32 / d2, g42 / d2, g52 / d2
    d3 = times(c3, c3) + damping - l31 * g31 - l32 * g32
    g43 = times(c4, c3) - l41 * g31 - l42 * g32
    g53 = times(c5, c3) - l51 * g31 - l52 * g32
    l43, l53 = g43 / d3, g53 / d3
    d4 = times(c4, c4) + damping - l41 * g41 - l42 * g42 - l43 * g43
    g54 = times(c5, c4) - l51 * g41 - l52 * g42 - l53 * g43
    l54 = g54 / d4
    d5 = times(c5, c5) + damping - l51 * g51 - l52 * g52 - l53 * g53 - l54 * g54
    return Factors(d1, d2, d3, d4, d5, l21, l31, l32, l41, l42, l43, l51, l52, l53, l54)


@kernel
def divided(f: Factors, right: Angles5) -> Angles5:
    """Return the solution of the equations whose matrix has the factors, by their right side."""
    y1 = right.q1
    y2 = right.q2 - f.l21 * y1
    y3 = right.q3 - f.l31 * y1 - f.l32 * y2
    y4 = right.q4 - f.l41 * y1 - f.l42 * y2 - f.l43 * y3
    y5 = right.q5 - f.l51 * y1 - f.l52 * y2 - f.l53 * y3 - f.l54 * y4
    x5 = y5 / f.d5
    x4 = y4 / f.d4 - f.l54 * x5
    x3 = y3 / f.d3 - f.l43 * x4 - f.l53 * x5
    x2 = y2 / f.d2 - f.l32 * x3 - f.l42 * x4 - f.l52 * x5
    x1 = y1 / f.d1 - f.l21 * x2 - f.l31 * x3 - f.l41 * x4 - f.l51 * x5
    return Angles5(x1, x2, x3, x4, x5)


@kernel
def seen_by(columns: Columns, change: Column) -> Angles5:
    """Return the products of all columns with one."""
    c1, c2, c3, c4, c5 = columns
    return Angles5(
        times(c1, change),
        times(c2, change),
        times(c3, change),
        times(c4, change),
        times(c5, change),
    )


@kernel
def root_determinant(factors: Factors) -> float:
    """Return the root of the determinant of a matrix by its factors."""
    square = factors.d1 * factors.d2 * factors.d3 * factors.d4 * factors.d5
    root: float = np.sqrt(max(square, 0.0))
    return root
