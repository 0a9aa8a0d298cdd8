"""The proof that a limb that holds can follow a base path (compiled).

A holding limb stays on its branch as long as `u`, `s5` and `s3` keep their signs. `certify` proves
that `w_m` stays at or above a floor over the whole path, not merely at samples. Let the wrist move
at most `d` in the limb frame from the middle of an interval to either end and the flange axis turn
at most `a`, see `base_path.travel_seen` and `turn_seen`; then

    u^2    >= (rho - d)^2 - d4^2
    q1     changes by at most b1 = d / u_min            (|dq1/dw| = 1/u exactly)
    |s5|   >= |s5| - (a + b1)
    z4     turns by at most b4 = (a + b1) / s5_min      (z4 = +-(y1 x z6) / |s5|)
    D      changes by at most d + |d4| b1 + |d5| b4     (shoulder to forearm end)

and the range of D bounds `s3^2`. If the product of the bounds reaches the floor the interval is
certified, if the midpoint itself is below the floor the path fails, otherwise the interval is
halved. An interval shorter than `2^-DEPTH` of the path counts as failed, so the answer errs on the
safe side only.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.bit_sets import CLASSES, has_class, without_class
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record
from mlivr_gym.kinematics.arm import Arm
from mlivr_gym.kinematics.base_path import (
    CLOSEST_PIVOT,
    STRAIGHT,
    BasePath,
    pose_on_path,
    travel_seen,
    turn_seen,
)
from mlivr_gym.kinematics.families import branch_terms
from mlivr_gym.kinematics.limb import MountedArm, flange_seen
from mlivr_gym.kinematics.poses import Pose, along, columns, vector

DEPTH = 12
"""Number of halvings after which an interval counts as failed."""

MOST_PIECES = 64
"""Most intervals of the first division."""

FIRST_INTERVAL = 0.2
"""Wrist travel that an interval of the first division covers [m]; a matter of speed only."""


class Proof(Record):
    """Room for a proof."""

    middle: Annotated[Array, (DEPTH + 2,)]
    """Middles of the intervals that wait."""
    half: Annotated[Array, (DEPTH + 2,)]
    """Half their lengths."""
    terms: Annotated[Array, (4, 4)]
    """What `branch_terms` fills."""
    base: Pose
    """Base in the world in the middle of an interval."""


@kernel
def certify(
    limb: MountedArm, flange: Pose, path: BasePath, floor: float, mask: int, scratch: Proof
) -> int:
    """Branches on which a holding limb can follow a base path.

    Parameters
    ----------
    limb
        The limb.
    flange
        Flange in the world.
    path
        The base path.
    floor
        Least `|det J|` on the path [m^3].
    mask
        Branches and flips to look at.
    scratch
        Scratch.

    Returns
    -------
    int
        Those of them that are certified; all of a class or none.
    """
    arm = limb.arm
    if path.kind != STRAIGHT and min(path.radius0, path.radius1) < CLOSEST_PIVOT:
        return 0
    _, _, axis = columns(flange.rotation)
    wrist = along(vector(flange.position), -arm.d6, axis)
    square_floor = (floor / (arm.a2 * arm.a3)) ** 2
    # The first intervals are about as long as the bounds can usually decide.
    pose_on_path(path, 0.5, scratch.base)
    travel = 2.0 * travel_seen(path, scratch.base, 0.5, 0.5, wrist)
    pieces = min(max(int(np.ceil(travel / FIRST_INTERVAL)), 1), MOST_PIECES)
    shortest = 0.5 ** (DEPTH + 1)
    piece = top = 0
    while mask and (top > 0 or piece < pieces):
        if top > 0:
            top -= 1
            s, half = scratch.middle[top], scratch.half[top]
        else:
            half = 0.5 / pieces
            s = (2 * piece + 1) * half
            piece += 1
        pose_on_path(path, s, scratch.base)
        seen, _ = flange_seen(limb, scratch.base, flange)
        branch_terms(arm, seen, scratch.terms)
        undecided = False
        travel, turned = (
            travel_seen(path, scratch.base, s, half, wrist),
            turn_seen(path, scratch.base, half, axis),
        )
        for c in range(CLASSES):
            if not has_class(mask, c):
                continue
            square = scratch.terms[c, 3]
            if not square >= square_floor or square <= 0.0:
                mask = without_class(mask, c)
            elif not _stays(arm, scratch.terms, c, (travel, turned), square_floor):
                if half < shortest:
                    mask = without_class(mask, c)
                undecided = True
        if undecided and half >= shortest:
            for side in (-0.5, 0.5):
                scratch.middle[top], scratch.half[top] = s + side * half, 0.5 * half
                top += 1
    return mask


@kernel
def _stays(
    arm: Arm, terms: Array, choice: int, change: tuple[float, float], square_floor: float
) -> bool:
    """Whether the bounds keep a class above the floor on an interval.

    Parameters
    ----------
    arm
        The arm.
    terms
        What `branch_terms` fills, in the middle.
    choice
        The class.
    change
        How far the wrist moves [m] and the flange axis turns [rad] at most.
    square_floor
        Least `(s3 s5 u)^2` [m^2].
    """
    d, a = change
    k2 = arm.a2 * arm.a2 + arm.a3 * arm.a3
    rho = np.sqrt(terms[choice, 0] + arm.d4 * arm.d4)
    u2_min = (rho - d) ** 2 - arm.d4 * arm.d4 if rho > d else -1.0
    b1 = d / np.sqrt(u2_min) if u2_min > 0.0 else np.inf
    s5_min = np.sqrt(terms[choice, 1]) - (a + b1)
    if not s5_min > 0.0:
        return False
    distance = np.sqrt(k2 + 2.0 * arm.a2 * arm.a3 * terms[choice, 2])
    change_of_distance = d + abs(arm.d4) * b1 + abs(arm.d5) * (a + b1) / s5_min
    closest = distance - change_of_distance if distance > change_of_distance else 0.0
    low = (closest * closest - k2) / (2.0 * arm.a2 * arm.a3)
    high = ((distance + change_of_distance) ** 2 - k2) / (2.0 * arm.a2 * arm.a3)
    s3_2_min = 1.0 - max(low * low, high * high)
    stays: bool = s3_2_min > 0.0 and u2_min * s5_min * s5_min * s3_2_min >= square_floor
    return stays
