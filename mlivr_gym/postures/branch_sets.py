"""The branches on which each limb may hold at a posture (compiled)."""

from __future__ import annotations

from mlivr_gym.collisions.base_path import lift_path
from mlivr_gym.collisions.followers import followed_branches, set_follower
from mlivr_gym.collisions.intervals import WHOLE
from mlivr_gym.compiled.bit_sets import (
    ALL,
    BRANCHES,
    CLASSES,
    EMPTY,
    both_flips,
    has_branch,
    whole_class,
    without_branch,
)
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.postures.placed_limbs import PostureSearch, gap_between_limbs, limb_fits
from mlivr_gym.postures.records import Posture, PostureScratch
from mlivr_gym.postures.rule import base_manipulability, set_base, set_combination


@kernel
def set_branch_sets(search: PostureSearch, out: Posture, scratch: PostureScratch) -> None:
    """Set `out.branch_sets` to the branches and flips on which each limb may hold at a node.

    Where branches are not checked, it may hold on all. Otherwise, a branch of a limb belongs to its
    branch set if `w_m` meets the threshold, if the limb can depart along the surface normal on it
    with `w_m` above the floor and every joint in its window, if it touches nothing, and if every
    combination with branches of the other limbs meets the threshold of `w_b` and keeps the limbs
    apart. The branch sets thus form a product set; it grows from the branches of the posture, limb
    by limb and branch by branch. If the posture itself does not belong to it, all are empty.
    """
    limbs, is_allowed = search.robot.limb_count, True
    for i in range(limbs):
        out.branch_sets[i] = ALL
    if not search.rule.check_branches:
        return
    set_base(search, out.pose_number, 0.0, scratch)
    for i in range(limbs):
        out.branch_sets[i] = _departing(search, i, scratch)
        for b in range(BRANCHES):
            if has_branch(out.branch_sets[i], b) and not limb_fits(search, i, b, scratch):
                out.branch_sets[i] = without_branch(out.branch_sets[i], b)
        is_allowed &= has_branch(out.branch_sets[i], out.branch[i])
        scratch.options[i, 0], scratch.option_count[i] = out.branch[i], 1
    for i in range(limbs):
        kept = both_flips(out.branch[i]) if is_allowed else EMPTY
        for b in range(BRANCHES):
            is_other = b != out.branch[i] and has_branch(out.branch_sets[i], b)
            if is_allowed and is_other and _fits_all(search, i, b, scratch):
                kept |= both_flips(b)
                scratch.options[i, scratch.option_count[i]] = b
                scratch.option_count[i] += 1
        out.branch_sets[i] &= kept


@part
def _departing(search: PostureSearch, i: int, scratch: PostureScratch) -> int:
    """Return the branches and flips on which limb `i` holds with `w_m` and can depart."""
    robot, limits, lines, branch_set = search.robot, search.rule.thresholds, scratch.lines, EMPTY
    for c in range(CLASSES):
        w = scratch.w_m[i, c]
        if w >= limits.w_m and w >= limits.floor and w > 0.0:
            branch_set |= whole_class(c)
    grasp = search.geometry.grasps[i]
    lift_path(lines.line.path, scratch.base, grasp, robot.lift)
    lines.floor = limits.floor * robot.characteristic_length**3
    set_follower(i, grasp.flange, lines)
    return followed_branches(i, branch_set, WHOLE, robot, search.grid, lines)


@part
def _fits_all(search: PostureSearch, i: int, b: int, scratch: PostureScratch) -> bool:
    """Return whether branch `b` of limb `i` fits all combinations of the others' options."""
    limbs, count, combinations = search.robot.limb_count, scratch.option_count, 1
    for j in range(limbs):
        for k in range(count[j] if j != i else 0):
            c = scratch.options[j, k]
            if gap_between_limbs(search, i, b, j, c, scratch) < search.clearance:
                return False
    # Limb `i` has this branch alone for a moment.
    first, kept = scratch.options[i, 0], count[i]
    scratch.options[i, 0], count[i] = b, 1
    for j in range(limbs):
        combinations *= count[j]
    fits = True
    for number in range(combinations):
        set_combination(limbs, number, scratch)
        fits = fits and base_manipulability(limbs, scratch) >= search.rule.thresholds.w_b
    scratch.options[i, 0], count[i] = first, kept
    return fits
