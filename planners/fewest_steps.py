"""Fewest steps to a goal over the nodes of a table, whatever the branches of limbs (compiled).

This is breadth-first search backward from the goal. Neighbours have common support sets, the
points held by the limbs that do not move, so each level visits the support sets of its nodes in
the order in which they lie in memory, which takes a third of the time of going from node to node.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_branch_sets import has_bit
from mlivr_gym.stances.node_table import NodeTable

UNREACHED, FORBIDDEN = -1, -2
"""Steps of a node that was not reached, and of a node that paths may not enter."""

ON_FRONTIER, ALL_REACHED = 1, 2
"""Status of support sets: one of their nodes was reached last; all their nodes were reached."""


class SupportSetScratch(NamedTuple):
    """Scratch for the r members of one support set."""

    unreached: NDArray[np.int32]
    """Indices of the members not reached yet, shape (r,)."""
    unreached_node: NDArray[np.int32]
    """Nodes of these members, shape (r,)."""
    frontier: NDArray[np.int32]
    """Indices of the members reached last, shape (r,)."""


def fewest_steps(
    table: NodeTable, goals: BoolArray, forbidden: BoolArray, starts: IntArray, extension: int
) -> tuple[NDArray[np.int16], float]:
    """Compute the fewest steps from each of n nodes to the goal.

    Paths do not enter forbidden nodes; the search goes some levels beyond the last of the starts.
    Returns the steps, negative for nodes that were not reached, and a lower bound of the steps of
    the unreached nodes that are not forbidden, infinite if no path leads from them to the goal.
    """
    steps = np.where(goals, 0, UNREACHED).astype(np.int16)
    steps[forbidden] = FORBIDDEN
    largest = int(np.diff(table.start).max(initial=0))
    scratch = SupportSetScratch(*(np.empty(largest, dtype=np.int32) for _ in range(3)))
    support_set_status, level, limit = np.zeros(len(table.start) - 1, dtype=np.uint8), 0, np.inf
    while level < limit:
        if not _expand_level(table, level, steps, support_set_status, scratch):
            return steps, np.inf
        level += 1
        if limit == np.inf and (steps[starts] != UNREACHED).all():
            limit = int(steps[starts].max(initial=0)) + extension
    return steps, level + 1.0


@entry
def _expand_level(
    table: NodeTable,
    level: int,
    steps: NDArray[np.int16],
    support_set_status: NDArray[np.uint8],
    scratch: SupportSetScratch,
) -> bool:
    """Reach the neighbours of all nodes of a level; return whether there are any."""
    for s in range(len(steps)):
        if steps[s] == level:
            for limb in range(table.support_sets.shape[1]):
                if support_set_status[table.support_sets[s, limb]] != ALL_REACHED:
                    support_set_status[table.support_sets[s, limb]] = ON_FRONTIER
    reached = 0
    for support_set in range(len(support_set_status)):
        if support_set_status[support_set] == ON_FRONTIER:
            reached += _expand_support_set(
                table, support_set, level, steps, support_set_status, scratch
            )
    return reached > 0


@kernel
def _expand_support_set(
    table: NodeTable,
    support_set: int,
    level: int,
    steps: NDArray[np.int16],
    support_set_status: NDArray[np.uint8],
    scratch: SupportSetScratch,
) -> int:
    """Reach the neighbours of the frontier within one support set; return how many were reached."""
    begin, size = (
        int(table.start[support_set]),
        int(table.start[support_set + 1] - table.start[support_set]),
    )
    unreached_count = frontier_count = 0
    for k in range(size):
        s = int(table.members[begin + k]) // table.points.shape[1]
        if steps[s] == UNREACHED:
            scratch.unreached[unreached_count], scratch.unreached_node[unreached_count] = k, s
            unreached_count += 1
        elif steps[s] == level:
            scratch.frontier[frontier_count] = k
            frontier_count += 1
    initial_count = unreached_count
    for i in range(frontier_count):
        row, k = int(table.offset[support_set]) + int(scratch.frontier[i]) * size, 0
        while k < unreached_count:
            if not has_bit(table.joined, row + int(scratch.unreached[k])):
                k += 1
                continue
            steps[scratch.unreached_node[k]] = level + 1
            unreached_count -= 1
            scratch.unreached[k], scratch.unreached_node[k] = (
                scratch.unreached[unreached_count],
                scratch.unreached_node[unreached_count],
            )
    support_set_status[support_set] = ALL_REACHED if unreached_count == 0 else 0
    return initial_count - unreached_count
