"""Kinematics of arms of six joints without a closed form (compiled).

Any six hinges will do, as long as the flange lies on the last axis. The flange's position and axis
do not depend on joint 6; the other five are found by damped least squares (Levenberg 1944) from
stored postures, the seeds. The wrist point W is the point of axis 6 that is closest to axis 5.

A **branch** is a name of the posture, three signs as those of the closed forms,

    branch = 4 * shoulder + 2 * elbow + wrist

where `shoulder` is 1 if W lies behind axes 1 and 2, `(z1 x z2) . (W - o1) < 0`, `elbow` is 1 if
joint 3 is beyond the angle at which the arm is stretched, and `wrist` is 1 if joint 5 is beyond the
angle at which axes 4 and 6 are closest to one direction. A general arm may have two solutions with
the same signs, and may pass from one to another without a singularity (Wenger 1992): of these a
branch is the one that is found first, always the same for the same pose.

Both branches of a class count with the smaller `|det J|` of the two.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.bit_sets import CLASSES
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.chain import (
    Bend,
    Chain,
    Links,
    bend_of_turns,
    links_at,
    out_of_axes,
)
from mlivr_gym.kinematics.least_squares import (
    Angles5,
    Column,
    Columns,
    column_of,
    divided,
    factors_of,
    root_determinant,
    seen_by,
    times,
)
from mlivr_gym.kinematics.poses import along, cross, dot, minus, vector

if TYPE_CHECKING:
    from mlivr_gym.kinematics.chain import FlangeAxis
    from mlivr_gym.values import Triple

STEPS = 12
"""Largest number of steps of least squares from a seed; 6 are usual."""

ACCURACY = 1e-10
"""Distance of W, and of the flange axis times `Form.unit`, that counts as solved [m]."""

DAMPING, MOST_DAMPING = 0.05, 0.01
"""Damping as a share of the squared distance, and its maximum [m^2]."""

LONGEST_STEP = 0.6
"""Largest change of a joint in one step [rad]."""

FARTHEST = 0.1
"""Largest difference of an angle from that of the form it deviates from [rad]; more is another
solution."""

TRIES = 3
"""Number of seeds of a branch, the closest ones, from which a pose is solved."""

LEAST = 1e-9
"""Least `|det J|` of a solution [m^3]."""


@kernel
def wrist_and_axis(arm: Chain, links: Links) -> tuple[Triple, Triple]:
    """Return the wrist point [m] and the flange axis."""
    wrist = along(links.f5.o, 1.0, out_of_axes(links.f5, vector(arm.form.wrist)))
    return wrist, out_of_axes(links.f5, vector(arm.steps[5, 3]))


@kernel
def columns_of(arm: Chain, links: Links) -> Columns:
    """Return the Jacobian of the wrist point and of the flange axis times the unit."""
    (w, (x, y, z)), unit = wrist_and_axis(arm, links), arm.form.unit
    axis = unit * x, unit * y, unit * z
    f1, f2, f3, f4, f5 = links
    return Columns(
        column_of(f1.o, f1.z, w, axis),
        column_of(f2.o, f2.z, w, axis),
        column_of(f3.o, f3.z, w, axis),
        column_of(f4.o, f4.z, w, axis),
        column_of(f5.o, f5.z, w, axis),
    )


@kernel
def size_of(arm: Chain, links: Links) -> float:
    """Return `|det J|` of the six joints [m^3].

    The two rows across the flange axis are the turn's, times the unit; joint 6 adds its own.
    """
    size: float = root_determinant(factors_of(columns_of(arm, links), 0.0))
    return size / (arm.form.unit * arm.form.unit)


@kernel
def solved(arm: Chain, flange: FlangeAxis, start: Angles5) -> tuple[bool, Angles5]:
    """Return whether a start leads to a flange position and axis, and joints 1 to 5 there."""
    q, unit, last = start, arm.form.unit, np.inf
    wrist, axis = along(flange.p, -arm.form.past_wrist, flange.z), flange.z
    for step in range(STEPS):
        links = links_at(arm, bend_of_turns(*q))
        at, along_axis = wrist_and_axis(arm, links)
        (x, y, z), away = minus(axis, along_axis), minus(wrist, at)
        error = Column(away, (unit * x, unit * y, unit * z))
        square = times(error, error)
        if square < ACCURACY * ACCURACY:
            return True, q
        if step == 5 and square > 0.25 * last:
            break
        last = min(last, square)
        columns = columns_of(arm, links)
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
    return False, q


@kernel
def name_of(arm: Chain, links: Links, q: Angles5) -> int:
    """Return the number of the branch of a posture."""
    wrist, _ = wrist_and_axis(arm, links)
    ahead = dot(cross(links.f1.z, links.f2.z), minus(wrist, links.f1.o))
    out = 4 if ahead < 0.0 else 0
    if math.sin(q.q3 - arm.form.elbow) < 0.0:
        out += 2
    if math.sin(q.q5 - arm.form.bend) < 0.0:
        out += 1
    return out


@kernel
def solution(arm: Chain, flange: FlangeAxis, branch: int) -> tuple[bool, Bend]:
    """Return whether a branch reaches a flange, and how far joints 1 to 5 are turned there."""
    wrist, axis = along(flange.p, -arm.form.past_wrist, flange.z), flange.z
    seeds: Any = arm.form.seeds[branch]
    radius = np.sqrt(wrist[0] * wrist[0] + wrist[1] * wrist[1])
    azimuth = math.atan2(wrist[1], wrist[0])
    c, s = math.cos(azimuth), math.sin(azimuth)
    out, across = c * axis[0] + s * axis[1], c * axis[1] - s * axis[0]
    share, farther = 1.0 / arm.form.unit, -1.0
    for _ in range(TRIES):
        chosen, least = -1, np.inf
        for k in range(arm.form.seed_counts[branch]):
            seed = seeds[k]
            a, b = share * (seed.radius - radius), share * (seed.height - wrist[2])
            x, y, z = seed.axis[0] - out, seed.axis[1] - across, seed.axis[2] - axis[2]
            square = a * a + b * b + x * x + y * y + z * z
            if farther < square < least:
                chosen, least = k, square
        if chosen < 0:
            break
        farther, q = least, seeds[chosen].q
        there, found = solved(arm, flange, Angles5(q[0] + azimuth, q[1], q[2], q[3], q[4]))
        if there:
            bend = bend_of_turns(*found)
            links = links_at(arm, bend)
            if name_of(arm, links, found) == branch and size_of(arm, links) > LEAST:
                return True, bend
    return False, bend_of_turns(0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def set_sizes(arm: Chain, flange: FlangeAxis, out: Array) -> None:
    """Fill in `|det J|`, for each class the smaller one of its branches [m^3], shape (4,)."""
    for choice in range(CLASSES):
        least = np.inf
        for branch in range(2 * choice, 2 * choice + 2):
            there, bend = solution(arm, flange, branch)
            if there:
                least = min(least, size_of(arm, links_at(arm, bend)))
        out[choice] = least if least < np.inf else 0.0


@kernel
def refined(arm: Chain, flange: FlangeAxis, form: Bend) -> tuple[bool, Bend]:
    """Turn joints where a form has them to where an arm has them that deviates a little from it.

    Returned is whether there is such a solution within `FARTHEST` of the given one, and it.
    """
    start = Angles5(
        math.atan2(form.s1, form.c1),
        math.atan2(form.s2, form.c2),
        math.atan2(form.s3, form.c3),
        math.atan2(form.s4, form.c4),
        math.atan2(form.s5, form.c5),
    )
    there, q = solved(arm, flange, start)
    there = there and abs(q.q1 - start.q1) < FARTHEST and abs(q.q2 - start.q2) < FARTHEST
    there = there and abs(q.q3 - start.q3) < FARTHEST and abs(q.q4 - start.q4) < FARTHEST
    there = there and abs(q.q5 - start.q5) < FARTHEST
    return there, bend_of_turns(*q)
