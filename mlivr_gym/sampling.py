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
"""Longest search for one way [s]."""

MOST_CHECKS = 4000
"""Postures looked at in one search, at most; it ends a search before the time does on all but slow machines."""

RESOLUTION = 0.01
"""Spacing of the postures that the sampling planner looks at, as a share of the joint space's extent."""

SEED = 20251121


def sampled_swing(
    finder: SwingFinder, start: Array, end: Array, turns: tuple[Array, Array], carriage: tuple[Array, Array] | None
) -> Array | None:
    """Knots of a swing: a sampled way at rest, a line while the base moves, a sampled way at rest; None if none is found.

    The way found is checked as a whole like any other, so what the sampling planner skips between its postures does
    no harm.

    Args:
        finder: The step.
        start: Joint angles above the point the limb leaves [rad].
        end: Joint angles above the point it lands on, on any winding.
        turns: Fewest and most whole turns that may be added to `end`.
        carriage: Joint angles at both ends of the line, see `SwingFinder.carriage`.
    """
    from mlivr_gym.swing import landing

    if carriage is None:
        return None
    away = sampled_way(finder, _knot(0.0, start), _knot(0.0, carriage[0]))
    if away is None:
        return None
    back = sampled_way(finder, _knot(1.0, carriage[1]), _knot(1.0, landing(end, turns, carriage[1])))
    if back is None:
        return None
    knots = np.vstack([away, back])
    return knots if finder.clear(knots) else None


def sampled_way(finder: SwingFinder, start: Array, end: Array) -> Array | None:
    """Knots of a way between two knots, shape (k, 7), or None; if both have the same base parameter, with the base at rest."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(SEED)
    limits = finder.graph.robot.limb.limits
    rest = float(start[0]) if start[0] == end[0] else None
    first = 0 if rest is None else 1
    size = len(start) - first
    space = base.RealVectorStateSpace(size)
    bounds = base.RealVectorBounds(size)
    for axis in range(size):
        low, high = (0.0, 1.0) if axis + first == 0 else limits[axis + first - 1]
        bounds.setLow(axis, float(low) - LIMIT_TOLERANCE)
        bounds.setHigh(axis, float(high) + LIMIT_TOLERANCE)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    checks = 0

    def knot(state: Any) -> Array:
        return np.array(([] if rest is None else [rest]) + [state[axis] for axis in range(size)])

    def valid(state: Any) -> bool:
        nonlocal checks
        checks += 1
        here = knot(state)
        return checks <= MOST_CHECKS and finder.clear(np.stack([here, here]))

    setup.setStateValidityChecker(valid)
    setup.getSpaceInformation().setStateValidityCheckingResolution(RESOLUTION)
    ends = space.allocState(), space.allocState()
    for axis in range(size):
        ends[0][axis], ends[1][axis] = float(start[axis + first]), float(end[axis + first])
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    setup.solve(TIME_LIMIT)
    if not setup.haveExactSolutionPath():
        return None
    setup.simplifySolution(TIME_LIMIT)
    return np.array([knot(state) for state in setup.getSolutionPath().getStates()])


def _knot(u: float, joints: Array) -> Array:
    return np.concatenate([[u], joints])
