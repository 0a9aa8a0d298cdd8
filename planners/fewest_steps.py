"""Fewest steps to a goal over the nodes of a table when steps are not checked (compiled).

By breadth from the goal. What is a move apart has a rest in common, so rests are gone through, each
as long as a member of it waits: in the order in which they lie in memory, which takes a third of
the time of going from node to node.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_masks import has_bit
from mlivr_gym.stances.node_table import NodeTable

UNREACHED, TAKEN = -1, -2
"""Steps from a node that nothing led to, and from one that walks may not enter."""

WAITS, DONE = 1, 2
"""Marks of a rest: one of its nodes was reached last; all its nodes were reached."""


class QueueScratch(NamedTuple):
    """Room for the members of a rest."""

    place: NDArray[np.int32]
    """Which of its members nothing led to yet, shape (r,)."""
    node: NDArray[np.int32]
    """Their nodes, shape (r,)."""
    last: NDArray[np.int32]
    """Which were reached last, shape (r,)."""


def fewest_steps(
    table: NodeTable, goals: BoolArray, taken: BoolArray, starts: IntArray, farther: int
) -> tuple[NDArray[np.int16], float]:
    """Fewest steps from every node to the goal.

    Parameters
    ----------
    table
        The nodes.
    goals
        Which are at the goal, shape (n,).
    taken
        Which walks may not enter, shape (n,).
    starts
        Nodes from which they are wanted.
    farther
        How many steps farther than to these it goes.

    Returns
    -------
    tuple[NDArray[np.int16], float]
        The steps, shape (n,), negative for nodes that it did not come to; and how many those take
        at least that are not taken, infinite if nothing leads on from them.
    """
    steps = np.where(goals, 0, UNREACHED).astype(np.int16)
    steps[taken] = TAKEN
    most = int(np.diff(table.start).max(initial=0))
    scratch = QueueScratch(*(np.empty(most, dtype=np.int32) for _ in range(3)))
    marks, level, limit = np.zeros(len(table.start) - 1, dtype=np.uint8), 0, np.inf
    while level < limit:
        if not _go_back(table, level, steps, marks, scratch):
            return steps, np.inf
        level += 1
        if limit == np.inf and (steps[starts] != UNREACHED).all():
            limit = int(steps[starts].max(initial=0)) + farther
    return steps, level + 1.0


@entry
def _go_back(
    table: NodeTable,
    level: int,
    steps: NDArray[np.int16],
    marks: NDArray[np.uint8],
    scratch: QueueScratch,
) -> bool:
    """Reach what is a step from the nodes of a level; whether there is any."""
    for s in range(len(steps)):
        if steps[s] == level:
            for limb in range(table.supports.shape[1]):
                if marks[table.supports[s, limb]] != DONE:
                    marks[table.supports[s, limb]] = WAITS
    reached = 0
    for support in range(len(marks)):
        if marks[support] == WAITS:
            reached += _through(table, support, level, steps, marks, scratch)
    return reached > 0


@kernel
def _through(
    table: NodeTable,
    support: int,
    level: int,
    steps: NDArray[np.int16],
    marks: NDArray[np.uint8],
    scratch: QueueScratch,
) -> int:
    """The same within a rest; how many it reached."""
    begin, size = int(table.start[support]), int(table.start[support + 1] - table.start[support])
    wait = now = 0
    for k in range(size):
        s = int(table.members[begin + k]) // table.points.shape[1]
        if steps[s] == UNREACHED:
            scratch.place[wait], scratch.node[wait] = k, s
            wait += 1
        elif steps[s] == level:
            scratch.last[now] = k
            now += 1
    before = wait
    for i in range(now):
        row, k = int(table.offset[support]) + int(scratch.last[i]) * size, 0
        while k < wait:
            if not has_bit(table.bits, row + int(scratch.place[k])):
                k += 1
                continue
            steps[scratch.node[k]] = level + 1
            wait -= 1
            scratch.place[k], scratch.node[k] = scratch.place[wait], scratch.node[wait]
    marks[support] = DONE if wait == 0 else 0
    return before - wait
