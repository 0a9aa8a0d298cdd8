"""Comparison of a limb with itself, the body and other limbs (compiled).

Results and sets are those of `against_boxes`.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.collisions.distances import (
    CLEAR,
    SELF,
    UNDECIDED,
    compare_capsule_with_box,
    compare_capsules,
)
from mlivr_gym.collisions.joint_lines import LimbPlace, travel
from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.collisions.placement import Shapes, axis_of, capsule_axis
from mlivr_gym.compiled.bit_sets import has, only
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.poses import minus, vector


@kernel
def compare_limb_with_itself(
    limb: LimbModel, placed: LimbPlace, pending: int, clearance: float
) -> tuple[int, int]:
    """Compare the capsules of a limb with each other; return a result and the undecided pairs."""
    undecided, ends = 0, placed.in_body.ends
    for k in range(limb.pair_count):
        if not has(pending, k):
            continue
        i, j = limb.pairs[k, 0], limb.pairs[k, 1]
        first, second, axis = limb.capsules[i], limb.capsules[j], axis_of(ends, limb.pairs[k, 1])
        inner = first.radius + second.radius + clearance
        # The joints between the two links move the second as seen from the first.
        moves = (
            travel(placed, first.link, second.link, axis[0]),
            travel(placed, first.link, second.link, axis[1]),
        )
        result = compare_capsules(axis, axis_of(ends, i), inner, 0.0, moves)
        if result == SELF:
            return SELF, undecided
        if result == UNDECIDED:
            undecided |= only(k)
    return UNDECIDED if undecided else CLEAR, undecided


@kernel
def compare_limb_with_body(
    robot: RobotModel, limb: LimbModel, shapes: Shapes, pending: int, clearance: float
) -> tuple[int, int]:
    """Compare a limb in the body frame with the body's box and the capsules fixed to the body.

    Returns a result and the undecided capsules.
    """
    undecided, half = 0, vector(robot.half)
    for c in range(limb.capsule_count):
        capsule = limb.capsules[c]
        if capsule.link < 2 or not has(pending, c):
            continue
        inner, axis = capsule.radius + clearance, axis_of(shapes.ends, c)
        moves = shapes.motion[c, 0], shapes.motion[c, 1]
        worst = compare_capsule_with_box(axis[0], minus(axis[1], axis[0]), half, inner, moves)
        for m in range(robot.mount_count):
            mount = robot.mounts[m]
            if worst < SELF and capsule.link >= limb.first_link[m]:
                fixed = capsule_axis(mount.ends)
                worst = max(worst, compare_capsules(axis, fixed, inner + mount.radius, 0.0, moves))
        if worst == SELF:
            return SELF, undecided
        if worst == UNDECIDED:
            undecided |= only(c)
    return UNDECIDED if undecided else CLEAR, undecided


@kernel
def have_separating_plane(
    first: LimbModel, shapes: Shapes, second: LimbModel, others: Shapes, clearance: float
) -> bool:
    """Return whether a plane normal to a coordinate axis separates two limbs by the clearance."""
    ends, other = shapes.ends, others.ends
    for k in range(3):
        low = other_low = np.inf
        high = other_high = -np.inf
        for i in range(first.capsule_count):
            for e in range(2):
                reach = first.capsules[i].radius + shapes.motion[i, e]
                low, high = min(low, ends[i, e, k] - reach), max(high, ends[i, e, k] + reach)
        for i in range(second.capsule_count):
            for e in range(2):
                reach = second.capsules[i].radius + others.motion[i, e]
                other_low = min(other_low, other[i, e, k] - reach)
                other_high = max(other_high, other[i, e, k] + reach)
        if low - other_high > clearance or other_low - high > clearance:
            return True
    return False


@kernel
def compare_limbs(
    first: LimbModel,
    shapes: Shapes,
    second: LimbModel,
    others: Shapes,
    pending: int,
    clearance: float,
) -> tuple[int, int]:
    """Compare two limbs in one frame; return a result and the undecided capsules of the first."""
    undecided = 0
    if have_separating_plane(first, shapes, second, others, clearance):
        return CLEAR, undecided
    for i in range(first.capsule_count):
        if not has(pending, i):
            continue
        axis, moves = axis_of(shapes.ends, i), (shapes.motion[i, 0], shapes.motion[i, 1])
        for j in range(second.capsule_count):
            inner = first.capsules[i].radius + second.capsules[j].radius + clearance
            more = max(others.motion[j, 0], others.motion[j, 1])
            result = compare_capsules(axis, axis_of(others.ends, j), inner, more, moves)
            if result == SELF:
                return SELF, undecided
            if result == UNDECIDED:
                undecided |= only(i)
    return UNDECIDED if undecided else CLEAR, undecided
