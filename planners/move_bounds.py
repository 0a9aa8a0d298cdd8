"""Fewest moves of limbs to a goal: a lower bound of the steps of any number of limbs.

A step moves one limb. So the fewest moves of limbs i and j to points that they can hold at the
goal, while the others may do as they please, plus those of k and l, are no more than the steps of
all: additive pattern databases (Felner, Korf, Hanan, Journal of Artificial Intelligence Research
22, 2004). Two limbs may hold two points together if these are no farther apart than the robot's
span and no closer than its grippers allow; at the goal each point lies within reach of the goal
region. Both are true of every stance, so the bound never exceeds the steps that are left, and one
step changes it by one at most.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.planners.query import Goal
from mlivr_gym.stances.stance_graph import StanceGraph

Partition = tuple[tuple[int, ...], ...]
"""Limbs in pairs; of an odd number the last is alone."""


class MoveBounds:
    """Lower bounds of the steps from stances to one goal.

    Attributes
    ----------
    alone
        Fewest moves of a limb by the point that it holds, 0 or 1, shape (m,).
    pairs
        Fewest moves of two limbs by the points that they hold, shape (m, m); infinite where
        they cannot come to the goal, or cannot hold both.
    """

    def __init__(self, graph: StanceGraph, goal: Goal) -> None:
        """Work the tables out for `goal`."""
        robot, positions = graph.robot, graph.grasp_map.positions
        reach = robot.reach
        there = goal.distance(positions) <= reach + goal.tolerance + 1e-9
        if goal.on_face is not None:
            there &= goal.on_face
        self.alone: Array = np.where(there, 0.0, 1.0)
        self.pairs = _fewest_moves(graph.together, there)
        self._partitions = list(partitions(tuple(range(graph.limbs))))

    def steps(self, stances: IntArray) -> Array:
        """Lower bounds of the steps from stances, shape (k, N) -> (k,)."""
        best = np.zeros(len(stances))
        for partition in self._partitions:
            total = np.zeros(len(stances))
            for limbs in partition:
                held = stances[:, limbs]
                table = self.pairs if len(limbs) == 2 else self.alone
                total += table[tuple(held.T)]
            np.maximum(best, total, out=best)
        return best


def partitions(limbs: tuple[int, ...]) -> Iterator[Partition]:
    """All partitions of limbs into pairs, with one limb alone where their number is odd."""
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


def _fewest_moves(together: BoolArray, there: BoolArray) -> Array:
    """Fewest moves of two limbs to points that are `there`, by breadth from these, shape (m, m)."""
    moves = np.full(together.shape, np.inf)
    new: BoolArray = np.logical_and(together, np.outer(there, there))
    count = 0
    while new.any():
        moves[new] = count
        count += 1
        # The first limb moves while the second holds, or the second while the first holds.
        reached = np.any(new, axis=0, keepdims=True) | np.any(new, axis=1, keepdims=True)
        new = np.logical_and(together, reached & np.isinf(moves))
    return moves
