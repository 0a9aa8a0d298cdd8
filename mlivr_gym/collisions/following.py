"""Proof that a limb that holds follows a base that moves on a straight way (compiled).

Seen from the body the grasp moves, and the joints of the limb must move with it. Let `J` be the
Jacobian of the limb in the middle of an interval, its columns the twists `xi_j` of the joints, and
`V` the twist of the grasp there, both seen from the body. The joints have the rates `x = J^-1 V`
there; elsewhere `J` has become `J + E` and `V` has become `V + v`, and the rates are `x + d`:

    d = J^-1 (v - E x) - J^-1 E d.

While all rates are within `e` of `x`, joint by joint, the joints are within `c = h (|x| + e)` of
the middle, `h` being half the length of the interval; then E is bounded, and so is the right side,
by some `e'`. If `e' < e` for every joint, the rates cannot leave these bounds on the interval:
`J^-1 E` is a contraction in the norm that weights joints by `1 / e`, so `J + E` is regular, and the
solution of the middle goes on. It exists on the whole interval, the limb stays regular, and joint j
turns by at most `c_j` to either end. Every chain of joints is treated alike.

**The change of the Jacobian.** The twist of joint j is carried along by the joints before it. To
first order joint k changes it by the Lie bracket `[xi_k, xi_j]`, so `E x` by
`x_k x_j [xi_k, xi_j]`; those of all pairs partly cancel. What is left is bounded by second
derivatives, see `_set_needed`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.compiled.records import Joints, Record
from mlivr_gym.kinematics.manipulability import Matrix6
from mlivr_gym.kinematics.poses import cross, length, minus, vector

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

MOST_TURN = 0.19
"""Sum of the turns of all joints above which no proof is tried [rad]: few succeed."""

LARGEST_CHANGE = 0.8
"""Change of a turn above which a proof is given up [rad]."""

TRIES = 5
"""Number of bounds of the changes of the rates that are tried."""

SLACK, LEAST_RATE = 1.3, 1e-6
"""Factor by which tried changes exceed those found so far, and what is added to each [rad]."""


class JointAxesSeen(Record):
    """Where the joints of a limb are, seen from the body."""

    axis: Annotated[Array, (6, 3)]
    """Unit vectors along them."""
    point: Annotated[Array, (6, 3)]
    """A point on each [m]."""


class Following(Record):
    """Scratch of the proof for one limb."""

    inverse: Matrix6
    """Inverse of the Jacobian: three columns for velocities of the point on the first axis, three
    for turns."""
    reduced: Matrix6
    """The Jacobian while it is inverted."""
    effect: Annotated[Array, (6, 6, 6)]
    """`J^-1 [xi_k, xi_j]`, by k, j and joint."""
    sine: Matrix6
    """Sine of the angle between the axes k and j."""
    distance: Matrix6
    """Distance of the point on axis j from axis k [m]."""
    reach: Joints
    """Distance of the point on each axis from that on the first one [m]."""
    linear: Joints
    """Length of the first three columns of each row of the inverse."""
    angular: Joints
    """Length of the last three."""
    rate: Joints
    """Rates in the middle, over the whole way [rad]."""
    drift: Joints
    """Bounds of what changes them to first order on the interval [rad]."""
    tried: Joints
    """Changes of the rates that are tried [rad]."""
    needed: Joints
    """Bounds of the changes while they are within those that are tried [rad]."""


@kernel
def invert_jacobian(joints: JointAxesSeen, scratch: Following) -> float:
    """Invert the Jacobian of a limb into `scratch`; return `|det J|` [m^3]."""
    rows, inverse, origin = scratch.reduced, scratch.inverse, vector(joints.point[0])
    for j in range(6):
        axis = vector(joints.axis[j])
        velocity = cross(minus(vector(joints.point[j]), origin), axis)
        for k in range(3):
            rows[k, j], rows[3 + k, j] = velocity[k], axis[k]
        for row in range(6):
            inverse[row, j] = 1.0 * (row == j)
    product = 1.0
    for j in range(6):
        pivot = j
        for row in range(j + 1, 6):
            if abs(rows[row, j]) > abs(rows[pivot, j]):
                pivot = row
        largest = rows[pivot, j]
        if largest == 0.0:
            return 0.0
        product *= abs(largest)
        for c in range(6):
            one, other = rows[pivot, c] / largest, inverse[pivot, c] / largest
            rows[pivot, c], inverse[pivot, c] = rows[j, c], inverse[j, c]
            rows[j, c], inverse[j, c] = one, other
        for row in range(6):
            factor = rows[row, j]
            if row != j and factor != 0.0:
                for c in range(6):
                    rows[row, c] -= factor * rows[j, c]
                    inverse[row, c] -= factor * inverse[j, c]
    return product


@kernel
def bound_changes(
    half: float,
    shift: Triple,
    turn: Triple,
    joints: JointAxesSeen,
    scratch: Following,
    change: Joints,
) -> bool:
    """Bound how far the joints of a limb that holds turn from the middle of an interval.

    Its inverse Jacobian is in `scratch`, see `invert_jacobian`. Over the whole way, 0 to 1, the
    base is shifted by `shift` [m] and turned by `turn` [rad], both in the axes of the body in the
    middle; `half` is half the length of the interval. Returned is whether it is proved that a
    solution follows the base on the whole interval; then `change` is filled [rad].
    """
    inverse, rate, drift, tried = scratch.inverse, scratch.rate, scratch.drift, scratch.tried
    # A point that rests, at the origin of the twists, seen from the body.
    seen, sum_of_turns = cross(turn, vector(joints.point[0])), 0.0
    for i in range(6):
        rate[i], linear, angular = 0.0, 0.0, 0.0
        for k in range(3):
            a, b = inverse[i, k], inverse[i, 3 + k]
            rate[i] -= a * (seen[k] + shift[k]) + b * turn[k]
            linear += a * a
            angular += b * b
        scratch.linear[i], scratch.angular[i] = np.sqrt(linear), np.sqrt(angular)
        sum_of_turns += half * abs(rate[i])
    if sum_of_turns > MOST_TURN:
        return False
    _set_effects(joints, scratch)
    # The turn rests in the body, the shift in the world: only this makes the twist change.
    varies = cross(turn, shift)
    more = 0.5 * half * half * length(turn) * length(varies)
    for i in range(6):
        value = inverse[i, 0] * varies[0] + inverse[i, 1] * varies[1] + inverse[i, 2] * varies[2]
        for j in range(1, 6):
            for k in range(j):
                value -= rate[k] * rate[j] * scratch.effect[k, j, i]
        drift[i] = half * abs(value) + more * scratch.linear[i] + LEAST_RATE
        tried[i] = SLACK * drift[i]
    for _ in range(TRIES):
        _set_needed(half, scratch)
        proved, largest = True, 0.0
        for i in range(6):
            proved = proved and scratch.needed[i] <= tried[i]
            change[i] = half * (abs(rate[i]) + tried[i])
            tried[i] = max(tried[i], SLACK * scratch.needed[i])
            largest = max(largest, half * tried[i])
        if proved or largest > LARGEST_CHANGE:
            return proved
    return False


@part
def _set_effects(joints: JointAxesSeen, scratch: Following) -> None:
    """Set what each joint does to the rates by carrying the axes of those behind it."""
    inverse, origin = scratch.inverse, vector(joints.point[0])
    for j in range(1, 6):
        z, o = vector(joints.axis[j]), vector(joints.point[j])
        arm = minus(o, origin)
        scratch.reach[j], v = length(arm), cross(arm, z)
        for k in range(j):
            z_k, o_k = vector(joints.axis[k]), vector(joints.point[k])
            turned = cross(z_k, z)
            first, second = cross(z_k, v), cross(cross(minus(o_k, origin), z_k), z)
            scratch.sine[k, j] = length(turned)
            scratch.distance[k, j] = length(cross(z_k, minus(o, o_k)))
            for i in range(6):
                value = 0.0
                for c in range(3):
                    value += inverse[i, c] * (first[c] + second[c]) + inverse[i, 3 + c] * turned[c]
                scratch.effect[k, j, i] = value


@part
def _set_needed(half: float, scratch: Following) -> None:
    """Bound how far the rates change while they change by no more than what is tried.

    The second derivative of what joints k and l, the later, carry is the turn about both axes in
    order, so it is no larger than the turn about axis l: a sine for the direction of axis j, a
    distance for the point on it, both with what the joints between l and j add. The moment of the
    axis about the first one changes with both, and by the product of both changes.
    """
    rate, tried, needed = scratch.rate, scratch.tried, scratch.needed
    for i in range(6):
        needed[i] = scratch.drift[i]
    for j in range(1, 6):
        turns, moves, leans, moved, turned = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(j):
            turns += half * (abs(rate[k]) + tried[k])
        for back in range(j):
            k = j - 1 - back
            c = half * (abs(rate[k]) + tried[k])
            turns -= c  # those of the joints before k are left
            moved += (scratch.distance[k, j] + moves) * c * (turns + 0.5 * c)
            turned += (scratch.sine[k, j] + leans) * c * (turns + 0.5 * c)
            moves += c * scratch.distance[k, j]
            leans += c * scratch.sine[k, j]
            share = half * tried[k] * abs(rate[j]) + c * tried[j]
            for i in range(6):
                needed[i] += share * abs(scratch.effect[k, j, i])
        moved += scratch.reach[j] * turned + moves * leans
        most = abs(rate[j]) + tried[j]
        for i in range(6):
            needed[i] += most * (scratch.linear[i] * moved + scratch.angular[i] * turned)
