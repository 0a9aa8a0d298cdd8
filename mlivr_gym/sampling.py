"""Swings by a sampling planner (OMPL's RRT-Connect), for the few that no simple way serves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.base_path import LIMIT_TOLERANCE

if TYPE_CHECKING:
    from mlivr_gym.swing import SwingFinder

Array = NDArray[np.float64]

TIME_LIMIT = 0.5
"""Longest search for one half of a swing [s]."""

MOST_CHECKS = 4000
"""Postures looked at in one search, at most; it ends a search before the time does on all but slow machines."""

RESOLUTION = 0.01
"""Spacing of the postures that the sampling planner looks at, as a share of the joint space's extent."""

SEED = 20251121


def sampled_swing(finder: SwingFinder, start: Array, end: Array, turns: tuple[Array, Array], fold: int) -> Array | None:
    """Knots of a swing: fold on a sampled way, move the base, unfold on a sampled way; None if none is found.

    The way found is checked as a whole like any other, so what the sampling planner skips between its postures does
    no harm.

    Args:
        finder: The step.
        start: Joint angles above the point the limb leaves [rad].
        end: Joint angles above the point it lands on, on any winding.
        turns: Fewest and most whole turns that may be added to `end`.
        fold: The fold in which the limb is carried.
    """
    from mlivr_gym.swing import landing

    folded = finder.fold(fold, start)
    if folded is None:
        return None
    away = sampled_way(finder, 0.0, start, folded)
    if away is None:
        return None
    back = sampled_way(finder, 1.0, folded, landing(end, turns, folded))
    if back is None:
        return None
    knots = np.vstack([_at(0.0, away), _at(1.0, back)])
    return knots if finder.clear(knots) else None


def sampled_way(finder: SwingFinder, u: float, start: Array, end: Array) -> Array | None:
    """Joint angles of a way between two postures with the base at rest at `u`, shape (k, 6), or None."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(SEED)
    limits = finder.graph.robot.limb.limits
    space = base.RealVectorStateSpace(6)
    bounds = base.RealVectorBounds(6)
    for joint in range(6):
        bounds.setLow(joint, float(limits[joint, 0]) - LIMIT_TOLERANCE)
        bounds.setHigh(joint, float(limits[joint, 1]) + LIMIT_TOLERANCE)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    checks = 0

    def valid(state: Any) -> bool:
        nonlocal checks
        checks += 1
        q = np.array([state[joint] for joint in range(6)])
        return checks <= MOST_CHECKS and finder.clear(_at(u, np.stack([q, q])))

    setup.setStateValidityChecker(valid)
    setup.getSpaceInformation().setStateValidityCheckingResolution(RESOLUTION)
    first, last = space.allocState(), space.allocState()
    for joint in range(6):
        first[joint], last[joint] = float(start[joint]), float(end[joint])
    setup.setStartAndGoalStates(first, last)
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    setup.solve(TIME_LIMIT)
    if not setup.haveExactSolutionPath():
        return None
    setup.simplifySolution(TIME_LIMIT)
    path = setup.getSolutionPath()
    return np.array([[state[joint] for joint in range(6)] for state in path.getStates()])


def _at(u: float, joints: Array) -> Array:
    """Knots at one base parameter."""
    return np.column_stack([np.full(len(joints), u), joints])
