"""The rule that chooses a stance's posture among its candidates (compiled).

The candidates are base poses, see `base_poses`, with a branch for each limb. Those in which the
robot penetrates itself are excluded. Of the others, the one with the largest margin is chosen: the
minimum of `w_m / limb_threshold` over the limbs and of `w_b / base_threshold`. Margins within `TIE`
count as equal, as those of mirror postures are: then the largest clearance of the robot from itself
decides, and if that is equal within `CLEARANCE_TIE`, a fixed order in the frame of the grasps. It
prefers the smaller roll, of two opposite rolls the positive one, then the lower base, then the
lower branch numbers from the last limb to the first. With collisions checked, the rule applies to
what touches nothing.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.collisions.against_boxes import compare_base_with_boxes
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.compiled.bit_sets import BRANCHES, EMPTY, NONE, class_of
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.manipulability import inverse_root_determinant
from mlivr_gym.postures.base_poses import TIE, place, pose_count, set_pose
from mlivr_gym.postures.placed_limbs import PostureSearch, gap_between_limbs, limb_fits
from mlivr_gym.postures.reach import set_reach
from mlivr_gym.postures.records import Posture, PostureScratch

CLEARANCE_TIE = 1e-9
"""Difference up to which clearances of the robot from itself count as equal [m]."""


@kernel
def choose(search: PostureSearch, floor: float, out: Posture, scratch: PostureScratch) -> float:
    """Choose the posture of a stance among those with a margin above `floor` that touch nothing.

    It is stored without branch sets. Returned is its clearance from itself [m].
    """
    limbs, rule, rank, gap, best = search.robot.limb_count, search.rule, EMPTY, 0.0, floor
    out.pose_number, out.w_b, out.cause, out.is_node = NONE, 0.0, CLEAR, False
    for i in range(limbs):
        out.w_m[i], out.branch[i], out.branch_sets[i] = 0.0, EMPTY, EMPTY
    for pose in range(1 if rule.is_given else pose_count(search.geometry, rule)):
        least = best * (1.0 - TIE)
        if not set_base(search, pose, least * rule.scale_m, scratch):
            continue
        base, rests, nothing = scratch.base_in_world, scratch.lines.move, scratch.surface
        if search.has_boxes and compare_base_with_boxes(
            search.robot, base, rests, 0.0, search.grid, search.clearance, nothing
        ):
            continue
        for number in range(_list_options(search, least, scratch)):
            w_m, least = set_combination(limbs, number, scratch), best * (1.0 - TIE)
            if w_m < least * rule.scale_m:
                continue
            w_b = base_manipulability(limbs, scratch)
            margin = min(w_m / rule.scale_m, w_b / rule.scale_b)
            if margin <= floor or margin < least:
                continue
            to_itself = _gap_to_itself(search, scratch)
            if to_itself < search.clearance:
                continue
            order = pose
            for k in range(limbs - 1, -1, -1):
                order = order * BRANCHES + scratch.combination[k]
            is_larger = out.pose_number < 0 or margin * (1.0 - TIE) > best
            is_apart, is_close = to_itself > gap + CLEARANCE_TIE, to_itself < gap - CLEARANCE_TIE
            if is_larger or is_apart or (order < rank and not is_close):
                rank, gap, out.pose_number, out.w_b = order, to_itself, pose, w_b
                out.is_node = w_b >= rule.thresholds.w_b and w_m >= rule.thresholds.w_m
                for k in range(limbs):
                    b = scratch.combination[k]
                    out.branch[k], out.w_m[k] = b, scratch.w_m[k, class_of(b)]
            best = max(best, margin)
    return gap


@kernel
def set_base(search: PostureSearch, pose: int, least: float, scratch: PostureScratch) -> bool:
    """Set the base to a candidate base pose; for the rest see `set_reach`."""
    geometry, rule = search.geometry, search.rule
    if rule.is_given:
        place(geometry, search.given, scratch.base)  # the frame of the stance is the world
    else:
        set_pose(geometry, rule, pose, scratch.base)
    place(geometry, scratch.base, scratch.base_in_world)
    return set_reach(search.robot, geometry, scratch.base, least, scratch.w_m)


@kernel
def _list_options(search: PostureSearch, least: float, scratch: PostureScratch) -> int:
    """List the branches of each limb with a margin from `least` on on which it touches nothing.

    They are placed, see `limb_fits`. Returned is the number of their combinations.
    """
    combinations = 1
    for i in range(search.robot.limb_count):
        count = EMPTY
        for b in range(BRANCHES):
            w = scratch.w_m[i, class_of(b)]
            if w > 0.0 and w >= least * search.rule.scale_m and limb_fits(search, i, b, scratch):
                scratch.options[i, count] = b
                count += 1
        scratch.option_count[i] = count
        combinations *= count
    return combinations


@kernel
def set_combination(limbs: int, number: int, scratch: PostureScratch) -> float:
    """Set the combination of options by its number; return the minimum of `w_m` on it."""
    w_m = np.inf
    for i in range(limbs):
        b = scratch.options[i, number % scratch.option_count[i]]
        number //= scratch.option_count[i]
        scratch.combination[i] = b
        w_m = min(w_m, scratch.w_m[i, class_of(b)])
    return w_m


@kernel
def base_manipulability(limbs: int, scratch: PostureScratch) -> float:
    """Return `w_b` on the combination."""
    total = scratch.sums[0]
    for row in range(6):
        for col in range(row + 1):
            total[row, col] = 0.0
            for i in range(limbs):
                total[row, col] += scratch.information[i, scratch.combination[i], row, col]
    return inverse_root_determinant(scratch.sums)


@kernel
def _gap_to_itself(search: PostureSearch, scratch: PostureScratch) -> float:
    """Return the distance of the robot from itself on the combination [m].

    Below the clearance to keep, it may be any distance that is too small.
    """
    combination = scratch.combination
    gap: float = np.inf
    for i in range(search.robot.limb_count):
        gap = min(gap, scratch.gaps[i, combination[i]])
        for j in range(i):
            if gap < search.clearance:
                return gap
            between = gap_between_limbs(search, i, combination[i], j, combination[j], scratch)
            gap = min(gap, between)
    return gap
