"""The rule that chooses a stance's posture among its candidates (compiled).

The candidates are base poses, see `base_poses`, with a branch for each limb. Those in which the
robot penetrates itself are excluded. Of the others, the one with the largest margin is chosen: the
minimum of `w_m / limb_threshold` over the limbs and of `w_b / base_threshold`. Margins within `TIE`
count as equal, as those of mirror postures are: then the largest clearance of the robot from itself
decides, and if that is equal within `CLEARANCE_TIE`, a fixed order in the frame of the grasps. It
prefers the smaller roll, of two opposite rolls the positive one, then the lower base, then the
lower branch numbers from the last limb to the first. With collisions checked, the rule applies to
what touches nothing.

`choose` enumerates them in the order of what `w_m` alone allows, and ends where that is less than
the largest margin so far.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.collisions.against_boxes import compare_base_with_boxes
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.compiled.bit_sets import BRANCHES, EMPTY, NONE, class_of
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.kinematics.chain import FlangeAxis
from mlivr_gym.kinematics.manipulability import inverse_root_determinant, limb_information
from mlivr_gym.kinematics.poses import vector
from mlivr_gym.postures.base_poses import TIE, place, pose_count, set_pose
from mlivr_gym.postures.gaps import PostureSearch, self_clearance, touching_limb
from mlivr_gym.postures.reach import evaluate_reach
from mlivr_gym.postures.records import Posture, PostureScratch

CLEARANCE_TIE = 1e-9
"""Difference up to which clearances of the robot from itself count as equal [m]."""


@kernel
def prepare_candidate(search: PostureSearch, number: int, scratch: PostureScratch) -> int:
    """Set `scratch.candidate` to a candidate base pose, of which no distance is known yet.

    Returned is the cause of a collision of the base with a box, else 0.
    """
    robot, geometry, candidate = search.robot, search.geometry, scratch.candidate
    set_candidate(search, number, 0.0, scratch)
    place(geometry, candidate.base, scratch.base)
    for i in range(robot.limb_count):
        for b in range(BRANCHES):
            for j in range(robot.limb_count):
                for c in range(BRANCHES):
                    scratch.gaps[i, b, j, c] = np.inf
    if not search.has_boxes:
        return CLEAR
    clearance, surface = search.clearance, scratch.surface
    return compare_base_with_boxes(robot, scratch.base, search.grid, clearance, surface)


@kernel
def set_candidate(
    search: PostureSearch, number: int, floor: float, scratch: PostureScratch
) -> float:
    """Set `scratch.candidate` to a candidate base pose; for the rest see `evaluate_reach`."""
    geometry, rule, candidate = search.geometry, search.rule, scratch.candidate
    if rule.is_given:
        place(geometry, search.given, candidate.base)  # the frame of the stance is the world
    else:
        set_pose(geometry, rule, number, candidate.base)
    return evaluate_reach(search.robot, geometry, floor, candidate, scratch.sizes)


@part
def _list_options(search: PostureSearch, least: float, scratch: PostureScratch) -> None:
    """List the branches of each limb from a margin on, the best first, with their `K^-1`."""
    robot, l_c = search.robot, search.robot.characteristic_length
    for i in range(robot.limb_count):
        limb, reach, options = robot.limbs[i], scratch.candidate.limbs[i], scratch.options[i]
        flange, count = FlangeAxis(vector(reach.p), vector(reach.z)), EMPTY
        for b in range(BRANCHES):
            w = reach.w[class_of(b)]
            if w >= least * search.rule.scale_m and w > 0.0:
                information = scratch.information[i, b]
                limb_information(limb, flange, b, l_c, scratch.inversion, information)
                k = count
                while k > 0 and reach.w[class_of(options[k - 1])] < w:
                    options[k] = options[k - 1]
                    k -= 1
                options[k] = b
                count += 1
        scratch.option_count[i] = count


@kernel
def next_combination(search: PostureSearch, least: float, i: int, scratch: PostureScratch) -> bool:
    """Set the combination to the next one of the options; return whether there is one.

    The branch of limb `i` changes, and those of the limbs before it start again; with the number of
    limbs for `i`, all do. The branch of limb 0 changes fastest. Combinations with a `w_m` below the
    margin `least`, or of branches that are known to touch something, are skipped as a group. The
    sum of `K^-1` is written into `scratch.sums[0, 0]`.
    """
    limbs, combination, sums = search.robot.limb_count, scratch.combination, scratch.sums
    if i == limbs:
        i -= 1
        scratch.option_index[i] = -1
    while i < limbs:
        scratch.option_index[i] += 1
        k = scratch.option_index[i]
        b = scratch.options[i, min(k, BRANCHES - 1)]
        reach = scratch.candidate.limbs[i]
        if k >= scratch.option_count[i] or reach.w[class_of(b)] < least * search.rule.scale_m:
            i += 1  # the options after it are no better
            continue
        combination[i] = b
        touches = scratch.gaps[i, b, i, b] < search.clearance
        for j in range(i + 1, limbs):
            touches |= scratch.gaps[i, b, j, combination[j]] < search.clearance
        if touches:
            continue
        for row in range(6):
            for col in range(row + 1):
                after = sums[i + 1, 0, row, col] if i + 1 < limbs else 0.0
                sums[i, 0, row, col] = after + scratch.information[i, b, row, col]
        if i == 0:
            return True
        i -= 1
        scratch.option_index[i] = -1
    return False


@kernel
def choose(search: PostureSearch, floor: float, out: Posture, scratch: PostureScratch) -> float:
    """Choose the posture of a stance among those with a margin above `floor` that touch nothing.

    It is stored without base and branch sets. Returned is its clearance from itself [m].
    """
    limbs, rule, rank, gap, best = search.robot.limb_count, search.rule, EMPTY, 0.0, floor
    out.pose_number, out.w_b, out.cause, out.is_node = NONE, 0.0, CLEAR, False
    for i in range(limbs):
        out.w_m[i], out.branch[i], out.branch_sets[i] = 0.0, EMPTY, EMPTY
    count = 1 if rule.is_given else pose_count(search.geometry, rule)
    for number in range(count):
        w_m = set_candidate(search, number, floor * rule.scale_m, scratch)
        scratch.bounds[number] = w_m / rule.scale_m
    while True:
        number = EMPTY
        for other in range(1, count):
            if scratch.bounds[other] > scratch.bounds[number]:
                number = other
        bound, least = scratch.bounds[number], best * (1.0 - TIE)
        if bound <= floor or bound < least:
            return gap
        scratch.bounds[number] = 0.0
        if prepare_candidate(search, number, scratch) != CLEAR:
            continue
        _list_options(search, least, scratch)
        i = limbs
        while next_combination(search, least, i, scratch):
            i, w_m, w_b = EMPTY, np.inf, inverse_root_determinant(scratch.sums[0])
            for k in range(limbs):
                w_m = min(w_m, scratch.candidate.limbs[k].w[class_of(scratch.combination[k])])
            margin = min(w_m / rule.scale_m, w_b / rule.scale_b)
            if margin <= floor or margin < least:
                continue
            touching = touching_limb(search, scratch)
            if touching >= 0:
                i = touching
                continue
            to_itself, order = self_clearance(limbs, scratch), number
            for k in range(limbs - 1, -1, -1):
                order = order * BRANCHES + scratch.combination[k]
            is_larger = out.pose_number < 0 or margin * (1.0 - TIE) > best
            is_apart, is_close = to_itself > gap + CLEARANCE_TIE, to_itself < gap - CLEARANCE_TIE
            if is_larger or is_apart or (order < rank and not is_close):
                rank, gap, out.pose_number, out.w_b = order, to_itself, number, w_b
                out.is_node = w_b >= rule.thresholds.w_b and w_m >= rule.thresholds.w_m
                for k in range(limbs):
                    b = scratch.combination[k]
                    out.branch[k], out.w_m[k] = b, scratch.candidate.limbs[k].w[class_of(b)]
            best = max(best, margin)
            least = best * (1.0 - TIE)
