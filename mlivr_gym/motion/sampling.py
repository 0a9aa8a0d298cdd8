"""Swings by a sampling planner (OMPL's RRT-Connect), where no simple swing serves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.holding import LIMIT_TOLERANCE

TIME_LIMIT = 0.5
"""Longest search for one line [s]."""

MOST_CHECKS = 4000
"""Most postures looked at in one search.

It ends a search before the time does on all but slow machines.
"""

RESOLUTION = 0.01
"""Spacing of the postures that the planner looks at, as a share of the joint space's extent."""

SEED = 20251121
"""Seed of the sampling planner."""


def sampled_line(
    clear: Callable[[Array], bool], limits: Array, start: Array, end: Array
) -> Array | None:
    """Knots from one knot to another, shape (k, 7), or None if none are found.

    Args:
        clear: Whether the robot touches nothing along a chain of knots, shape (k, 7).
        limits: Joint limits [rad], shape (6, 2).
        start: Base parameter and joint angles [rad] of the first knot, shape (7,).
        end: Those of the last. If both have the same base parameter, the base rests.
    """
    from ompl import base, geometric, util

    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(SEED)
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
        return checks <= MOST_CHECKS and clear(np.stack([here, here]))

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
