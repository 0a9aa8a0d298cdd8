"""Fewest moves between sets of points to a goal: a lower bound of the steps of three or four limbs.

Every state of a walk holds one of the `StanceSets`, and a step goes to one a move away. So the
fewest moves to a set from which the base can be at the goal, worked out by breadth from all of
these, never exceed the steps that are left, and one step changes them by one at most.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.planners.query import Goal
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.stance_sets import StanceSets


class SetBounds:
    """Lower bounds of the steps from stances to one goal.

    Attributes
    ----------
    sets
        The sets of points.
    moves
        Fewest moves from each to the goal, -1 where none lead there, shape (n,).
    """

    def __init__(self, graph: StanceGraph, sets: StanceSets, goal: Goal) -> None:
        """Work the moves out for `goal`."""
        self.sets, points = sets, sets.points.astype(np.int64)
        at_goal = goal.on_goal_face(points)
        at_goal[at_goal] = graph.solver.in_reach(points[at_goal], goal.target, goal.tolerance)
        self.moves: NDArray[np.int16] = np.where(at_goal, 0, -1).astype(np.int16)
        fewest_moves(sets.supports, self.moves, np.zeros(sets.support_count, dtype=np.bool_))

    def steps(self, stances: IntArray) -> Array:
        """Lower bounds of the steps from stances, (k, N) -> (k,); infinite for what is no node."""
        row = self.sets.find(stances)
        moves = self.moves[row].astype(np.float64)
        moves[(row < 0) | (moves < 0)] = np.inf
        return moves


@entry
def fewest_moves(supports: NDArray[np.int32], moves: NDArray[np.int16], reached: BoolArray) -> None:
    """Fewest moves from n sets to those of which `moves` is 0, by breadth.

    Parameters
    ----------
    supports
        Supports of each set, shape (n, N): sets with one in common are a move apart.
    moves
        0 for the goals, -1 for others, where it is filled; shape (n,).
    reached
        Room for each rest, all False.
    """
    moves_done, changed = 0, True
    while changed:
        for s in range(len(moves)):
            if moves[s] == moves_done:
                for i in range(supports.shape[1]):
                    reached[supports[s, i]] = True
        moves_done, changed = moves_done + 1, False
        for s in range(len(moves)):
            if moves[s] < 0:
                for i in range(supports.shape[1]):
                    if reached[supports[s, i]]:
                        moves[s], changed = moves_done, True
                        break
