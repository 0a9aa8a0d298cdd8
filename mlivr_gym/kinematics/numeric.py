"""Kinematics of arms of six joints without a closed form (compiled).

Any six hinges will do, as long as the flange lies on the last axis. The flange's position and axis
do not depend on joint 6; the other five are found by damped least squares (Levenberg 1944) from
stored postures, the `SEEDS` of `arm.NumericArm`. The wrist point W is the point of axis 6 that is
nearest to axis 5. Frame i is fixed to link i, its z axis is joint i's, and its origin lies on that.

A **branch** is a name of the posture, three signs as those of the closed forms,

    branch = 4 * shoulder + 2 * elbow + wrist

where `shoulder` is 1 if W lies behind axes 1 and 2, `(z1 x z2) . (W - o1) < 0`, `elbow` is 1 if
joint 3 is beyond the angle at which the arm is stretched, and `wrist` is 1 if joint 5 is beyond the
angle at which axes 4 and 6 are nearest to one direction. A general arm may have two solutions with
the same signs, and may pass from one to another without a singularity (Wenger 1992): of these a
branch is the one that is found first, always the same for the same pose. A limb can hold on a path
only if the solution it follows is that of its branch at both ends, see `numeric_path`, and a swept
motion is clear only if each part of it ends where the next begins, see `collisions.sweep`. Paths on
which the name changes are not found.

Both branches of a class count with the smaller `|det J|` of the two.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.bit_sets import CLASSES
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.arm import form_angle
from mlivr_gym.kinematics.numeric_chain import (
    Angles5,
    Chain,
    Column,
    Frame,
    chain_at,
    columns_of,
    determinant,
    divided,
    factors_of,
    next_frame,
    out_of_axes,
    seen_by,
    times,
)
from mlivr_gym.kinematics.poses import along, cross, dot, minus

if TYPE_CHECKING:
    from mlivr_gym.kinematics.arm import Arm, FlangeAxis
    from mlivr_gym.values import Triple

STEPS = 12
"""Largest number of steps of least squares from a seed; 6 are usual."""

ACCURACY = 1e-10
"""Distance of W, and of the flange axis times `NumericArm.unit`, that counts as solved [m]."""

DAMPING, MOST_DAMPING = 0.05, 0.01
"""Damping as a share of the squared distance, and its maximum [m^2]."""

LONGEST_STEP = 0.6
"""Largest change of a joint in one step [rad]."""

FARTHEST = 0.1
"""Largest difference of an angle from that of the form it deviates from [rad]; more is another
solution."""

TRIES = 3
"""Number of seeds of a branch, the nearest ones, from which a pose is solved."""

LEAST = 1e-9
"""Least `|det J|` of a solution [m^3]."""


class Solution(NamedTuple):
    """A solution of a flange pose."""

    there: bool
    """Whether one was found."""
    q: Angles5
    """Its joint angles."""


@kernel
def solved(arm: Arm, wrist: Triple, axis: Triple, start: Angles5) -> Solution:
    """Solve for joints 1 to 5 by wrist point and flange axis, from a start."""
    q, unit, last = start, arm.numeric.unit, np.inf
    for step in range(STEPS):
        chain = chain_at(arm, q)
        (x, y, z), away = minus(axis, chain.z6), minus(wrist, chain.w)
        error = Column(away, (unit * x, unit * y, unit * z))
        square = times(error, error)
        if square < ACCURACY * ACCURACY:
            return Solution(True, q)
        if step == 5 and square > 0.25 * last:
            break
        last = min(last, square)
        columns = columns_of(arm, chain)
        factors = factors_of(columns, min(DAMPING * square, MOST_DAMPING * unit * unit))
        move = divided(factors, seen_by(columns, error))
        most = max(abs(move.q1), abs(move.q2), abs(move.q3), abs(move.q4), abs(move.q5))
        if not most < np.inf:
            break
        share = min(LONGEST_STEP / most, 1.0)
        q = Angles5(
            q.q1 + share * move.q1,
            q.q2 + share * move.q2,
            q.q3 + share * move.q3,
            q.q4 + share * move.q4,
            q.q5 + share * move.q5,
        )
    return Solution(False, q)


@kernel
def name_of(arm: Arm, chain: Chain, q: Angles5) -> int:
    """Return the number of the branch of a posture."""
    ahead = dot(cross(chain.f1.z, chain.f2.z), minus(chain.w, chain.f1.o))
    out = 4 if ahead < 0.0 else 0
    if np.sin(q.q3 - arm.numeric.elbow) < 0.0:
        out += 2
    if np.sin(q.q5 - arm.numeric.bend) < 0.0:
        out += 1
    return out


@kernel
def wrist_of(arm: Arm, flange: FlangeAxis) -> Triple:
    """Return the wrist point of a flange [m]."""
    return along(flange.p, -arm.d6, flange.z)


@kernel
def solution(arm: Arm, flange: FlangeAxis, branch: int) -> Solution:
    """Return the solution of a flange that a branch is."""
    wrist, axis = wrist_of(arm, flange), flange.z
    seeds: Any = arm.numeric.seeds[branch]
    radius = np.sqrt(wrist[0] * wrist[0] + wrist[1] * wrist[1])
    azimuth = np.arctan2(wrist[1], wrist[0])
    c, s = np.cos(azimuth), np.sin(azimuth)
    out, across = c * axis[0] + s * axis[1], c * axis[1] - s * axis[0]
    share, farther = 1.0 / arm.numeric.unit, -1.0
    for _ in range(TRIES):
        nearest, least = -1, np.inf
        for k in range(arm.numeric.seed_counts[branch]):
            seed = seeds[k]
            a, b = share * (seed.radius - radius), share * (seed.height - wrist[2])
            x, y, z = seed.axis[0] - out, seed.axis[1] - across, seed.axis[2] - axis[2]
            square = a * a + b * b + x * x + y * y + z * z
            if farther < square < least:
                nearest, least = k, square
        if nearest < 0:
            break
        farther, q = least, seeds[nearest].q
        found = solved(arm, wrist, axis, Angles5(q[0] + azimuth, q[1], q[2], q[3], q[4]))
        if found.there:
            chain = chain_at(arm, found.q)
            if (
                name_of(arm, chain, found.q) == branch
                and determinant(arm, factors_of(columns_of(arm, chain), 0.0)) > LEAST
            ):
                return found
    return Solution(False, Angles5(0.0, 0.0, 0.0, 0.0, 0.0))


@kernel
def branch_terms(arm: Arm, flange: FlangeAxis, out: Array) -> None:
    """Fill in `(det J)^2`, for each class the smaller one of its branches; the rest is 0."""
    for choice in range(CLASSES):
        out[choice, 0] = out[choice, 1] = out[choice, 2] = 0.0
        least = np.inf
        for branch in range(2 * choice, 2 * choice + 2):
            found = solution(arm, flange, branch)
            if found.there:
                factors = factors_of(columns_of(arm, chain_at(arm, found.q)), 0.0)
                least = min(least, determinant(arm, factors))
        out[choice, 3] = least * least if least < np.inf else -1.0


@kernel
def joint_axes(arm: Arm, flange: FlangeAxis, branch: int, out: Any) -> bool:
    """Find the joint axes of one branch."""
    found = solution(arm, flange, branch)
    if not found.there:
        return False
    f1, f2, f3, f4, f5, _, _ = chain_at(arm, found.q)
    axis, point, wrist = out.axis, out.point, wrist_of(arm, flange)
    for k, frame in enumerate((f1, f2, f3, f4, f5)):
        for c in range(3):
            axis[k, c], point[k, c] = frame.z[c], frame.o[c]
    for c in range(3):
        axis[5, c], point[5, c] = flange.z[c], wrist[c]
    return True


@kernel
def joint_6(arm: Arm, chain: Chain, x: Triple) -> float:
    """Return the angle of joint 6 at which the flange's first axis is `x` [rad]."""
    steps = arm.numeric.steps[5]
    first, second = out_of_axes(chain.f5, steps, 1), out_of_axes(chain.f5, steps, 2)
    angle: float = np.arctan2(dot(x, second), dot(x, first))
    return angle


