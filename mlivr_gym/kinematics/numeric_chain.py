"""Joints and Jacobian of an arm of six joints without a closed form (compiled).

See `numeric`. The Jacobian here is that of the wrist point and of the flange axis, the latter times
`arm.NumericArm.unit`; both are independent of joint 6.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.poses import along, cross, dot, minus

if TYPE_CHECKING:
    from mlivr_gym.kinematics.arm import Arm
    from mlivr_gym.values import Triple


class Angles5(NamedTuple):
    """Angles of joints 1 to 5 [rad]."""

    q1: float
    q2: float
    q3: float
    q4: float
    q5: float


class Frame(NamedTuple):
    """A frame in the limb base frame."""

    o: Triple
    """Its origin [m]."""
    x: Triple
    """Its axes, as are the next ones."""
    y: Triple
    z: Triple


class Chain(NamedTuple):
    """Frames of the links 1 to 5, the wrist point and the flange axis."""

    f1: Frame
    f2: Frame
    f3: Frame
    f4: Frame
    f5: Frame
    w: Triple
    """Wrist point [m]."""
    z6: Triple
    """Flange axis."""


class Column(NamedTuple):
    """What turning one joint changes, per radian."""

    v: Triple
    """Of the wrist point [m]."""
    a: Triple
    """Of the flange axis, times `NumericArm.unit` [m]."""


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
def next_frame(arm: Arm, link: int, before: Frame, angle: float) -> Frame:
    """Return the frame of a link from that of the link before it."""
    step, c, s = arm.numeric.steps[link - 1], np.cos(angle), np.sin(angle)
    o, x, y, z = before
    px, py, pz = step[0, 0], step[0, 1], step[0, 2]
    at = (
        o[0] + x[0] * px + y[0] * py + z[0] * pz,
        o[1] + x[1] * px + y[1] * py + z[1] * pz,
        o[2] + x[2] * px + y[2] * py + z[2] * pz,
    )
    first, second = out_of_axes(before, step, 1), out_of_axes(before, step, 2)
    return Frame(
        at,
        (
            c * first[0] + s * second[0],
            c * first[1] + s * second[1],
            c * first[2] + s * second[2],
        ),
        (
            c * second[0] - s * first[0],
            c * second[1] - s * first[1],
            c * second[2] - s * first[2],
        ),
        out_of_axes(before, step, 3),
    )


@kernel
def out_of_axes(frame: Frame, step: Array, row: int) -> Triple:
    """Return a direction, a row of an array, in the limb base frame."""
    _, x, y, z = frame
    a, b, c = step[row, 0], step[row, 1], step[row, 2]
    return (
        x[0] * a + y[0] * b + z[0] * c,
        x[1] * a + y[1] * b + z[1] * c,
        x[2] * a + y[2] * b + z[2] * c,
    )


@kernel
def chain_at(arm: Arm, q: Angles5) -> Chain:
    """Return where joints and wrist are."""
    base = Frame((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    f1 = next_frame(arm, 1, base, q.q1)
    f2 = next_frame(arm, 2, f1, q.q2)
    f3 = next_frame(arm, 3, f2, q.q3)
    f4 = next_frame(arm, 4, f3, q.q4)
    f5 = next_frame(arm, 5, f4, q.q5)
    x, y, z = arm.numeric.wrist[0], arm.numeric.wrist[1], arm.numeric.wrist[2]
    w = along(along(along(f5.o, x, f5.x), y, f5.y), z, f5.z)
    return Chain(f1, f2, f3, f4, f5, w, out_of_axes(f5, arm.numeric.steps[5], 3))


@kernel
def _column(frame: Frame, w: Triple, axis: Triple) -> Column:
    """Return the column of a joint; `axis` is the flange axis times the unit."""
    return Column(cross(frame.z, minus(w, frame.o)), cross(frame.z, axis))


@kernel
def columns_of(arm: Arm, chain: Chain) -> Columns:
    """Return the Jacobian of wrist point and flange axis."""
    w, unit, (x, y, z) = chain.w, arm.numeric.unit, chain.z6
    axis = unit * x, unit * y, unit * z
    return Columns(
        _column(chain.f1, w, axis),
        _column(chain.f2, w, axis),
        _column(chain.f3, w, axis),
        _column(chain.f4, w, axis),
        _column(chain.f5, w, axis),
    )


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
def determinant(arm: Arm, factors: Factors) -> float:
    """Return `|det J|` of the six joints by the factors of `J^T J` without damping [m^3].

    The two rows across the flange axis are the turn's, times the unit; joint 6 adds its own.
    """
    square = factors.d1 * factors.d2 * factors.d3 * factors.d4 * factors.d5
    size: float = np.sqrt(max(square, 0.0)) / (arm.numeric.unit * arm.numeric.unit)
    return size
