"""The rule that chooses a stance's posture among its candidates (compiled).

`solver` states the rule. Branch and bound evaluates it: a combination of branches is skipped where
an upper bound of its margin, or a stored collision, shows that it cannot be chosen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.collisions.against_boxes import compare_base_with_boxes
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.compiled.bit_sets import BRANCHES, EMPTY, NONE, YES, class_of
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.kinematics.arm import FlangeAxis
from mlivr_gym.kinematics.manipulability import inverse_root_determinant, limb_information
from mlivr_gym.kinematics.poses import vector
from mlivr_gym.postures.branches import (
    combined_w_b,
    forget_checks,
    limb_status,
    limbs_keep_apart,
    self_clearance,
)
from mlivr_gym.postures.records import CandidatePose, Limbs, PostureScratch, PostureSearch

TIE = 1e-9
"""Relative difference up to which margins count as equal."""

SLACK = 1e-9
"""Relative tolerance of bounds, which are summed in a different order."""

CLEARANCE_TIE = 1e-9
"""Difference up to which clearances of the robot from itself count as equal [m]."""


class ChosenPosture(NamedTuple):
    """Result of the rule."""

    pose: int
    """Index of the base pose, or -1 if none is chosen."""
    w_b: float
    """Its base manipulability."""
    largest_margin: float
    """Largest margin of all candidates evaluated."""


@kernel
def prepare_candidate(
    search: PostureSearch, c: int, floor: float, check_contacts: bool, scratch: PostureScratch
) -> bool:
    """Prepare the evaluation of candidate base pose `c` of a stance.

    Stored collision results are cleared. The options of each limb become its branches above the
    margin `floor`, and their `K^-1` is computed. With `check_contacts` the base must touch no box;
    False if it does.
    """
    robot, geometry, rule, candidate = (
        search.robot,
        search.geometry,
        search.rule,
        scratch.candidates[c],
    )
    count = robot.limb_count
    forget_checks(count, scratch)
    for axis in range(3):
        scratch.base.position[axis] = geometry.centre[axis] + candidate.base.position[axis]
        for col in range(3):
            scratch.base.rotation[axis, col] = candidate.base.rotation[axis, col]
    if check_contacts:
        still = (0.0, 0.0)
        result = compare_base_with_boxes(
            robot, scratch.base, still, search.grid, search.clearance, scratch.surface
        )
        if result != CLEAR:
            return False
    for i in range(count):
        limb_reach = candidate.limbs[i]
        flange = FlangeAxis(vector(limb_reach.p), vector(limb_reach.z))
        scratch.option_count[i] = 0
        for b in range(BRANCHES):
            if limb_reach.w[class_of(b)] > floor * rule.scale_m:
                scratch.options[i, scratch.option_count[i]] = b
                scratch.option_count[i] += 1
                limb_information(
                    robot.limbs[i],
                    flange,
                    b,
                    robot.characteristic_length,
                    scratch.inversion,
                    scratch.information[i, b],
                )
    _bound_roots(candidate, count, scratch)
    return True


@kernel
def _bound_roots(candidate: CandidatePose, count: int, scratch: PostureScratch) -> None:
    """Set `scratch.roots`, lower bounds of the sixth roots of the determinants that limbs add."""
    total = 0.0
    for i in range(count):
        scratch.roots[i], best = total, 0.0
        for k in range(scratch.option_count[i]):
            best = max(best, candidate.limbs[i].w[class_of(scratch.options[i, k])])
        total += np.inf if best == 0.0 else best ** (-1.0 / 3.0)


@kernel
def _may_reach_margin(search: PostureSearch, i: int, least: float, scratch: PostureScratch) -> bool:
    """Return whether `w_b` may reach a margin with the branches of limb `i` and the limbs after it.

    The sixth root of the determinant of a sum is at least the sum of the sixth roots (Minkowski),
    and `K^-1` of one limb has the determinant `w_m^-2`. The bound is not evaluated for the last
    limb alone, where it is weak, nor for all limbs, where `w_b` itself is computed.
    """
    last = search.robot.limb_count - 1
    if i == 0:
        return True
    sums, work = scratch.sums[i], scratch.work
    for row in range(6):
        for col in range(row + 1):
            total = scratch.information[i, scratch.combination[i], row, col]
            if i < last:
                total += scratch.sums[i + 1, row, col]
            sums[row, col] = work[0, row, col] = total
    if i == last:
        return True
    w_b = inverse_root_determinant(work)
    if w_b == 0.0:  # too close to a singularity for a bound
        return True
    bound: float = (w_b ** (-1.0 / 3.0) + scratch.roots[i]) ** -3.0
    return bound * (1.0 + SLACK) >= least * search.rule.scale_b


@kernel
def touches_nothing(search: PostureSearch, c: int, scratch: PostureScratch) -> bool:
    """Return whether the limbs touch nothing in the current combination at base pose `c`."""
    robot, candidate = search.robot, scratch.candidates[c]
    for i in range(robot.limb_count):
        result = limb_status(search, candidate, i, scratch.combination[i], scratch)
        if result != CLEAR:
            return False
    return limbs_keep_apart(search, scratch)


@kernel
def _combination_bound(
    search: PostureSearch, candidate: CandidatePose, scratch: PostureScratch
) -> float:
    """Return the smallest `w_m` of the combination as a margin.

    It is 0 if a branch is known to touch something.
    """
    bound = np.inf
    for i in range(search.robot.limb_count):
        b = scratch.combination[i]
        bound = min(
            bound, candidate.limbs[i].w[class_of(b)] if scratch.status[i, b] <= CLEAR else 0.0
        )
    return bound / search.rule.scale_m


@kernel
def _reset_combinations(count: int, scratch: PostureScratch) -> None:
    """Make `_next_useful` start from the first combination."""
    scratch.option_index[count - 1] = -1


@kernel
def _next_useful(
    search: PostureSearch,
    candidate: CandidatePose,
    least: tuple[float, float],
    least_gap: float,
    depth: int,
    scratch: PostureScratch,
) -> bool:
    """Set the combination to the next one that may be chosen; return whether there is one.

    Limb 0 changes fastest. Combinations are skipped as a group if they share a branch whose `w_m`
    is below a margin or that is known to touch something, two branches known to touch or to be too
    close to each other (up to `least_gap` [m]), or branches with which `w_b` stays below a margin
    whatever the others are. `least` are the margins of `w_m` and of `w_b`; `depth` is the limb
    whose branch changes: the last limb at the start, 0 after a combination.
    """
    limbs, i = search.robot.limb_count, depth
    if depth == 0:
        # Results for the last combination may exclude branches of later limbs too.
        for k in range(1, limbs):
            if not _may_serve(search, candidate, k, least[0], least_gap, scratch):
                i = k
    while i < limbs:
        scratch.option_index[i] += 1
        if scratch.option_index[i] >= scratch.option_count[i]:
            i += 1
            continue
        scratch.combination[i] = scratch.options[i, scratch.option_index[i]]
        if not _may_serve(search, candidate, i, least[0], least_gap, scratch):
            continue
        if not _may_reach_margin(search, i, least[1], scratch):
            continue
        if i == 0:
            return True
        i -= 1
        scratch.option_index[i] = -1
    return False


@kernel
def _may_serve(
    search: PostureSearch,
    candidate: CandidatePose,
    i: int,
    least: float,
    least_gap: float,
    scratch: PostureScratch,
) -> bool:
    """Return whether the branch of limb `i` may be chosen with those of the limbs after it."""
    b = scratch.combination[i]
    if (
        candidate.limbs[i].w[class_of(b)] < least * search.rule.scale_m
        or scratch.status[i, b] > CLEAR
    ):
        return False
    for j in range(i + 1, search.robot.limb_count):
        c = scratch.combination[j]
        if scratch.pairs[i, b, j, c] > CLEAR or scratch.gaps[i, b, j, c] <= least_gap:
            return False
    to_itself: float = scratch.gaps[i, b, i, b]
    return to_itself > least_gap


@kernel
def _largest_margin(
    search: PostureSearch, floor: float, check_contacts: bool, scratch: PostureScratch
) -> float:
    """Return the largest margin above `floor` of all candidates of a stance, or `floor`.

    With `check_contacts` only postures that touch nothing count; contacts are checked only where
    the margin would be the largest. `w_b` is computed only where `w_m` permits a larger margin.
    """
    limbs, margin = search.robot.limb_count, floor
    for c in range(search.candidate_count):
        scratch.candidates[c].open_bound = scratch.candidates[c].margin_bound
    while True:
        c = EMPTY
        for other in range(1, search.candidate_count):
            if scratch.candidates[other].open_bound > scratch.candidates[c].open_bound:
                c = other
        candidate = scratch.candidates[c]
        top = candidate.open_bound
        if top <= margin or top <= 0.0:
            return margin
        candidate.open_bound = 0.0
        if not prepare_candidate(search, c, margin, check_contacts, scratch):
            continue
        for stage in range(2):
            # The first stage takes only combinations whose smallest `w_m` is the largest one.
            least, depth = top * (1.0 - TIE) if stage == 0 else 0.0, limbs - 1
            _reset_combinations(limbs, scratch)
            while margin < top:
                floors = max(least, margin), margin
                if not _next_useful(search, candidate, floors, -np.inf, depth, scratch):
                    break
                depth = 0
                bound = _combination_bound(search, candidate, scratch)
                if bound > margin and bound >= least:
                    result = min(bound, combined_w_b(limbs, scratch) / search.rule.scale_b)
                    if result > margin and (
                        not check_contacts or touches_nothing(search, c, scratch)
                    ):
                        margin = result


@kernel
def _break_ties(
    search: PostureSearch, margin: float, scratch: PostureScratch, branch: Limbs
) -> ChosenPosture:
    """Choose the posture among those that tie with the largest margin and touch nothing.

    Margins within `TIE` of `margin` tie. Among them the largest clearance of the robot from itself
    decides; among those within `CLEARANCE_TIE` the first in the order of candidates and then of
    branches. `branch` is set to its branches.
    """
    limbs, least = search.robot.limb_count, margin * (1.0 - TIE)
    chosen, gap, best_wb = NONE, -np.inf, 0.0
    check_contacts = YES
    for c in range(search.candidate_count):
        candidate = scratch.candidates[c]
        if candidate.margin_bound < least or not prepare_candidate(
            search, c, least * (1.0 - TIE), check_contacts, scratch
        ):
            continue
        depth, least_gap = limbs - 1, -np.inf
        _reset_combinations(limbs, scratch)
        while True:
            if chosen >= 0:
                least_gap = gap + CLEARANCE_TIE
            if not _next_useful(search, candidate, (least, least), least_gap, depth, scratch):
                break
            depth = 0
            w_b = combined_w_b(limbs, scratch)
            if w_b / search.rule.scale_b >= least and touches_nothing(search, c, scratch):
                result = self_clearance(search.robot, gap, scratch)
                if chosen < 0 or result > gap + CLEARANCE_TIE:
                    chosen, gap, best_wb = c, result, w_b
                    for i in range(limbs):
                        branch[i] = scratch.combination[i]
    return ChosenPosture(chosen, best_wb, margin)


@part
def best_posture(
    search: PostureSearch, floor: float, best_first: bool, scratch: PostureScratch, branch: Limbs
) -> ChosenPosture:
    """Choose the posture of a stance among those with a margin above `floor` that touch nothing.

    With `best_first`, contacts are checked first only for the postures of the largest margin of
    all, touching or not; the result is the same. `branch` is set to the chosen branches.
    """
    chosen, w_b, largest = NONE, 0.0, floor
    for stage in range(2):
        check_contacts = stage > 0
        if not check_contacts and not best_first:
            continue
        margin = _largest_margin(search, floor, check_contacts, scratch)
        largest = max(largest, margin)
        if margin > floor:
            result = _break_ties(search, margin, scratch, branch)
            chosen, w_b = result.pose, result.w_b
        if chosen >= 0 or margin <= floor:
            break
    return ChosenPosture(chosen, w_b, largest)
