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
from mlivr_gym.kinematics.arm import FlangeAxis
from mlivr_gym.kinematics.manipulability import inverse_root_determinant, limb_information
from mlivr_gym.kinematics.poses import vector
from mlivr_gym.postures.base_poses import TIE, place
from mlivr_gym.postures.gaps import self_clearance, touching_limb
from mlivr_gym.postures.records import CandidatePose, Posture, PostureScratch, PostureSearch

CLEARANCE_TIE = 1e-9
"""Difference up to which clearances of the robot from itself count as equal [m]."""


@kernel
def prepare_candidate(
    search: PostureSearch, c: int, least: float, scratch: PostureScratch
) -> int:
    """Prepare the evaluation of candidate base pose `c` of a stance.

    The options of each limb become its branches above the margin `least`, the best ones first, and
    their `K^-1` is computed. Returned is the cause of a collision of the base with a box, else 0.
    """
    robot, candidate, l_c = search.robot, scratch.candidates[c], search.robot.characteristic_length
    for i in range(robot.limb_count):
        for b in range(BRANCHES):
            for j in range(robot.limb_count):
                for other in range(BRANCHES):
                    scratch.gaps[i, b, j, other] = np.inf
    place(search.geometry, candidate.base, scratch.base)
    if search.has_boxes:
        still, clearance = (0.0, 0.0), search.clearance
        cause = compare_base_with_boxes(
            robot, scratch.base, still, search.grid, clearance, scratch.surface
        )
        if cause != CLEAR:
            return int(cause)
    for i in range(robot.limb_count):
        limb, reach, options = robot.limbs[i], candidate.limbs[i], scratch.options[i]
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
    return CLEAR


@kernel
def first_combination(count: int, scratch: PostureScratch) -> int:
    """Make `next_combination` start from the first one; return the limb to go on with."""
    scratch.option_index[count - 1] = -1
    for row in range(6):
        for col in range(row + 1):
            scratch.sums[count, row, col] = 0.0
    return count - 1


@kernel
def next_combination(
    search: PostureSearch, candidate: CandidatePose, least: float, i: int, scratch: PostureScratch
) -> bool:
    """Set the combination to the next one; return whether there is one.

    The branch of limb `i` changes, and those of the limbs before it start again; that of limb 0
    changes fastest. Combinations with a `w_m` below the margin `least` or of branches that are
    known to touch something are skipped as a group. `scratch.sums[0]` becomes the sum of `K^-1`.
    """
    limbs, options, combination = search.robot.limb_count, scratch.options, scratch.combination
    while i < limbs:
        scratch.option_index[i] += 1
        if scratch.option_index[i] >= scratch.option_count[i]:
            i += 1
            continue
        b = options[i, scratch.option_index[i]]
        if candidate.limbs[i].w[class_of(b)] < least * search.rule.scale_m:
            i += 1  # those after it are no better
            continue
        combination[i] = b
        touches = scratch.gaps[i, b, i, b] < search.clearance
        for j in range(i + 1, limbs):
            touches |= scratch.gaps[i, b, j, combination[j]] < search.clearance
        if touches:
            continue
        for row in range(6):
            for col in range(row + 1):
                scratch.sums[i, row, col] = (
                    scratch.sums[i + 1, row, col] + scratch.information[i, b, row, col]
                )
        if i == 0:
            return True
        i -= 1
        scratch.option_index[i] = -1
    return False


@kernel
def w_b_of_combination(scratch: PostureScratch) -> float:
    """Return `w_b` on the branches in `scratch.combination`."""
    for row in range(6):
        for col in range(row + 1):
            scratch.work[0, row, col] = scratch.sums[0, row, col]
    return inverse_root_determinant(scratch.work)


@kernel
def choose(search: PostureSearch, floor: float, out: Posture, scratch: PostureScratch) -> float:
    """Choose the posture of a stance among those with a margin above `floor` that touch nothing.

    It is stored without base and branch sets. Returned is its clearance from itself [m].
    """
    limbs, scales, rank, gap, best = search.robot.limb_count, search.rule, EMPTY, 0.0, floor
    out.pose_number, out.w_b, out.cause, out.is_node = NONE, 0.0, CLEAR, False
    for i in range(limbs):
        out.w_m[i], out.branch[i], out.branch_sets[i] = 0.0, EMPTY, EMPTY
    for c in range(search.candidate_count):
        scratch.candidates[c].open_bound = scratch.candidates[c].margin_bound
    while True:
        c = EMPTY
        for other in range(1, search.candidate_count):
            if scratch.candidates[other].open_bound > scratch.candidates[c].open_bound:
                c = other
        candidate, least = scratch.candidates[c], best * (1.0 - TIE)
        if candidate.open_bound <= floor or candidate.open_bound < least:
            return gap
        candidate.open_bound = 0.0
        if prepare_candidate(search, c, least, scratch) != CLEAR:
            continue
        i = first_combination(limbs, scratch)
        while next_combination(search, candidate, least, i, scratch):
            i, w_m, w_b = EMPTY, np.inf, w_b_of_combination(scratch)
            for k in range(limbs):
                w_m = min(w_m, candidate.limbs[k].w[class_of(scratch.combination[k])])
            margin = min(w_m / scales.scale_m, w_b / scales.scale_b)
            if margin <= floor or margin < least:
                continue
            touching = touching_limb(search, candidate, scratch)
            if touching >= 0:
                i = touching
                continue
            to_itself, order = self_clearance(limbs, scratch), c
            for k in range(limbs - 1, -1, -1):
                order = order * BRANCHES + scratch.combination[k]
            is_closer, is_apart = to_itself < gap - CLEARANCE_TIE, to_itself > gap + CLEARANCE_TIE
            if margin * (1.0 - TIE) > best or is_apart or (order < rank and not is_closer):
                rank, gap = order, to_itself
                _store(search, c, w_m, w_b, out, scratch)
            best = max(best, margin)
            least = best * (1.0 - TIE)


@part
def _store(
    search: PostureSearch, c: int, w_m: float, w_b: float, out: Posture, scratch: PostureScratch
) -> None:
    """Store a combination at candidate `c`, whose limbs have at least `w_m`, as the posture."""
    limits = search.rule.thresholds
    out.pose_number, out.w_b, out.is_node = c, w_b, w_b >= limits.w_b and w_m >= limits.w_m
    for i in range(search.robot.limb_count):
        out.branch[i] = scratch.combination[i]
        out.w_m[i] = scratch.candidates[c].limbs[i].w[class_of(out.branch[i])]
