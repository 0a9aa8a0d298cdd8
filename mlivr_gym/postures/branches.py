"""Evaluation of the inverse-kinematics branches at one base pose (compiled).

This file computes what a limb touches on a branch, `w_b` and the clearance of a combination of
branches, and the branch sets of the branches on which each limb may hold.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mlivr_gym.collisions.against_boxes import compare_limb_with_boxes, set_grasp_surface
from mlivr_gym.collisions.against_robot import (
    compare_limb_with_body,
    compare_limb_with_itself,
    compare_limbs,
    has_separating_plane,
)
from mlivr_gym.collisions.distances import (
    CLEAR,
    segment_box_distance_squared,
    segment_distance_squared,
)
from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.collisions.placement import Shapes, axis_of, capsule_axis, place, place_in_world
from mlivr_gym.compiled.bit_sets import (
    BRANCHES,
    CLASSES,
    EMPTY,
    EVERY,
    below,
    both_flips,
    has_branch,
    whole_class,
)
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.kinematics.arm import FlangeAxis
from mlivr_gym.kinematics.base_path import lift_path
from mlivr_gym.kinematics.families import branch_frames
from mlivr_gym.kinematics.holding import held_branches
from mlivr_gym.kinematics.manipulability import inverse_root_determinant, limb_information
from mlivr_gym.kinematics.poses import along, minus, vector
from mlivr_gym.postures.records import (
    CandidatePose,
    Posture,
    PostureScratch,
    PostureSearch,
    StanceGeometry,
)

if TYPE_CHECKING:
    from mlivr_gym.values import Triple


@kernel
def combined_w_b(count: int, scratch: PostureScratch) -> float:
    """Return `w_b` of the first `count` limbs on the branches in `scratch.combination`."""
    work = scratch.work
    for row in range(6):
        for col in range(row + 1):
            total = 0.0
            for i in range(count):
                total += scratch.information[i, scratch.combination[i], row, col]
            work[0, row, col] = total
    return inverse_root_determinant(work)


@kernel
def forget_checks(count: int, scratch: PostureScratch) -> None:
    """Mark all stored collision results and gaps of branches as unknown."""
    for i in range(count):
        for b in range(BRANCHES):
            scratch.status[i, b] = -1
            for j in range(count):
                for c in range(BRANCHES):
                    scratch.pairs[i, b, j, c] = -1
                    scratch.gaps[i, b, j, c] = np.inf


@kernel
def limb_status(
    search: PostureSearch, candidate: CandidatePose, i: int, b: int, scratch: PostureScratch
) -> int:
    """Return what limb `i` on branch `b` touches at `scratch.base`, other limbs excluded.

    `candidate` has the flange poses of the limbs at the base pose. The result of
    `collisions.distances` is stored in the scratch; it is not `CLEAR` if the branch does not exist.
    """
    if scratch.status[i, b] >= 0:
        return int(scratch.status[i, b])
    robot, clearance = search.robot, search.clearance
    limb, limb_reach, shapes = robot.limbs[i], candidate.limbs[i], scratch.in_body[i, b]
    result = CLEAR + 1
    placed, axes = scratch.placed, scratch.inversion.axes
    flange = FlangeAxis(vector(limb_reach.p), vector(limb_reach.z))
    if branch_frames(limb.arm, flange, b, axes, placed.frames):
        place(limb, placed.frames, shapes)
        result, _ = compare_limb_with_itself(limb, shapes, placed, EVERY, clearance)
        if result == CLEAR:
            result, _ = compare_limb_with_body(robot, limb, shapes, EVERY, clearance)
        if result == CLEAR:
            place_in_world(limb, scratch.base, shapes, scratch.in_world)
            allow_surface(search.geometry, i, scratch)
            # What is on the flange axis does not depend on the posture: see `queries.check_points`.
            pending = below(limb.first_on_axis)
            result, _ = compare_limb_with_boxes(
                limb, scratch.in_world, pending, search.grid, clearance, scratch.surface
            )
    scratch.status[i, b] = result
    return result


@kernel
def allow_surface(geometry: StanceGeometry, i: int, scratch: PostureScratch) -> None:
    """Let the gripper of limb `i` touch the boxes behind the surface at its grasp."""
    grasp = geometry.grasps[i]
    point = along(vector(geometry.centre), 1.0, vector(grasp.point))
    set_grasp_surface(scratch.surface, point, vector(grasp.normal))


@kernel
def pair_status(
    search: PostureSearch, i: int, b: int, j: int, c: int, scratch: PostureScratch
) -> int:
    """Return the result of comparing limb `i` on branch `b` with limb `j` on branch `c`.

    Both must have been placed by `limb_status`. The result is looked up or computed.
    """
    if scratch.pairs[i, b, j, c] < 0:
        first, second = search.robot.limbs[i], search.robot.limbs[j]
        shapes, others = scratch.in_body[i, b], scratch.in_body[j, c]
        result, _ = compare_limbs(first, shapes, second, others, EVERY, search.clearance)
        scratch.pairs[i, b, j, c] = scratch.pairs[j, c, i, b] = result
    return int(scratch.pairs[i, b, j, c])


@part
def limbs_keep_apart(search: PostureSearch, scratch: PostureScratch) -> bool:
    """Return whether the limbs keep the clearance from each other in `scratch.combination`."""
    for i in range(search.robot.limb_count):
        for j in range(i):
            b, c = scratch.combination[i], scratch.combination[j]
            if pair_status(search, i, b, j, c, scratch) != CLEAR:
                return False
    return True


@kernel
def _limb_self_gap(robot: RobotModel, limb: LimbModel, shapes: Shapes, least: float) -> float:
    """Return the smallest distance of a limb's links from each other and from the body [m].

    The body includes the capsules fixed to it; `shapes` are in the body frame. If the distance is
    below `least`, any number below `least` may be returned.
    """
    gap, ends = np.inf, shapes.ends
    for k in range(limb.pair_count):
        i, j = limb.pairs[k, 0], limb.pairs[k, 1]
        radii = limb.capsules[i].radius + limb.capsules[j].radius
        gap = min(gap, _capsule_gap(axis_of(ends, i), axis_of(ends, j), radii, gap))
    for c in range(limb.capsule_count):
        capsule = limb.capsules[c]
        if gap < least:
            return gap
        if capsule.link < 2:
            continue
        axis = axis_of(ends, c)
        square = segment_box_distance_squared(axis[0], minus(axis[1], axis[0]), vector(robot.half))
        gap = min(gap, np.sqrt(square) - capsule.radius)
        for m in range(robot.mount_count):
            if capsule.link >= limb.first_link[m]:
                mount = robot.mounts[m]
                radii = capsule.radius + mount.radius
                gap = min(gap, _capsule_gap(axis, capsule_axis(mount.ends), radii, gap))
    return gap


@kernel
def _capsule_gap(
    first: tuple[Triple, Triple], second: tuple[Triple, Triple], radii: float, gap: float
) -> float:
    """Return the distance between two capsules [m], or `gap` if it is known not to be smaller."""
    if has_separating_plane(first, second, gap + radii):
        return gap
    (p, p_end), (q, q_end) = first, second
    distance: float = (
        np.sqrt(segment_distance_squared(p, minus(p_end, p), q, minus(q_end, q))) - radii
    )
    return distance


@kernel
def self_clearance(robot: RobotModel, least: float, scratch: PostureScratch) -> float:
    """Return the smallest distance between two shapes of the robot in `scratch.combination` [m].

    It is negative where they penetrate; `contacts.contacts` is the plain definition. If the
    distance is below `least` [m], any number below `least` may be returned.
    """
    gap = np.inf
    for i in range(robot.limb_count):
        for j in range(i + 1):
            if gap < least:
                return gap
            b, c = scratch.combination[i], scratch.combination[j]
            if scratch.gaps[i, b, j, c] == np.inf:
                first, shapes = robot.limbs[i], scratch.in_body[i, b]
                if j == i:
                    result = _limb_self_gap(robot, first, shapes, least)
                else:
                    others = scratch.in_body[j, c]
                    result = _limb_pair_gap(first, shapes, robot.limbs[j], others, least)
                scratch.gaps[i, b, j, c] = scratch.gaps[j, c, i, b] = result
            gap = min(gap, scratch.gaps[i, b, j, c])
    return gap


@kernel
def _limb_pair_gap(
    limb: LimbModel, shapes: Shapes, other: LimbModel, others: Shapes, least: float
) -> float:
    """Return the smallest distance between two limbs [m].

    If it is below `least`, any number below `least` may be returned.
    """
    gap = np.inf
    for a in range(limb.capsule_count):
        axis = axis_of(shapes.ends, a)
        for b in range(other.capsule_count):
            if gap < least:
                return gap
            radii = limb.capsules[a].radius + other.capsules[b].radius
            gap = min(gap, _capsule_gap(axis, axis_of(others.ends, b), radii, gap))
    return gap


@part
def set_branch_sets(
    search: PostureSearch, candidate: CandidatePose, scratch: PostureScratch, out: Posture
) -> None:
    """Set `out.branch_sets` to the branches and flips on which each limb may hold at a posture.

    A branch of a limb belongs to its branch set if `w_m` meets the threshold, if the limb can
    depart along the surface normal on it with `w_m` above the floor and every joint in its window,
    if it touches nothing, and if every combination with branches of the other limbs meets the
    threshold of `w_b` and keeps the limbs apart. The branch sets thus form a product set; it grows
    from the branches of the posture in a fixed order.
    """
    robot, geometry, limits = search.robot, search.geometry, search.rule.thresholds
    l_c = robot.characteristic_length
    for i in range(robot.limb_count):
        limb, limb_reach, grasp = robot.limbs[i], candidate.limbs[i], geometry.grasps[i]
        branch_set = EMPTY
        for c in range(CLASSES):
            w = limb_reach.w[c]
            if w >= limits.w_m and w >= limits.floor and w > 0.0:
                branch_set |= whole_class(c)
        lift_path(scratch.path, out.base, grasp, robot.lift)
        floor = limits.floor * l_c**3
        branch_set = held_branches(
            limb, grasp.flange, scratch.path, floor, branch_set, scratch.holding
        )
        out.branch_sets[i] = branch_set
        for b in range(BRANCHES):
            scratch.kept[i, b] = False
            scratch.allowed[i, b] = (
                has_branch(branch_set, b) and limb_status(search, candidate, i, b, scratch) == CLEAR
            )
            if scratch.allowed[i, b]:
                flange = FlangeAxis(vector(limb_reach.p), vector(limb_reach.z))
                limb_information(
                    limb,
                    flange,
                    b,
                    l_c,
                    scratch.inversion,
                    scratch.information[i, b],
                )
    _grow_product(search, out, scratch)
    for i in range(robot.limb_count):
        kept = EMPTY
        for b in range(BRANCHES):
            if scratch.kept[i, b]:
                kept |= both_flips(b)
        out.branch_sets[i] &= kept


@kernel
def _grow_product(search: PostureSearch, posture: Posture, scratch: PostureScratch) -> None:
    """Grow the product set of branches from those of a posture, one branch at a time.

    Every combination in it meets the threshold of `w_b` and keeps the limbs apart. `scratch.kept`
    marks its branches.
    """
    robot = search.robot
    for i in range(robot.limb_count):
        if not scratch.allowed[i, posture.branch[i]]:
            return
    for i in range(robot.limb_count):
        scratch.kept[i, posture.branch[i]] = True
    for i in range(robot.limb_count):
        for b in range(BRANCHES):
            if scratch.allowed[i, b] and not scratch.kept[i, b]:
                scratch.kept[i, b] = _fits_all(search, i, b, scratch)


@part
def _fits_all(search: PostureSearch, i: int, b: int, scratch: PostureScratch) -> bool:
    """Return whether branch `b` of limb `i` fits all combinations of the others' branches kept."""
    robot, w_b = search.robot, search.rule.thresholds.w_b
    for j in range(robot.limb_count):
        scratch.option_count[j] = 0
        for c in range(BRANCHES):
            if (j == i and c == b) or (j != i and scratch.kept[j, c]):
                if j != i and pair_status(search, i, b, j, c, scratch) != CLEAR:
                    return False
                scratch.options[j, scratch.option_count[j]] = c
                scratch.option_count[j] += 1
    more = first_combination(robot.limb_count, scratch)
    while more:
        if combined_w_b(robot.limb_count, scratch) < w_b:
            return False
        more = next_combination(robot.limb_count, scratch)
    return True


@kernel
def first_combination(count: int, scratch: PostureScratch) -> bool:
    """Set `scratch.combination` to the first one of the options; return whether there is one."""
    for i in range(count):
        if scratch.option_count[i] == 0:
            return False
        scratch.option_index[i], scratch.combination[i] = 0, scratch.options[i, 0]
    return True


@kernel
def next_combination(count: int, scratch: PostureScratch) -> bool:
    """Set `scratch.combination` to the next one, limb 0 first; return whether there is one."""
    for i in range(count):
        scratch.option_index[i] += 1
        if scratch.option_index[i] < scratch.option_count[i]:
            scratch.combination[i] = scratch.options[i, scratch.option_index[i]]
            return True
        scratch.option_index[i], scratch.combination[i] = 0, scratch.options[i, 0]
    return False
