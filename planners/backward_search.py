"""Costs to a goal over the nodes of a table when steps are not checked (compiled).

Every step of the graph joins two nodes that `node_pairs` does not rule out. So the least cost over
those, found by a search backward from the goal, never exceeds that of a plan. It goes on until the
start is reached and a little farther; nodes it did not come to cost at least as much as it had
reached then, less what leads to them from the start.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_masks import has_bit
from mlivr_gym.compiled.records import Record, Rows
from mlivr_gym.planners.bucket_queue import NOTHING, NodeQueue, least_waiting, put, take, width_for
from mlivr_gym.planners.costs import Weights
from mlivr_gym.stances.node_pairs import row_of
from mlivr_gym.stances.node_table import NodeTable

CAPACITY = 1 << 21
"""Entries of the queue to begin with, beside the goals."""

LEAST = 1e-12
"""Least cost to the goal from a node that is not there."""


class Progress(Record):
    """How far a search is."""

    seeded: bool
    """Whether the goals are in the queue."""
    wanted: int
    """Starts that it has not reached."""
    limit: float
    """Estimate beyond which it ends, infinite until it has reached all."""
    share: float
    """How much farther it goes then, as a share of the cost."""
    amount: float
    """And how much in any case."""
    reached: float
    """Estimate at which it ended; infinite if nothing is left."""


class Mark(Record):
    """What a search knows of a node, kept together as it is read together."""

    value: float
    """The least cost found."""
    toward: float
    """Lower bound of the cost from the start, infinite for what need not be looked at."""
    closed: bool
    """Whether it was expanded since that was found."""


def costs_to_goal(
    table: NodeTable,
    goals: BoolArray,
    weights: Weights,
    starts: IntArray,
    toward: Array,
    farther_by: tuple[float, float],
) -> tuple[Array, BoolArray]:
    """Lower bounds of the cost from every node to the goal.

    Parameters
    ----------
    table
        The nodes.
    goals
        Which are at the goal, shape (n,).
    weights
        What is minimised.
    starts
        Nodes from which bounds are wanted.
    toward
        Lower bounds of the cost from the start to each node, consistent, infinite for what
        need not be looked at; shape (n,).
    farther_by
        How much farther than to the starts it goes: share and amount of the cost.

    Returns
    -------
    tuple[Array, BoolArray]
        The bounds, 0 at goals alone, infinite where nothing leads there, and consistent; and where
        they are the least cost. Each of shape (n,).
    """
    count, wanted = len(goals), np.zeros(len(goals), dtype=np.bool_)
    wanted[starts] = True
    marks = Mark.rows(count)
    marks["value"], marks["toward"] = np.inf, toward
    low = float(toward[goals].min(initial=np.inf))
    waiting = NodeQueue.of(CAPACITY + int(goals.sum()), low, width_for(weights))
    progress = Progress.row()
    progress["wanted"], progress["limit"] = int(wanted.sum()), np.inf
    progress["share"], progress["amount"] = farther_by
    nodes = table, goals, wanted
    while not _search(nodes, weights, marks, waiting, progress):
        waiting = waiting.wider()
    outside, some = np.full(count, np.inf), np.isfinite(toward)
    outside[some] = np.maximum(progress["reached"] - toward[some], LEAST)
    # What was found beyond is not the least for certain.
    bounds: Array = np.minimum(marks["value"], outside)
    bounds[(bounds < LEAST) & ~goals] = LEAST
    exact: BoolArray = np.isfinite(marks["value"])
    exact[exact] = (marks["value"] + toward)[exact] < progress["reached"]
    return bounds, exact


@entry
def _search(
    nodes: tuple[NodeTable, BoolArray, BoolArray],
    weights: Weights,
    marks: Rows[Mark],
    waiting: NodeQueue,
    progress: Progress,
) -> bool:
    """Go on with a search; False if its queue is full."""
    table, goals, wanted = nodes
    if not progress.seeded:
        progress.seeded = True
        for s in range(len(goals)):
            if goals[s] and marks[s].toward < np.inf:
                marks[s].value = 0.0
                put(waiting, marks[s].toward, s)
    while True:
        entry = take(waiting)
        if entry == NOTHING:
            progress.reached = np.inf
            return True
        if least_waiting(waiting) > progress.limit:
            progress.reached = least_waiting(waiting)
            return True
        s = int(waiting.node[entry])
        if marks[s].closed:
            continue
        if waiting.filled.used + degree(table, s) + 1 > len(waiting.node):
            put(waiting, marks[s].value + marks[s].toward, s)
            return False
        marks[s].closed = True
        if wanted[s]:
            wanted[s] = False
            progress.wanted -= 1
            if progress.wanted == 0:
                f = marks[s].value + marks[s].toward
                progress.limit = f * (1.0 + progress.share) + progress.amount
        _open(table, s, weights, marks, waiting)


@kernel
def degree(table: NodeTable, s: int) -> int:
    """How many nodes are a move away from one, at most."""
    count = 0
    for limb in range(table.points.shape[1]):
        support = table.supports[s, limb]
        count += int(table.start[support + 1]) - int(table.start[support])
    return count


@kernel
def _open(
    table: NodeTable,
    s: int,
    weights: Weights,
    marks: Rows[Mark],
    waiting: NodeQueue,
) -> None:
    """Note what leads to a node."""
    limbs, g = table.points.shape[1], marks[s].value
    for limb in range(limbs):
        row = row_of(table, s, limb)
        if row < 0:
            continue
        support = table.supports[s, limb]
        begin, end = int(table.start[support]), int(table.start[support + 1])
        for k in range(end - begin):
            if not has_bit(table.bits, row + k):
                continue
            other = int(table.members[begin + k]) // limbs
            mark = marks[other]
            cost = g + least_cost(table, s, other, weights)
            if cost < mark.value and mark.toward < np.inf:
                mark.value, mark.closed = cost, False
                put(waiting, cost + mark.toward, other)


@kernel
def least_cost(table: NodeTable, a: int, b: int, weights: Weights) -> float:
    """What a step between two nodes costs at least."""
    if weights.base == 0.0:
        return float(weights.step)
    shift = 0.0
    for axis in range(3):
        away = table.base_position[a, axis] - table.base_position[b, axis]
        shift += away * away
    return float(weights.base * np.sqrt(shift) + weights.step)
