"""Computation of the postures of many stances (compiled)."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.distances import SELF
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.postures.base_poses import set_stance
from mlivr_gym.postures.branch_sets import set_branch_sets
from mlivr_gym.postures.placed_limbs import PostureSearch
from mlivr_gym.postures.records import PostureWorld
from mlivr_gym.postures.rule import choose


@entry
def solve_all(
    start: int,
    stop: int,
    stances: IntArray,
    bases: Any,
    world: PostureWorld,
    out: Any,
    scratch_rows: Any,
) -> None:
    """Compute the postures of stances from `start` to `stop`, excluded, with their branch sets.

    `stances` are point indices, shape (k, N), `out` records of `Posture`, shape (k,). `bases` are
    records of `Pose` in the world, shape (k,), if the rule has them given, else of shape (1,).
    """
    robot, rule, grid, scratch = world.robots[0], world.rules[0], world.grid, scratch_rows[0]
    geometry, floor, boxes = scratch.geometry, rule.node_margin, rule.among_boxes
    clearance = rule.thresholds.clearance
    for k in range(start, stop):
        given, posture = bases[min(k, len(bases) - 1)], out[k]
        set_stance(world.points, rule, stances[k], geometry)
        # A stance that is no node is told with what it reaches, as close to itself as may be.
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