@kernel
def branch_angles(arm: Arm, flange: FlangeAxis, x: Triple, branch: int, q: Array) -> bool:
    """Compute the joint angles of one branch."""
    found = solution(arm, flange, branch)
    if not found.there:
        return False
    q[0], q[1], q[2], q[3], q[4] = found.q
    q[5] = joint_6(arm, chain_at(arm, found.q), x)
    return True


@kernel
def refined(arm: Arm, flange: FlangeAxis, x: Triple, q: Array) -> bool:
    """Turn joint angles of a form into those of an arm that deviates a little from it.

    Returned is whether there are such angles within `FARTHEST` of the given ones.
    """
    start = Angles5(q[0], q[1], q[2], q[3], q[4])
    found = solved(arm, wrist_of(arm, flange), flange.z, start)
    if not found.there:
        return False
    q[0], q[1], q[2], q[3], q[4] = found.q
    q[5] = joint_6(arm, chain_at(arm, found.q), x)
    same: bool = (
        abs(q[0] - start.q1) < FARTHEST
        and abs(q[1] - start.q2) < FARTHEST
        and abs(q[2] - start.q3) < FARTHEST
        and abs(q[3] - start.q4) < FARTHEST
        and abs(q[4] - start.q5) < FARTHEST
    )
    return same


@kernel
def link_frames(arm: Arm, q: Array, frames: Array) -> None:
    """Compute the frames of the links in the limb base frame."""
    a, b, c = form_angle(arm, q, 0), form_angle(arm, q, 1), form_angle(arm, q, 2)
    last = Angles5(a, b, c, form_angle(arm, q, 3), form_angle(arm, q, 4))
    _set_frames(arm, last, form_angle(arm, q, 5), frames)


@kernel
def branch_frames(arm: Arm, flange: FlangeAxis, branch: int, frames: Array) -> bool:
    """Compute the frames of the links of one branch."""
    found = solution(arm, flange, branch)
    if found.there:
        _set_frames(arm, found.q, 0.0, frames)
    return found.there


@kernel
def _set_frames(arm: Arm, q: Angles5, last: float, frames: Array) -> None:
    """Fill in the frames of the links by their joint angles, `last` that of joint 6."""
    f1, f2, f3, f4, f5, _, _ = chain_at(arm, q)
    base = Frame((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    for link, frame in enumerate((base, f1, f2, f3, f4, f5, next_frame(arm, 6, f5, last))):
        for k in range(3):
            frames[link, 0, k], frames[link, 1, k] = frame.o[k], frame.x[k]
            frames[link, 2, k], frames[link, 3, k] = frame.y[k], frame.z[k]
