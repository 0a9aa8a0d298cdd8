"""A lower bound of the steps of two limbs on a whole map, without its stances.

A stance that can be held among boxes has a posture without them, which depends on the relative
geometry of its points alone and takes little time, see `PostureSolver`. The fewest moves over the
stances that have one are a lower bound of the steps of every plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.postures.base_poses import OPPOSED_HEIGHTS
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.world.grasp_map import GraspMap


def fewest_moves(
    world: GraspMap,
    robot: RobotSpec,
    settings: Settings,
    start: Sequence[int],
    goal: tuple[Array, float],
) -> float:
    """Return a lower bound of the steps of two limbs on a map, whatever its boxes and obstacles.

    Parameters
    ----------
    world, robot, settings
        As for `stance_graph`.
    start
        Point of each limb.
    goal
        Goal position of the base, shape (3,), and its tolerance [m].

    Returns
    -------
    float
        The bound, at least 1; infinite if no moves lead to the goal.
    """
    settings = replace(settings, collisions=False, transitions=False)
    solver = PostureSolver(replace(world, boxes=()), robot, settings)
    last, moves = np.unique(start), 1.0
    is_goal, waits = _goal_points(solver, *goal), np.ones(len(world), dtype=np.bool_)
    # The last move leads to a point beside one that the other limb holds already.
    while not is_goal[last].any():
        waits[last] = False
        pairs = _pairs_between(world.positions, last, np.flatnonzero(waits), robot.span)
        last, moves = np.unique(pairs[_have_postures(solver, pairs), 1]), moves + 1.0
        if not len(last):
            return np.inf
    return moves


def _goal_points(solver: PostureSolver, target: Array, tolerance: float) -> BoolArray:
    """Return which points belong to stances that may be at a goal, shape (m,)."""
    world, robot, found = solver.grasp_map, solver.robot, np.zeros(len(solver.grasp_map), np.bool_)
    # The base is at one of the heights above the middle between the two points.
    reach = tolerance + max(*robot.heights, *OPPOSED_HEIGHTS)
    away = np.linalg.norm(world.positions - target, axis=1)
    some = np.flatnonzero(away <= reach + 0.5 * robot.span)
    pairs = _pairs_between(world.positions, some, some, robot.span)
    middles = world.positions[pairs].mean(axis=1)
    pairs = pairs[np.linalg.norm(middles - target, axis=1) <= reach]
    found[pairs[_have_postures(solver, pairs)]] = True
    return found


def _pairs_between(positions: Array, some: IntArray, others: IntArray, span: float) -> IntArray:
    """Return the pairs of some points and other ones within a span [m], shape (k, 2)."""
    low, high = positions[some].min(axis=0) - span, positions[some].max(axis=0) + span
    others = others[((positions[others] >= low) & (positions[others] <= high)).all(axis=1)]
    apart = np.linalg.norm(positions[some, None] - positions[others], axis=2)
    i, j = np.nonzero((apart <= span + 1e-9) & (apart > 0.0))
    return np.stack([some[i], others[j]], axis=1)


def _have_postures(solver: PostureSolver, pairs: IntArray) -> BoolArray:
    """Return which pairs of points two limbs may hold, one way or the other, shape (k,)."""
    found = np.zeros(len(pairs), dtype=np.bool_)
    for turned in pairs, pairs[:, ::-1]:
        others = np.flatnonzero(~found)
        postures = solver.solve(np.ascontiguousarray(turned[others]), nodes_only=True)
        found[others] = np.all(postures.branch_sets > 0, axis=1)
    return found
