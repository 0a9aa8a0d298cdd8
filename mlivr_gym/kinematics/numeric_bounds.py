"""How the joints and links of an arm without a closed form move at most, proved (compiled).

For the arm see `numeric`. Let `F` be wrist point and flange axis, the latter times the unit, as a
function of joints 1 to 5, `J` its Jacobian, and `K = (J^T J)^-1 J^T` in the middle of an interval.
Between the middle and an end let the wrist point travel at most `d` and the flange axis turn at
most `a`; then `K F'` amounts to `b_i = |K_i| (d, unit a)` at most, by the two parts of row i, or to
a larger `b_i` that is chosen so that none is much smaller than the largest. As long as joint i is
within `r_i = 1.5 b_i` of the middle,

    |(K (J(q) - J))_mi| <= sum_k |K h_ik|_m r_k + |K_m| sum_jk t_ijk r_j r_k / 2

with the second derivatives `h` in the middle and bounds `t` of the third ones. Let `e` be the norm
of this matrix that belongs to the largest of `|q_i| / b_i`, the largest of its rows times `b` over
`b_m`. If `e <= 1/3`, then `q' = (1 + K (J(q) - J))^-1 K F'` gives that joint i turns at most `b_i /
(1 - e) <= r_i`, so that it stays within that (Kantorovich 1948). Within it there is one solution of
each pose, none is singular, and `|det J(q)| >= (1 - e)^5 |det J|`.

The second derivative by joints `i <= k` is `z_i x c_k` for both parts of column k; the third ones
nest likewise, and are no longer than the column of the last joint can be.

Joint 6 turns at most as the flange and all other joints together. Links turn at most by the sum of
the joints between.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.numeric_chain import (
    Angles5,
    Column,
    Columns,
    Factors,
    chain_at,
    columns_of,
    determinant,
    divided,
    factors_of,
    seen_by,
)
from mlivr_gym.kinematics.poses import along, cross, length
from mlivr_gym.kinematics.turns import FlangeMotion, GraspMotion, Turns

if TYPE_CHECKING:
    from mlivr_gym.compiled.records import Joints
    from mlivr_gym.kinematics.arm import Arm
    from mlivr_gym.values import Triple

WIDER = 1.5
"""How much farther joints are let turn than without a change of the Jacobian."""

LEAST_SHARE = 0.2
"""Least share of the largest `b` that any other one has."""


class Nearby(NamedTuple):
    """What is proved of an interval."""

    proved: bool
    """Whether there is one solution of each pose."""
    turns: Angles5
    """How far joints turn at most [rad]."""
    least: float
    """Least `|det J|` [m^3]."""
    middle: float
    """`|det J|` in the middle [m^3]."""


@kernel
def _row(columns: Columns, share: Angles5) -> Column:
    """Return a row of K by a row of `(J^T J)^-1`."""
    v = a = (0.0, 0.0, 0.0)
    for k in range(5):
        v, a = along(v, share[k], columns[k].v), along(a, share[k], columns[k].a)
    return Column(v, a)


@kernel
def _sizes(columns: Columns, factors: Factors, unit: Angles5) -> tuple[float, float]:
    """Return the lengths of both parts of a row of K, by its unit vector."""
    row = _row(columns, divided(factors, unit))
    return length(row.v), length(row.a)


@kernel
def _bent(
    total: Angles5,
    columns: Columns,
    factors: Factors,
    derivative: tuple[Triple, Column],
    weight: float,
) -> Angles5:
    """Add a weight times K times a second derivative, without signs.

    It is given by the axis of the first joint and the column of the last one.
    """
    axis, column = derivative
    change = Column(cross(axis, column.v), cross(axis, column.a))
    q1, q2, q3, q4, q5 = divided(factors, seen_by(columns, change))
    return Angles5(
        total.q1 + weight * abs(q1),
        total.q2 + weight * abs(q2),
        total.q3 + weight * abs(q3),
        total.q4 + weight * abs(q4),
        total.q5 + weight * abs(q5),
    )


@kernel
def _third(arm: Arm, b: Angles5) -> float:
    """Return the sum of the bounds of the third derivatives, times the `b` of their joints."""
    out = before = 0.0
    for joint in range(5):
        after = before + b[joint]
        out += arm.numeric.farthest[joint] * (after**3 - before**3)
        before = after
    return out


@kernel
def nearby(arm: Arm, q: Angles5, d: float, a: float) -> Nearby:
    """Bound how far joints turn by travel [m] and turn [rad] of the flange from a posture."""
    chain = chain_at(arm, q)
    columns = columns_of(arm, chain)
    factors = factors_of(columns, 0.0)
    middle, turned = determinant(arm, factors), a * arm.numeric.unit
    none = Angles5(0.0, 0.0, 0.0, 0.0, 0.0)
    if not middle > 0.0:
        return Nearby(False, none, 0.0, middle)
    (v1, a1), (v2, a2), (v3, a3), (v4, a4), (v5, a5) = sizes = (
        _sizes(columns, factors, Angles5(1.0, 0.0, 0.0, 0.0, 0.0)),
        _sizes(columns, factors, Angles5(0.0, 1.0, 0.0, 0.0, 0.0)),
        _sizes(columns, factors, Angles5(0.0, 0.0, 1.0, 0.0, 0.0)),
        _sizes(columns, factors, Angles5(0.0, 0.0, 0.0, 1.0, 0.0)),
        _sizes(columns, factors, Angles5(0.0, 0.0, 0.0, 0.0, 1.0)),
    )
    b1, b2, b3 = v1 * d + a1 * turned, v2 * d + a2 * turned, v3 * d + a3 * turned
    b4, b5 = v4 * d + a4 * turned, v5 * d + a5 * turned
    least = LEAST_SHARE * max(b1, b2, b3, b4, b5)
    b = Angles5(max(b1, least), max(b2, least), max(b3, least), max(b4, least), max(b5, least))
    axes, total = (chain.f1.z, chain.f2.z, chain.f3.z, chain.f4.z, chain.f5.z), none
    for i in range(5):
        for k in range(i, 5):
            weight = (1.0 if i == k else 2.0) * b[i] * b[k]
            total = _bent(total, columns, factors, (axes[i], columns[k]), weight)
    third, change = 0.5 * WIDER * _third(arm, b), 0.0
    for k in range(5):
        change = max(change, (total[k] + np.hypot(sizes[k][0], sizes[k][1]) * third) / b[k])
    change *= WIDER
    if not change <= 1.0 - 1.0 / WIDER:
        return Nearby(False, none, 0.0, middle)
    kept = 1.0 - change
    turns = Angles5(b.q1 / kept, b.q2 / kept, b.q3 / kept, b.q4 / kept, b.q5 / kept)
    return Nearby(True, turns, middle * kept**5, middle)


@kernel
def held_turns(arm: Arm, q: Joints, flange: FlangeMotion, turns: Turns) -> bool:
    """Bound how far joints turn on their path from the middle of an interval to its ends."""
    proof = nearby(arm, Angles5(q[0], q[1], q[2], q[3], q[4]), flange.travel, flange.axis)
    q1, q2, q3, q4, q5 = proof.turns
    turns.q1, turns.q2, turns.q3, turns.q4, turns.q5 = q1, q2, q3, q4, q5
    turns.q23, turns.q34, turns.q234 = q2 + q3, q3 + q4, q2 + q3 + q4
    turns.q6 = flange.turn + q1 + q2 + q3 + q4 + q5
    return bool(proof.proved and turns.q6 < np.pi)


@kernel
def link_motion(arm: Arm, turns: Turns, shift: Array, spin: Array) -> None:
    """Bound how far links turn and anchors move, seen from the links 0 to 4.

    Anchors are the origins of the links 2, 3 and 4, and the wrist point.
    """
    between = arm.numeric.between
    for row in range(5):
        total = 0.0
        for link, angle in enumerate(
            (0.0, turns.q1, turns.q2, turns.q3, turns.q4, turns.q5, turns.q6)
        ):
            if link > row:
                total += angle
            spin[row, link] = total
        shift[row, 0] = between[0] * spin[row, 1]
        shift[row, 1] = shift[row, 0] + between[1] * spin[row, 2]
        shift[row, 2] = shift[row, 1] + between[2] * spin[row, 3]
        shift[row, 3] = shift[row, 2] + between[3] * spin[row, 4] + between[4] * spin[row, 5]


@kernel
def grasp_motion(arm: Arm, turns: Turns) -> GraspMotion:
    """Bound how far the links of a limb that holds move in the world, followed from its grasp."""
    between, wrist_2 = arm.numeric.between, turns.q6
    wrist_1 = wrist_2 + turns.q5
    fore = wrist_1 + turns.q4
    end = between[4] * wrist_2 + between[3] * wrist_1
    return GraspMotion(wrist_2, wrist_1, fore, fore + turns.q3, end, end + between[2] * fore)
