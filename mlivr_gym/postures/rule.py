"""The rule by which one of a stance's candidates becomes its posture (compiled); see `solver`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.collisions.against_boxes import base_against_boxes
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.compiled.bit_sets import BRANCHES, EMPTY, NONE, class_of
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.kinematics.arm import FlangeAxis
from mlivr_gym.kinematics.manipulability import inverse_root_determinant, limb_information
from mlivr_gym.kinematics.poses import vector
from mlivr_gym.postures.branches import (
    apart,
    clear_branches,
    combined,
    limb_status,
    self_clearance,
)
from mlivr_gym.postures.records import CandidatePose, Limbs, PostureScratch, PostureSearch

TIE = 1e-9
"""Margins that differ by this share or less count as equal."""

SLACK = 1e-9
"""Share by which bounds may fall short: they are worked out in another order."""

CLEARANCE_TIE = 1e-9
"""Clearances of the robot to itself that differ by this or less count as equal [m]."""


class Chosen(NamedTuple):
    """What it finds."""

    pose: int
    """Which base pose, or -1 if there is none."""
    w_b: float
    """Its base manipulability."""
    seen: float
    """The largest margin that was seen."""


@kernel
def enter(search: PostureSearch, c: int, floor: float, look: bool, scratch: PostureScratch) -> bool:
    """Prepare base pose `c` of a stance.

    What its branches touch is not known any more; `K^-1` of those above a margin is worked out, and
    these are combined.

    Parameters
    ----------
    search
        What is searched.
    c
        Index of the base pose.
    floor
        Margin that branches must exceed.
    look
        Whether the body must touch no box.
    scratch
        Scratch.

    Returns
    -------
    bool
        Whether the base pose may be looked at.
    """
    robot, held, rule, tried = search.robot, search.held, search.rule, scratch.tried[c]
    count = robot.limb_count
    clear_branches(count, scratch)
    for axis in range(3):
        scratch.base.position[axis] = held.centre[axis] + tried.base.position[axis]
        for col in range(3):
            scratch.base.rotation[axis, col] = tried.base.rotation[axis, col]
    if look:
        still = (0.0, 0.0)
        found = base_against_boxes(
            robot, scratch.base, still, search.grid, search.clearance, scratch.behind
        )
        if found != CLEAR:
            return False
    for i in range(count):
        reached = tried.limbs[i]
        flange = FlangeAxis(vector(reached.p), vector(reached.z))
        scratch.option_count[i] = 0
        for b in range(BRANCHES):
            if reached.w[class_of(b)] > floor * rule.scale_m:
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
    _bound_roots(tried, count, scratch)
    return True


@kernel
def _bound_roots(tried: CandidatePose, count: int, scratch: PostureScratch) -> None:
    """Lower bounds of the sixth roots of the determinants that limbs add, into `scratch.roots`."""
    total = 0.0
    for i in range(count):
        scratch.roots[i], best = total, 0.0
        for k in range(scratch.option_count[i]):
            best = max(best, tried.limbs[i].w[class_of(scratch.options[i, k])])
        total += np.inf if best == 0.0 else best ** (-1.0 / 3.0)


@kernel
def _may_reach(search: PostureSearch, i: int, least: float, scratch: PostureScratch) -> bool:
    """Whether `w_b` may reach a margin with the branches `trial` of limb `i` and those after it.

    Sixth roots of determinants of sums are no less than the sums of the roots (Minkowski), and
    `K^-1` of one limb has the determinant `w_m^-2`. Of one limb alone that says little, and of all
    `w_b` itself is formed.
    """
    last = search.robot.limb_count - 1
    if i == 0:
        return True
    sums, work = scratch.sums[i], scratch.work
    for row in range(6):
        for col in range(row + 1):
            total = scratch.information[i, scratch.trial[i], row, col]
            if i < last:
                total += scratch.sums[i + 1, row, col]
            sums[row, col] = work[0, row, col] = total
    if i == last:
        return True
    w_b = inverse_root_determinant(work)
    if w_b == 0.0:  # too near a singularity to tell
        return True
    bound: float = (w_b ** (-1.0 / 3.0) + scratch.roots[i]) ** -3.0
    return bound * (1.0 + SLACK) >= least * search.rule.scale_b


@kernel
def touches_nothing(search: PostureSearch, c: int, scratch: PostureScratch) -> bool:
    """Whether the limbs touch nothing on the branches `trial` at base pose `c`."""
    robot, tried = search.robot, scratch.tried[c]
    for i in range(robot.limb_count):
        found = limb_status(search, tried, i, scratch.trial[i], scratch)
        if found != CLEAR:
            return False
    return apart(search, scratch)


@kernel
def _trial_bound(search: PostureSearch, tried: CandidatePose, scratch: PostureScratch) -> float:
    """Least `w_m` of the branches `trial` as a margin, 0 if one is known to touch something."""
    bound = np.inf
    for i in range(search.robot.limb_count):
        b = scratch.trial[i]
        bound = min(bound, tried.limbs[i].w[class_of(b)] if scratch.status[i, b] <= CLEAR else 0.0)
    return bound / search.rule.scale_m


@kernel
def _begin(count: int, scratch: PostureScratch) -> None:
    """Make `_next_hopeful` begin with the first combination."""
    scratch.digits[count - 1] = -1


@kernel
def _next_hopeful(
    search: PostureSearch,
    tried: CandidatePose,
    least: tuple[float, float],
    least_gap: float,
    depth: int,
    scratch: PostureScratch,
) -> bool:
    """Set `trial` to the next combination of `options` that may serve; whether there is one.

    Limb 0 runs fastest. Combinations are passed over together that share a branch whose `w_m` is
    below a margin or that is known to touch something, two branches that are known to touch or be
    near each other, or some with which `w_b` stays below a margin whatever the others are.

    Parameters
    ----------
    search
        What is searched.
    tried
        The base pose that is looked at.
    least
        The margins of `w_m` and of `w_b`.
    least_gap
        Distance up to which branches are near each other [m].
    depth
        The limb whose branch changes: the last to begin with, 0 after a combination.
    scratch
        Scratch.
    """
    limbs, i = search.robot.limb_count, depth
    if depth == 0:
        # What was found out of the last combination may rule out more than that.
        for k in range(1, limbs):
            if not _serves(search, tried, k, least[0], least_gap, scratch):
                i = k
    while i < limbs:
        scratch.digits[i] += 1
        if scratch.digits[i] >= scratch.option_count[i]:
            i += 1
            continue
        scratch.trial[i] = scratch.options[i, scratch.digits[i]]
        if not _serves(search, tried, i, least[0], least_gap, scratch):
            continue
        if not _may_reach(search, i, least[1], scratch):
            continue
        if i == 0:
            return True
        i -= 1
        scratch.digits[i] = -1
    return False


@kernel
def _serves(
    search: PostureSearch,
    tried: CandidatePose,
    i: int,
    least: float,
    least_gap: float,
    scratch: PostureScratch,
) -> bool:
    """Whether the branch `trial` of limb `i` may serve with those of the limbs after it."""
    b = scratch.trial[i]
    if tried.limbs[i].w[class_of(b)] < least * search.rule.scale_m or scratch.status[i, b] > CLEAR:
        return False
    for j in range(i + 1, search.robot.limb_count):
        c = scratch.trial[j]
        if scratch.pairs[i, b, j, c] > CLEAR or scratch.gaps[i, b, j, c] <= least_gap:
            return False
    to_itself: float = scratch.gaps[i, b, i, b]
    return to_itself > least_gap


@kernel
def _largest_margin(
    search: PostureSearch, floor: float, look: bool, scratch: PostureScratch
) -> float:
    """Largest margin above `floor` of all base poses and branches of one stance, or `floor`.

    With `look` only those count that touch nothing; they are checked when their margin would be the
    largest. `w_b` is formed only where `w_m` leaves room for a larger margin.
    """
    limbs, margin = search.robot.limb_count, floor
    for c in range(search.poses):
        scratch.tried[c].waiting = scratch.tried[c].bound
    while True:
        c = EMPTY
        for other in range(1, search.poses):
            if scratch.tried[other].waiting > scratch.tried[c].waiting:
                c = other
        tried = scratch.tried[c]
        top = tried.waiting
        if top <= margin or top <= 0.0:
            return margin
        tried.waiting = 0.0
        if not enter(search, c, margin, look, scratch):
            continue
        for turn in range(2):
            # The first round takes those whose least `w_m` is the largest there is.
            least, depth = top * (1.0 - TIE) if turn == 0 else 0.0, limbs - 1
            _begin(limbs, scratch)
            while margin < top:
                floors = max(least, margin), margin
                if not _next_hopeful(search, tried, floors, -np.inf, depth, scratch):
                    break
                depth = 0
                bound = _trial_bound(search, tried, scratch)
                if bound > margin and bound >= least:
                    found = min(bound, combined(limbs, scratch) / search.rule.scale_b)
                    if found > margin and (not look or touches_nothing(search, c, scratch)):
                        margin = found


@kernel
def _choose(search: PostureSearch, margin: float, scratch: PostureScratch, branch: Limbs) -> Chosen:
    """The posture that the rule takes of those that tie with the largest margin and touch nothing.

    They tie if their margin is `margin` within `TIE`. The rule takes that with the largest
    clearance of the robot to itself; of those within `CLEARANCE_TIE` the first, in the order of
    base poses and then of branch labels. `branch` is filled.
    """
    limbs, least = search.robot.limb_count, margin * (1.0 - TIE)
    chosen, gap, best_wb = NONE, -np.inf, 0.0
    look = margin == margin
    for c in range(search.poses):
        tried = scratch.tried[c]
        if tried.bound < least or not enter(search, c, least * (1.0 - TIE), look, scratch):
            continue
        depth, least_gap = limbs - 1, -np.inf
        _begin(limbs, scratch)
        while True:
            if chosen >= 0:
                least_gap = gap + CLEARANCE_TIE
            if not _next_hopeful(search, tried, (least, least), least_gap, depth, scratch):
                break
            depth = 0
            w_b = combined(limbs, scratch)
            if w_b / search.rule.scale_b >= least and touches_nothing(search, c, scratch):
                found = self_clearance(search.robot, gap, scratch)
                if chosen < 0 or found > gap + CLEARANCE_TIE:
                    chosen, gap, best_wb = c, found, w_b
                    for i in range(limbs):
                        branch[i] = scratch.trial[i]
    return Chosen(chosen, best_wb, margin)


@part
def best_posture(
    search: PostureSearch, floor: float, lazily: bool, scratch: PostureScratch, branch: Limbs
) -> Chosen:
    """The posture that the rule takes of those of a margin above `floor` that touch nothing.

    With `lazily` shapes are compared only where the margin is the largest of all, touching or not;
    what is found is the same. `branch` is filled.
    """
    chosen, w_b, seen = NONE, 0.0, floor
    for turn in range(2):
        look = turn > 0
        if not look and not lazily:
            continue
        margin = _largest_margin(search, floor, look, scratch)
        seen = max(seen, margin)
        if margin > floor:
            found = _choose(search, margin, scratch, branch)
            chosen, w_b = found.pose, found.w_b
        if chosen >= 0 or margin <= floor:
            break
    return Chosen(chosen, w_b, seen)
