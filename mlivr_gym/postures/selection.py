"""Computation of the postures of many stances (compiled).

The rule applies to the robot alone at first; then what it chose is compared with the boxes. Only
where it touches one, the rule applies to what touches none.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.distances import CLEAR, SELF
from mlivr_gym.compiled.bit_sets import ALL, EMPTY, NO, YES, class_of
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.postures.base_poses import place, pose_count, set_pose, set_stance, turn_to_first
from mlivr_gym.postures.branch_sets import remove_touching, set_branch_sets
from mlivr_gym.postures.reach import evaluate_reach
from mlivr_gym.postures.records import Posture, PostureScratch, PostureSearch, PostureWorld
from mlivr_gym.postures.rule import Choice, choose, prepare_candidate


@entry
def solve_postures(
    start: int,
    stop: int,
    stances: IntArray,
    bases: Any,
    world: PostureWorld,
    out: Any,
    scratch_rows: Any,
) -> None:
    """Compute the posture of each stance from `start` to `stop`, excluded.

    `stances` are point indices, shape (k, N), `out` records of `Posture`, initially zero, shape
    (k,). `bases` are records of `Pose` in the world, shape (k,), if the rule has them given.
    """
    scratch = scratch_rows[0]
    for k in range(start, stop):
        set_stance(world.points, world.rules[0].poses, stances[k], scratch.geometry)
        chosen = _solve(world, stances[k], bases[min(k, len(bases) - 1)], scratch)
        _write(world, scratch.postures[chosen], out[k], scratch)


@part
def _solve(world: PostureWorld, stance: IntArray, base: Pose, scratch: PostureScratch) -> int:
    """Compute the posture of a stance; return its index in `scratch.postures`."""
    robot, rule, geometry, grid = world.robots[0], world.rules[0], scratch.geometry, world.grid
    out, clearance = scratch.postures[0], rule.thresholds.clearance
    count = _evaluate_candidates(world, base, scratch)
    any_ = PostureSearch(robot, geometry, rule, count, -np.inf, grid, NO)
    loose = PostureSearch(robot, geometry, rule, count, 0.0, grid, NO)
    apart = PostureSearch(robot, geometry, rule, count, clearance, grid, NO)
    free = PostureSearch(robot, geometry, rule, count, clearance, grid, YES)
    check, is_given = rule.check_contacts, rule.poses.is_given
    search = free if check and is_given else loose
    choice = _apply(search, rule.node_margin if rule.nodes_only else 0.0, out, scratch)
    if check and not is_given:
        search = apart
        if out.is_node and choice.gap < clearance:
            _apply(apart, rule.node_margin, out, scratch)
    other = scratch.postures[1]
    if not out.is_node:
        if not (check and is_given) and _apply(any_, rule.node_margin, other, scratch).pose >= 0:
            out.cause = SELF
        return 0
    _set_branches(search, out, scratch)
    touched = CLEAR
    for i in range(robot.limb_count):
        touched = max(touched, world.causes[stance[i]])
    if not check or not _may_hold(robot.limb_count, out) or (is_given and touched == CLEAR):
        return 0
    if touched == CLEAR:
        touched = remove_touching(apart, out, scratch)
        if touched == CLEAR:
            return 0
        _apply(free, rule.node_margin, other, scratch)
        if other.is_node:
            _set_branches(free, other, scratch)
            if _may_hold(robot.limb_count, other):
                return 1
    for i in range(robot.limb_count):
        out.branch_sets[i] = EMPTY
    out.cause = CLEAR if is_given else touched
    return 0


@part
def _evaluate_candidates(world: PostureWorld, base: Pose, scratch: PostureScratch) -> int:
    """Set up the candidate base poses of a stance and return their number."""
    rule, geometry, count = world.rules[0], scratch.geometry, 1
    floor = rule.node_margin * rule.scale_m if rule.nodes_only else 0.0
    if not rule.poses.is_given:
        count = pose_count(geometry, rule.poses)
    for c in range(count):
        candidate = scratch.candidates[c]
        if rule.poses.is_given:
            place(geometry, base, candidate.base)  # the frame of the stance is the world
        else:
            set_pose(geometry, rule.poses, c, candidate.base)
        reach = evaluate_reach(world.robots[0], geometry, floor, candidate, scratch.terms)
        candidate.margin_bound = reach / rule.scale_m
    return count


@kernel
def _apply(search: PostureSearch, floor: float, out: Posture, scratch: PostureScratch) -> Choice:
    """Apply the rule, and store the posture that it chooses without its branch sets."""
    robot, limits = search.robot, search.rule.thresholds
    choice = choose(search, floor, scratch, out.branch)
    is_node = choice.pose >= 0 and choice.w_b >= limits.w_b
    for i in range(robot.limb_count):
        out.w_m[i], out.branch_sets[i] = 0.0, EMPTY
        if choice.pose < 0:
            out.branch[i] = EMPTY
        else:
            out.w_m[i] = scratch.candidates[choice.pose].limbs[i].w[class_of(out.branch[i])]
        is_node = is_node and out.w_m[i] >= limits.w_m
    out.w_b, out.pose_number, out.cause, out.is_node = choice.w_b, choice.pose, CLEAR, is_node
    return choice


@kernel
def _set_branches(search: PostureSearch, out: Posture, scratch: PostureScratch) -> None:
    """Set the branch sets of a node."""
    prepare_candidate(search, out.pose_number, np.inf, scratch)
    for i in range(search.robot.limb_count):
        out.branch_sets[i] = ALL
    if search.rule.check_branches:
        set_branch_sets(search, out, scratch)


@kernel
def _may_hold(limbs: int, out: Posture) -> bool:
    """Return whether every limb has a branch on which it may hold."""
    for i in range(limbs):
        if out.branch_sets[i] == EMPTY:
            return False
    return True


@part
def _write(world: PostureWorld, found: Posture, out: Posture, scratch: PostureScratch) -> None:
    """Write a posture in the order of the limbs, with its base in the world."""
    geometry, limbs, rule = scratch.geometry, world.robots[0].limb_count, world.rules[0].poses
    for i in range(limbs):
        limb = (geometry.first + i) % limbs
        out.w_m[limb], out.branch[limb] = found.w_m[i], found.branch[i]
        out.branch_sets[limb] = found.branch_sets[i]
    out.w_b, out.cause = found.w_b, found.cause
    out.pose_number = -1 if rule.is_given else found.pose_number
    if found.pose_number >= 0 or rule.is_given:
        place(geometry, scratch.candidates[max(found.pose_number, 0)].base, out.base)
        turn_to_first(geometry, rule, out.base)
