"""Fewest moves between stance sets: a lower bound of the steps of three or four limbs.

Every state of a path holds one of the `StanceSets`, and a step leads to a set one move away. So the
fewest moves to a set whose base can be at the goal, by breadth-first search from all of these, are
an admissible and consistent lower bound of the steps: a pattern database (Culberson and Schaeffer
1998).
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
        The stance sets.
    moves
        Fewest moves from each set to the goal, -1 where none lead there, shape (n,).
    """

    def __init__(self, graph: StanceGraph, sets: StanceSets, goal: Goal) -> None:
        """Compute the moves to a goal."""
        self.sets, points = sets, sets.points.astype(np.int64)
        at_goal = goal.on_goal_face(points)
        at_goal[at_goal] = graph.solver.in_reach(points[at_goal], goal.target, goal.tolerance)
        self.moves: NDArray[np.int16] = np.where(at_goal, 0, -1).astype(np.int16)
        fewest_moves(
            sets.support_sets, self.moves, np.zeros(sets.support_set_count, dtype=np.bool_)
        )

    def steps(self, stances: IntArray) -> Array:
        """Return lower bounds of the steps from stances, (k, N) -> (k,); infinite if no set."""
        row = self.sets.find(stances)
        moves = self.moves[row].astype(np.float64)
        moves[(row < 0) | (moves < 0)] = np.inf
        return moves


@entry
def fewest_moves(
    support_sets: NDArray[np.int32], moves: NDArray[np.int16], reached: BoolArray
) -> None:
    """Compute the fewest moves from n sets to those where `moves` is 0, by breadth-first search.

    `support_sets` are those of each set, shape (n, N): sets with a common one are one move apart.
    `moves` is -1 for other sets, where the moves are written; `reached` is scratch, all False, one
    for each support set.
    """
    moves_done, changed = 0, True
    while changed:
        for s in range(len(moves)):
            if moves[s] == moves_done:
                for i in range(support_sets.shape[1]):
                    reached[support_sets[s, i]] = True
        moves_done, changed = moves_done + 1, False
        for s in range(len(moves)):
            if moves[s] < 0:
                for i in range(support_sets.shape[1]):
                    if reached[support_sets[s, i]]:
                        moves[s], changed = moves_done, True
                        break
