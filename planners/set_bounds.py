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
from mlivr_gym.planners.clock import UNLIMITED, Clock
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

    def __init__(
        self, graph: StanceGraph, sets: StanceSets, goal: Goal, clock: Clock = UNLIMITED
    ) -> None:
        """Compute the moves to a goal."""
        self.sets, points = sets, sets.points.astype(np.int64)
        at_goal = goal.on_goal_face(points)
        some = np.flatnonzero(at_goal)
        for piece in clock.pieces("sets in reach", len(some)):
            rows = some[piece]
            at_goal[rows] = graph.solver.in_reach(points[rows], goal.target, goal.tolerance)
        self.moves: NDArray[np.int16] = np.where(at_goal, 0, -1).astype(np.int16)
        reached = np.zeros(sets.support_set_count, dtype=np.bool_)
        fewest_moves(sets.support_sets, self.moves, reached, clock)

    def steps(self, stances: IntArray) -> Array:
        """Return lower bounds of the steps from stances, (k, N) -> (k,); infinite if no set."""
        row = self.sets.find(stances)
        moves = self.moves[row].astype(np.float64)
        moves[(row < 0) | (moves < 0)] = np.inf
        return moves


def fewest_moves(
    support_sets: NDArray[np.int32],
    moves: NDArray[np.int16],
    reached: BoolArray,
    clock: Clock = UNLIMITED,
) -> None:
    """Compute the fewest moves from n sets to those where `moves` is 0, by breadth-first search.

    `support_sets` are those of each set, shape (n, N): sets with a common one are one move apart.
    `moves` is -1 for other sets, where the moves are written; `reached` is scratch, all False, one
    for each support set.
    """
    done, changed = 0, True
    while changed:
        for piece in clock.pieces("sets marked", len(moves)):
            mark_support_sets(piece.start, piece.stop, support_sets, moves, reached, done)
        changed, done = False, done + 1
        for piece in clock.pieces("sets reached", len(moves)):
            if reach_sets(piece.start, piece.stop, support_sets, moves, reached, done):
                changed = True


@entry
def mark_support_sets(
    start: int,
    stop: int,
    support_sets: NDArray[np.int32],
    moves: NDArray[np.int16],
    reached: BoolArray,
    done: int,
) -> None:
    """Mark the support sets of those of the sets `start` to `stop` - 1 that are `done` moves away.

    The other arguments are those of `fewest_moves`.
    """
    for s in range(start, stop):
        if moves[s] == done:
            for i in range(support_sets.shape[1]):
                reached[support_sets[s, i]] = True


@entry
def reach_sets(
    start: int,
    stop: int,
    support_sets: NDArray[np.int32],
    moves: NDArray[np.int16],
    reached: BoolArray,
    done: int,
) -> bool:
    """Write `done` moves for those of the sets `start` to `stop` - 1 with a marked support set.

    Returns whether there are any; the other arguments are those of `fewest_moves`.
    """
    changed = False
    for s in range(start, stop):
        if moves[s] < 0:
            for i in range(support_sets.shape[1]):
                if reached[support_sets[s, i]]:
                    moves[s], changed = done, True
                    break
    return changed
