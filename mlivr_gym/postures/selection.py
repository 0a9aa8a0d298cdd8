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
from mlivr_gym.compiled.bit_sets import EMPTY, NO, YES
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.postures.base_poses import set_stance
from mlivr_gym.postures.branch_sets import remove_touching, set_branch_sets
from mlivr_gym.postures.placed_limbs import PostureSearch
from mlivr_gym.postures.records import PostureWorld
from mlivr_gym.postures.rule import choose


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

    `stances` are point indices, shape (k, N), `out` records of `Posture`, shape (k,). `bases` are
    records of `Pose` in the world, shape (k,), if the rule has them given: then the boxes count.
    """
    robot, rule, grid, scratch = world.robots[0], world.rules[0], world.grid, scratch_rows[0]
    geometry, floor, boxes = scratch.geometry, rule.node_margin, rule.check_contacts & rule.is_given
    clearance = rule.thresholds.clearance if rule.check_contacts else 0.0
    for k in range(start, stop):
        given, posture = bases[min(k, len(bases) - 1)], out[k]
        set_stance(world.points, rule, stances[k], geometry)
        least = clearance if boxes else 0.0
        search = PostureSearch(robot, rule, grid, geometry, given, least, boxes)
        gap = choose(search, floor if rule.nodes_only else 0.0, posture, scratch)
        was_node = posture.is_node
        search = PostureSearch(robot, rule, grid, geometry, given, clearance, boxes)
        if was_node and gap < clearance:
            choose(search, floor, posture, scratch)
        if posture.is_node:
            set_branch_sets(search, posture, scratch)
        elif not boxes and not was_node:
            # Nothing is too close to keep no clearance at all.
            search = PostureSearch(robot, rule, grid, geometry, given, -np.inf, boxes)
            choose(search, floor, scratch.other, scratch)
            was_node = scratch.other.pose_number >= 0
        if was_node and not posture.is_node:
            posture.cause = SELF


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
    """Remove the branches that touch a box from postures that `out` has as they are by themselves.

    If a posture touches one itself, another is chosen that does not, else its branch sets are
    empty. The arguments are those of `solve_alone`.
    """
    robot, rule, grid, scratch = world.robots[0], world.rules[0], world.grid, scratch_rows[0]
    geometry, clearance, other = scratch.geometry, rule.thresholds.clearance, scratch.other
    for k in range(start, stop):
        set_stance(world.points, rule, stances[k], geometry)
        given, posture = bases[0], out[k]
        search = PostureSearch(robot, rule, grid, geometry, given, clearance, NO)
        cause = remove_touching(search, posture, scratch)
        if cause == CLEAR:
            continue
        search = PostureSearch(robot, rule, grid, geometry, given, clearance, YES)
        choose(search, rule.node_margin, other, scratch)
        if other.is_node:
            set_branch_sets(search, other, scratch)
        if other.branch_sets[0] != EMPTY:
            out[k] = other
        else:
            posture.cause = cause
            for i in range(robot.limb_count):
                posture.branch_sets[i] = EMPTY
