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
from mlivr_gym.compiled.bit_sets import ALL, EMPTY, NO, YES
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.postures.base_poses import place, set_pose, set_stance, turn_to_first
from mlivr_gym.postures.branch_sets import remove_touching, set_branch_sets
from mlivr_gym.postures.gaps import PostureSearch
from mlivr_gym.postures.records import Posture, PostureScratch, PostureWorld
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
    scratch = scratch_rows[0]
    for k in range(start, stop):
        set_stance(world.points, world.rules[0], stances[k], scratch.geometry)
        _choose_alone(world, bases[min(k, len(bases) - 1)], out[k], scratch)


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
    scratch = scratch_rows[0]
    for k in range(start, stop):
        set_stance(world.points, world.rules[0], stances[k], scratch.geometry)
        touched, base = CLEAR, bases[min(k, len(bases) - 1)]
        for i in range(stances.shape[1]):
            touched = max(touched, world.causes[stances[k, i]])
        if world.rules[0].check_contacts and _may_hold(stances.shape[1], out[k]):
            _avoid_boxes(world, touched, base, out[k], scratch)
        _place(world, base, out[k], scratch)


@part
def _choose_alone(world: PostureWorld, base: Pose, out: Posture, scratch: PostureScratch) -> None:
    """Compute the posture of a stance by itself, with its branch sets."""
    robot, rule, grid, geometry = world.robots[0], world.rules[0], world.grid, scratch.geometry
    among_boxes, clearance = rule.check_contacts and rule.is_given, rule.thresholds.clearance
    least = clearance if among_boxes else 0.0
    search = PostureSearch(robot, rule, grid, geometry, base, least, among_boxes)
    gap = choose(search, rule.node_margin if rule.nodes_only else 0.0, out, scratch)
    was_node = out.is_node
    if rule.check_contacts and not among_boxes:
        search = PostureSearch(robot, rule, grid, geometry, base, clearance, among_boxes)
        if was_node and gap < clearance:
            choose(search, rule.node_margin, out, scratch)
    if out.is_node:
        _set_branches(search, out, scratch)
    elif not among_boxes and not was_node:
        # Nothing is too close to keep no clearance at all.
        search = PostureSearch(robot, rule, grid, geometry, base, -np.inf, among_boxes)
        choose(search, rule.node_margin, scratch.other, scratch)
        was_node = scratch.other.pose_number >= 0
    if was_node and not out.is_node:
        out.cause = SELF


@part
def _avoid_boxes(
    world: PostureWorld, touched: int, base: Pose, out: Posture, scratch: PostureScratch
) -> None:
    """Remove the branches of a posture that touch a box, and choose another one if it does itself.

    `touched` is the cause of a collision of a gripper, 0 for none.
    """
    robot, rule, grid, geometry = world.robots[0], world.rules[0], world.grid, scratch.geometry
    other, clearance = scratch.other, rule.thresholds.clearance
    if touched == CLEAR and not rule.is_given:
        # The base is compared with the boxes last, since its cause counts.
        search = PostureSearch(robot, rule, grid, geometry, base, clearance, NO)
        prepare_candidate(search, out.pose_number, scratch)
        touched = remove_touching(search, out, scratch)
        if touched != CLEAR:
            search = PostureSearch(robot, rule, grid, geometry, base, clearance, YES)
            choose(search, rule.node_margin, other, scratch)
            if other.is_node:
                _set_branches(search, other, scratch)
                if _may_hold(robot.limb_count, other):
                    _copy(robot.limb_count, other, out)
                    return
    if touched != CLEAR:
        out.cause = CLEAR if rule.is_given else touched
        for i in range(robot.limb_count):
            out.branch_sets[i] = EMPTY


@kernel
def _set_branches(search: PostureSearch, out: Posture, scratch: PostureScratch) -> None:
    """Set the branch sets of a node."""
    for i in range(search.robot.limb_count):
        out.branch_sets[i] = ALL
    if search.rule.check_branches:
        prepare_candidate(search, out.pose_number, scratch)
        set_branch_sets(search, out, scratch)


@kernel
def _may_hold(limbs: int, out: Posture) -> bool:
    """Return whether every limb has a branch on which it may hold."""
    every = True
    for i in range(limbs):
        every = every and out.branch_sets[i] != EMPTY
    return every


@part
def _place(world: PostureWorld, base: Pose, out: Posture, scratch: PostureScratch) -> None:
    """Put the limbs of a posture in their order, and its base into the world."""
    geometry, limbs, rule = scratch.geometry, world.robots[0].limb_count, world.rules[0]
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
