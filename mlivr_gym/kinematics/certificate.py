"""The proof that a limb that holds can follow a base path (compiled).

A limb that holds stays on its branch as long as `u` and the sines of elbow and wrist keep their
signs. `certify` proves by interval bisection that `w_m` stays at or above a floor over the whole
path, not merely at samples. From the middle of an interval to either end the wrist moves at most
`d` in the limb frame and the flange axis turns at most `a`, see `base_path.travel_seen` and
`turn_seen`; each family of arms bounds `u` and the sines by these, see `ur_bounds` and
`spherical_wrist_bounds`. If the product of the bounds reaches the floor the interval is certified,
if the midpoint itself is below the floor the path fails, otherwise the interval is halved. An
interval shorter than `2^-DEPTH` of the path counts as failed, so the answer errs on the safe side
only.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.bit_sets import CLASSES, has_class, without_class
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record
from mlivr_gym.kinematics.base_path import (
    CLOSEST_PIVOT,
    STRAIGHT,
    BasePath,
    pose_on_path,
    travel_seen,
    turn_seen,
)
from mlivr_gym.kinematics.families import branch_terms, stays_above
from mlivr_gym.kinematics.limb import MountedArm, flange_seen
from mlivr_gym.kinematics.poses import Pose, along, columns, vector

DEPTH = 12
"""Number of halvings after which an interval counts as failed."""

MOST_PIECES = 64
"""Maximum number of intervals of the first division."""

FIRST_INTERVAL = 0.2
"""Wrist travel that an interval of the first division covers [m]; a matter of speed only."""


class Proof(Record):
    """Scratch of a proof."""

    middle: Annotated[Array, (DEPTH + 2,)]
    """Middles of the intervals that are pending."""
    half: Annotated[Array, (DEPTH + 2,)]
    """Half their lengths."""
    terms: Annotated[Array, (4, 4)]
    """Filled by `branch_terms`."""
    base: Pose
    """Base in the world in the middle of an interval."""


@kernel
def certify(
    limb: MountedArm, flange: Pose, path: BasePath, floor: float, branch_set: int, scratch: Proof
) -> int:
    """Return the branches on which a limb that holds is proved to follow a base path.

    The flange is in the world, and `|det J|` is at least `floor` on the path [m^3]. Of the branches
    and flips of `branch_set`, all of a class are certified or none.
    """
    arm = limb.arm
    if path.kind != STRAIGHT and min(path.radius0, path.radius1) < CLOSEST_PIVOT:
        return 0
    _, _, axis = columns(flange.rotation)
    wrist = along(vector(flange.position), -arm.d6, axis)
    square_floor = (floor / arm.links) ** 2
    # The first intervals are about as long as the bounds can usually decide.
    pose_on_path(path, 0.5, scratch.base)
    travel = 2.0 * travel_seen(path, scratch.base, 0.5, 0.5, wrist)
    pieces = min(max(int(np.ceil(travel / FIRST_INTERVAL)), 1), MOST_PIECES)
    shortest = 0.5 ** (DEPTH + 1)
    piece = top = 0
    while branch_set and (top > 0 or piece < pieces):
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
            if not has_class(branch_set, c):
                continue
            square = scratch.terms[c, 3]
            if not square >= square_floor or square <= 0.0:
                branch_set = without_class(branch_set, c)
            elif not stays_above(arm, scratch.terms, c, (travel, turned), square_floor):
                if half < shortest:
                    branch_set = without_class(branch_set, c)
                undecided = True
        if undecided and half >= shortest:
            for side in (-0.5, 0.5):
                scratch.middle[top], scratch.half[top] = s + side * half, 0.5 * half
                top += 1
    return branch_set
