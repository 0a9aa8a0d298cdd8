"""The branches on which each limb may hold at a posture (compiled)."""

from __future__ import annotations

from mlivr_gym.collisions.against_boxes import compare_base_with_boxes
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.followers import followed_branches, set_follower
from mlivr_gym.compiled.bit_sets import (
    BRANCHES,
    CLASSES,
    EMPTY,
    both_flips,
    has_branch,
    whole_class,
    without_branch,
)
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.kinematics.base_path import lift_path
from mlivr_gym.kinematics.chain import FlangeAxis
from mlivr_gym.kinematics.manipulability import inverse_root_determinant, limb_information
from mlivr_gym.kinematics.poses import vector
from mlivr_gym.postures.gaps import PostureSearch, cause_at_boxes, limb_gap, pair_gap, place_limb
from mlivr_gym.postures.records import Posture, PostureScratch
from mlivr_gym.postures.rule import next_combination


@kernel
def set_branch_sets(search: PostureSearch, out: Posture, scratch: PostureScratch) -> None:
    """Set `out.branch_sets` to the branches and flips on which each limb may hold at a posture.

    Its base pose must have been prepared, see `prepare_candidate`.

    A branch of a limb belongs to its branch set if `w_m` meets the threshold, if the limb can
    depart along the surface normal on it with `w_m` above the floor and every joint in its window,
    if it touches nothing, and if every combination with branches of the other limbs meets the
    threshold of `w_b` and keeps the limbs apart. The branch sets thus form a product set; it grows
    from the branches of the posture, limb by limb and branch by branch. If the posture itself does
    not belong to it, all are empty.
    """
    robot, limits, l_c = search.robot, search.rule.thresholds, search.robot.characteristic_length
    candidate, is_allowed = scratch.candidate, True
    for i in range(robot.limb_count):
        limb, reach, grasp = robot.limbs[i], candidate.limbs[i], search.geometry.grasps[i]
        flange, branch_set = FlangeAxis(vector(reach.p), vector(reach.z)), EMPTY
        for c in range(CLASSES):
            w = reach.w[c]
            if w >= limits.w_m and w >= limits.floor and w > 0.0:
                branch_set |= whole_class(c)
        lift_path(scratch.lines.line.path, candidate.base, grasp, robot.lift)
        scratch.lines.floor = limits.floor * l_c**3
        set_follower(i, grasp.flange, scratch.lines)
        branch_set = followed_branches(i, branch_set, robot, search.grid, scratch.lines)
        for b in range(BRANCHES):
            if has_branch(branch_set, b):
                if limb_gap(search, i, b, scratch) < search.clearance:
                    branch_set = without_branch(branch_set, b)
                else:
                    information = scratch.information[i, b]
                    limb_information(limb, flange, b, l_c, scratch.inversion, information)
        out.branch_sets[i] = branch_set
        is_allowed &= has_branch(branch_set, out.branch[i])
        scratch.options[i, 0], scratch.option_count[i] = out.branch[i], 1
    for i in range(robot.limb_count):
        kept = both_flips(out.branch[i]) if is_allowed else EMPTY
        for b in range(BRANCHES):
            if (
                is_allowed
                and b != out.branch[i]
                and has_branch(out.branch_sets[i], b)
                and _fits_all(search, i, b, scratch)
            ):
                kept |= both_flips(b)
                scratch.options[i, scratch.option_count[i]] = b
                scratch.option_count[i] += 1
        out.branch_sets[i] &= kept


@part
def _fits_all(search: PostureSearch, i: int, b: int, scratch: PostureScratch) -> bool:
    """Return whether branch `b` of limb `i` fits all combinations of the others' options."""
    limbs, count = search.robot.limb_count, scratch.option_count
    for j in range(limbs):
        for k in range(count[j]):
            if j != i:
                gap = pair_gap(search, i, b, j, scratch.options[j, k], scratch)
                if gap < search.clearance:
                    return False
    # Limb `i` has this branch alone for a moment.
    first, kept = scratch.options[i, 0], count[i]
    scratch.options[i, 0], count[i] = b, 1
    fits, limb = True, limbs
    while fits and next_combination(search, 0.0, limb, scratch):
        limb = EMPTY
        fits = inverse_root_determinant(scratch.sums[0]) >= search.rule.thresholds.w_b
    scratch.options[i, 0], count[i] = first, kept
    return fits


@part
def remove_touching(search: PostureSearch, out: Posture, scratch: PostureScratch) -> int:
    """Remove the branches that touch a box from the branch sets of a posture.

    Returned is the cause of a collision of the posture itself, 0 for none. Where branches are not
    checked, only that is found.
    """
    robot, cause = search.robot, CLEAR
    check_branches = search.rule.check_branches
    at_base = compare_base_with_boxes(
        robot, scratch.base, search.grid, search.clearance, scratch.surface
    )
    if at_base != CLEAR:
        cause = int(at_base)
    for i in range(robot.limb_count):
        for b in range(BRANCHES):
            is_chosen = b == out.branch[i]
            if at_base != CLEAR:
                if check_branches:
                    out.branch_sets[i] = EMPTY
            elif is_chosen or (check_branches and has_branch(out.branch_sets[i], b)):
                place_limb(search, i, b, scratch)
                result = cause_at_boxes(search, i, b, scratch)
                if result != CLEAR and check_branches:
                    out.branch_sets[i] = without_branch(out.branch_sets[i], b)
                if result != CLEAR and is_chosen:
                    cause = result
    return cause
