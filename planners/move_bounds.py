"""Fewest moves of pairs of limbs: a lower bound of the steps of any number of limbs.

A step moves one limb. So the fewest moves of limbs i and j to points that they can hold at the
goal, with no constraint on the other limbs, plus those of limbs k and l, never exceed the steps of
all: additive pattern databases (Felner, Korf and Hanan, Journal of Artificial Intelligence Research
22, 2004). Nor does the sum over all pairs of N limbs, in which each move counts N - 1 times, exceed
N - 1 times the steps; with an odd number of limbs this may be more. Two limbs can hold two points
if these are within the span of the robot and farther apart than its grippers require; at the goal
each point lies within reach of the goal region. Every stance satisfies both conditions, so the
bound is admissible, and it is consistent because a step changes it by at most one.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.planners.clock import UNLIMITED, Clock
from mlivr_gym.planners.query import Goal
from mlivr_gym.stances.stance_graph import StanceGraph

Partition = tuple[tuple[int, ...], ...]
"""Limbs in pairs, and one limb alone if their number is odd."""


class MoveBounds:
    """Lower bounds of the steps from stances to one goal.

    Attributes
    ----------
    alone
        Fewest moves of a limb by the point that it holds, 0 or 1, shape (m,).
    pairs
        Fewest moves of two limbs by the points that they hold, shape (m, m); infinite where they
        cannot reach the goal or cannot hold both points.
    """

    def __init__(self, graph: StanceGraph, goal: Goal, clock: Clock = UNLIMITED) -> None:
        """Compute the moves to a goal."""
        robot, positions = graph.robot, graph.grasp_map.positions
        at_goal = goal.distance(positions) <= robot.reach + goal.tolerance + 1e-9
        if goal.on_face is not None:
            at_goal &= goal.on_face
        self.alone: Array = np.where(at_goal, 0.0, 1.0)
        self.pairs = _fewest_moves(graph.compatible, at_goal, clock)
        self._partitions = list(partitions(tuple(range(graph.limbs))))

    def steps(self, stances: IntArray) -> Array:
        """Return lower bounds of the steps from stances, shape (k, N) -> (k,)."""
        best = np.zeros(len(stances))
        for partition in self._partitions:
            total = np.zeros(len(stances))
            for limbs in partition:
                points = stances[:, limbs]
                table = self.pairs if len(limbs) == 2 else self.alone
                total += table[tuple(points.T)]
            np.maximum(best, total, out=best)
        total, limbs = np.zeros(len(stances)), stances.shape[1]
        for i, j in combinations(range(limbs), 2):
            total += self.pairs[stances[:, i], stances[:, j]]
        np.maximum(best, np.ceil(total / (limbs - 1) - 1e-9), out=best)
        return best


def partitions(limbs: tuple[int, ...]) -> Iterator[Partition]:
    """Yield all partitions of limbs into pairs, with one limb alone if their number is odd."""
    if len(limbs) <= 1:
        yield (limbs,) if limbs else ()
        return
    first, rest = limbs[0], limbs[1:]
    for other in rest:
        others = tuple(limb for limb in rest if limb != other)
        for more in partitions(others):
            yield ((first, other), *more)
    if len(limbs) % 2:
        for more in partitions(rest):
            yield (*more, (first,))


def _fewest_moves(compatible: BoolArray, at_goal: BoolArray, clock: Clock) -> Array:
    """Return the fewest moves of two limbs to points at the goal, shape (m, m)."""
    moves = np.full(compatible.shape, np.inf)
    frontier: BoolArray = np.logical_and(compatible, np.outer(at_goal, at_goal))
    count = 0
    while frontier.any():
        clock.check()
        moves[frontier] = count
        count += 1
        # The first limb moves while the second holds, or the second while the first holds.
        reached = np.any(frontier, axis=0, keepdims=True) | np.any(frontier, axis=1, keepdims=True)
        frontier = np.logical_and(compatible, reached & np.isinf(moves))
    return moves
