"""Computation of the postures of many stances (compiled).

The rule applies to the robot alone at first, once for all stances of the same relative geometry.
Then what it chose is compared with the boxes around each stance, and only where that touches one,
the rule applies to what touches none.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.distances import CLEAR, SELF
from mlivr_gym.compiled.bit_sets import ALL, EMPTY, YES
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.postures.base_poses import place, pose_count, set_pose, set_stance, turn_to_first
from mlivr_gym.postures.branch_sets import remove_touching, set_branch_sets
from mlivr_gym.postures.reach import evaluate_reach
from mlivr_gym.postures.records import Posture, PostureScratch, PostureSearch, PostureWorld
from mlivr_gym.postures.rule import choose, prepare_candidate


@entry
def solve_alone(
    start: int,
    stop: int,
    stances: IntArray,
    bases: Any,
    world: PostureWorld,
    out: Any,
    scratch_rows: Any,
) -> None:
    """Compute the postures of stances by themselves, from `start` to `stop`, excluded.

    `stances` are point indices, shape (k, N), `out` records of `Posture`, shape (k,), without base
    poses. `bases` are records of `Pose` in the world, shape (k,), if the rule has them given: then
    the boxes count from the beginning.
    """
    scratch, rule = scratch_rows[0], world.rules[0]
    for k in range(start, stop):
        set_stance(world.points, rule.poses, stances[k], scratch.geometry)
        count = _evaluate_candidates(world, bases[min(k, len(bases) - 1)], scratch)
        _choose_alone(world, count, out[k], scratch)


@entry
def solve_among_boxes(
    start: int,
    stop: int,
    stances: IntArray,
    bases: Any,
    world: PostureWorld,
    out: Any,
    scratch_rows: Any,
) -> None:
    """Complete the postures of stances, which `out` has as they are by themselves."""
    scratch, rule = scratch_rows[0], world.rules[0]
    for k in range(start, stop):
        set_stance(world.points, rule.poses, stances[k], scratch.geometry)
        touched = CLEAR
        for i in range(stances.shape[1]):
            touched = max(touched, world.causes[stances[k, i]])
        _avoid_boxes(world, touched, out[k], scratch)
        _place(world, bases[min(k, len(bases) - 1)], out[k], scratch)


@kernel
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


@part
def _choose_alone(
    world: PostureWorld, count: int, out: Posture, scratch: PostureScratch
) -> None:
    """Compute the posture of a stance by itself, with the causes of collisions and branch sets."""
    robot, rule, grid, geometry = world.robots[0], world.rules[0], world.grid, scratch.geometry
    among_boxes, clearance = rule.check_contacts and rule.poses.is_given, rule.thresholds.clearance
    least = clearance if among_boxes else 0.0
    search = PostureSearch(robot, geometry, rule, count, least, grid, among_boxes)
    gap = choose(search, rule.node_margin if rule.nodes_only else 0.0, out, scratch)
    was_node = out.is_node
    if rule.check_contacts and not among_boxes:
        search = PostureSearch(robot, geometry, rule, count, clearance, grid, among_boxes)
        if was_node and gap < clearance:
            choose(search, rule.node_margin, out, scratch)
    if out.is_node:
        _set_branches(search, out, scratch)
    elif not among_boxes and not was_node:
        # Of no clearance at all everything keeps it.
        search = PostureSearch(robot, geometry, rule, count, -np.inf, grid, among_boxes)
        choose(search, rule.node_margin, scratch.other, scratch)
        was_node = scratch.other.pose_number >= 0
    if was_node and not out.is_node:
        out.cause = SELF


@part
def _avoid_boxes(
    world: PostureWorld, touched: int, out: Posture, scratch: PostureScratch
) -> None:
    """Remove the branches of a posture that touch a box, and choose another one if it does itself.

    `touched` is the cause of a collision of a gripper, 0 for none.
    """
    robot, rule, grid, geometry = world.robots[0], world.rules[0], world.grid, scratch.geometry
    is_given, clearance = rule.poses.is_given, rule.thresholds.clearance
    if not rule.check_contacts or not _may_hold(robot.limb_count, out):
        return
    if touched == CLEAR:
        if is_given:
            return
        candidate = scratch.candidates[out.pose_number]
        set_pose(geometry, rule.poses, out.pose_number, candidate.base)
        evaluate_reach(robot, geometry, 0.0, candidate, scratch.terms)
        place(geometry, candidate.base, scratch.base)
        search = PostureSearch(robot, geometry, rule, 1, clearance, grid, YES)
        touched = remove_touching(search, out, scratch)
        if touched == CLEAR:
            return
        count, other = _evaluate_candidates(world, scratch.base, scratch), scratch.other
        free = PostureSearch(robot, geometry, rule, count, clearance, grid, YES)
        choose(free, rule.node_margin, other, scratch)
        if other.is_node:
            _set_branches(free, other, scratch)
            if _may_hold(robot.limb_count, other):
                _copy(robot.limb_count, other, out)
                return
    for i in range(robot.limb_count):
        out.branch_sets[i] = EMPTY
    if not is_given:
        out.cause = touched


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
def _place(world: PostureWorld, base: Pose, out: Posture, scratch: PostureScratch) -> None:
    """Put the limbs of a posture in their order, and its base into the world."""
    geometry, limbs, rule = scratch.geometry, world.robots[0].limb_count, world.rules[0].poses
    found = scratch.other
    _copy(limbs, out, found)
    for i in range(limbs):
        limb = (geometry.first + i) % limbs
        out.w_m[limb], out.branch[limb] = found.w_m[i], found.branch[i]
        out.branch_sets[limb] = found.branch_sets[i]
    if rule.is_given:
        place(geometry, base, out.base)
        out.pose_number = -1
    elif found.pose_number >= 0:
        set_pose(geometry, rule, found.pose_number, out.base)
        place(geometry, out.base, out.base)
        turn_to_first(geometry, rule, out.base)


@kernel
def _copy(limbs: int, found: Posture, out: Posture) -> None:
    """Copy what the rule says of a stance."""
    out.pose_number, out.w_b, out.cause = found.pose_number, found.w_b, found.cause
    for i in range(limbs):
        out.w_m[i], out.branch[i] = found.w_m[i], found.branch[i]
        out.branch_sets[i] = found.branch_sets[i]
