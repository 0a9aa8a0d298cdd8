"""Fewest steps of two limbs to a goal, over steps of which few were checked (compiled).

A step that was not checked is assumed to keep all branches that both of its stances have. So the
fewest steps over the graph bound those of every plan from below. A *support* is a stance at which
one limb stays on one branch while the other moves next; an *arrival* is one at which the other limb
has just grasped. After it that limb may move again, or the supporting one if it can be released.

The search goes from row to row, see `TwoLimbTable`. While the steps of a row are not checked, one
arrival reaches all its supports, so the time is in proportion to the stances, not to the steps.
`level_paths` follows the paths that were found.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import ALL, EMPTY
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.stances.two_limb_steps import TwoLimbTable, branches_kept, edge_index
from mlivr_gym.transitions.rule import kept_on_edge

SUPPORT, ARRIVAL = 0, 1
"""Indices of supports and arrivals."""

MOST_UNCHECKED = 2**30
"""More unchecked steps than any path has."""


class Origins(NamedTuple):
    """States at which paths may start, before any step."""

    nodes: IntArray
    """The stances, shape (k,)."""
    supports: IntArray
    """Branches on which each limb may hold while the other moves next, shape (k, 2)."""


class Log(NamedTuple):
    """Stances by level, the number of steps to the goal; a stance may be on several levels."""

    start: NDArray[np.int32]
    """First entry of each level, shape (e + 2,)."""
    stances: NDArray[np.int32]
    """The stances, shape (e,)."""
    branches: NDArray[np.uint16]
    """Branches of their supports and arrivals, by limb, shape (e, 2, 2)."""
    unchecked: NDArray[np.int32]
    """Unchecked steps on some path from each of these, shape (e, 2, 2)."""

    @classmethod
    def allocate(cls, size: int) -> Log:
        """Allocate arrays for some number of entries, which are written in order."""
        start, stances = np.empty(size + 2, dtype=np.int32), np.empty(size, dtype=np.int32)
        branches = np.empty((size, 2, 2), dtype=np.uint16)
        return cls(start, stances, branches, np.empty((size, 2, 2), dtype=np.int32))


class Levels(NamedTuple):
    """Arrays for breadth-first searches over n stances on m points."""

    is_goal: BoolArray
    """Whether each stance is at the goal, shape (n,)."""
    is_checked: BoolArray
    """Whether steps of a support limb from or to a stance may have been checked, shape (n, 2)."""
    releasable: NDArray[np.int32]
    """Branches on which limbs can be released, those of the stance if unknown, shape (n, 2)."""
    log: Log
    """What was reached on each level."""
    reached: NDArray[np.int32]
    """Branches of the supports and arrivals that were reached, shape (2, n, 2)."""
    fresh: NDArray[np.int32]
    """Branches reached on the last level and on this one, by its parity, shape (2, n, 2)."""
    unchecked: NDArray[np.int32]
    """Unchecked steps on some path between these and the end of the search, shape (2, n, 2)."""
    on_level: NDArray[np.int32]
    """Branches of the supports and arrivals of one level, shape (2, n, 2)."""
    ahead: NDArray[np.int32]
    """Unchecked steps on some path from each of these to the goal, shape (2, n, 2)."""
    frontier: NDArray[np.int32]
    """Stances that have some of these branches, shape (2, n)."""
    size: IntArray
    """Number of these stances, shape (2,)."""
    waiting: NDArray[np.int32]
    """Stances of each row of which not all supports were reached, in its place, shape (2, n)."""
    waiting_size: IntArray
    """Number of these stances, shape (2, m)."""
    active: NDArray[np.int32]
    """Support limb and point of the rows that have stances of a frontier, shape (2 m, 2)."""
    is_active: BoolArray
    """Whether each row is one of them, shape (2, m)."""
    group: NDArray[np.int32]
    """The stances of a frontier in one row, shape (n,)."""

    @classmethod
    def allocate(cls, is_goal: BoolArray, table: TwoLimbTable) -> Levels:
        """Allocate arrays for the stances of a goal."""
        n, m = len(is_goal), table.degree.shape[1]
        reached, fresh, unchecked, on_level, ahead = np.zeros((5, 2, n, 2), dtype=np.int32)
        frontier, waiting = np.zeros((2, 2, n), dtype=np.int32)
        size, waiting_size = np.zeros(2, dtype=np.int64), np.zeros((2, m), dtype=np.int64)
        active, group = np.zeros((2 * m, 2), dtype=np.int32), np.zeros(n, dtype=np.int32)
        is_checked, is_active = np.zeros((n, 2), dtype=np.bool_), np.zeros((2, m), dtype=np.bool_)
        # A stance is on no more levels than it has branches, and once more at the goal.
        log = Log.allocate(n + int(np.bitwise_count(table.branch_sets).sum()))
        releasable = np.zeros((n, 2), dtype=np.int32)
        frontiers = reached, fresh, unchecked, on_level, ahead, frontier, size
        rows = waiting, waiting_size, active, is_active, group
        return cls(is_goal, is_checked, releasable, log, *frontiers, *rows)


@kernel
def enter(s: int, support: int, branches: int, unchecked: int, parity: int, levels: Levels) -> None:
    """Add branches of a stance to a frontier."""
    fresh = levels.fresh[parity, s]
    if fresh[0] == 0 and fresh[1] == 0:
        levels.frontier[parity, levels.size[parity]] = s
        levels.size[parity] += 1
    if fresh[support]:
        unchecked = min(unchecked, levels.unchecked[parity, s, support])
    fresh[support] |= branches
    levels.unchecked[parity, s, support] = unchecked


@kernel
def clear_frontier(parity: int, levels: Levels) -> None:
    """Remove all stances from a frontier."""
    for f in range(levels.size[parity]):
        s = levels.frontier[parity, f]
        levels.fresh[parity, s, 0] = levels.fresh[parity, s, 1] = 0
    levels.size[parity] = 0


@kernel
def active_rows(parity: int, table: TwoLimbTable, levels: Levels) -> int:
    """List the rows that have stances of a frontier; return their number."""
    count = 0
    for f in range(levels.size[parity]):
        s = levels.frontier[parity, f]
        for support in range(2):
            point = table.points[s, support]
            if levels.fresh[parity, s, support] and not levels.is_active[support, point]:
                levels.is_active[support, point] = True
                levels.active[count, 0], levels.active[count, 1] = support, point
                count += 1
    return count


@kernel
def take_group(
    support: int, point: int, parity: int, table: TwoLimbTable, levels: Levels
) -> tuple[int, int]:
    """List the stances of a frontier in a row; return their number and all of their branches.

    The one with the fewest unchecked steps comes first.
    """
    count, together, least = 0, EMPTY, MOST_UNCHECKED
    levels.is_active[support, point] = False
    for k in range(table.row_start[support, point], table.row_start[support, point + 1]):
        s = table.rows[support, k]
        if levels.fresh[parity, s, support]:
            together |= levels.fresh[parity, s, support]
            levels.group[count] = s
            if levels.unchecked[parity, s, support] < least:
                least = levels.unchecked[parity, s, support]
                levels.group[count], levels.group[0] = levels.group[0], s
            count += 1
    return count, together


@kernel
def kept_at_most(
    support: int, before: int, after: int, table: TwoLimbTable, levels: Levels
) -> tuple[int, int]:
    """Return branches that a support limb keeps at most on a step, and 1 if it is unchecked."""
    if levels.is_checked[before, support] and levels.is_checked[after, support]:
        edge = table.edges[edge_index(support, before, after, table)]
        if edge.known:
            return branches_kept(edge), 0
        if edge.kept:
            return branches_kept(edge), 1
    return ALL, 1


@entry
def compute_remaining(
    goals: IntArray, table: TwoLimbTable, origins: Origins, levels: Levels
) -> int:
    """Compute the steps that remain from supports by breadth-first search from the goal stances.

    Returns the fewest steps from an origin, where the search ends; -1 if no path leads from there.
    """
    level, entries, log = 0, 0, levels.log
    _reset(table, levels)
    log.start[0] = 0
    for s in goals:
        for support in range(2):
            if levels.releasable[s, 1 - support]:
                enter(s, support, table.branch_sets[s, support], 0, 0, levels)
    for f in range(levels.size[0]):
        _log_goal(levels.frontier[0, f], f, levels)
    while levels.size[level % 2]:
        entries += levels.size[level % 2]
        log.start[level + 1] = entries
        last, level = level % 2, level + 1
        for r in range(active_rows(last, table, levels)):
            _reach_supports(levels.active[r, 0], levels.active[r, 1], level, table, levels)
        clear_frontier(last, levels)
        for f in range(levels.size[level % 2]):
            _reach_arrivals(levels.frontier[level % 2, f], level % 2, entries + f, table, levels)
        for k in range(len(origins.nodes)):
            for support in range(2):
                if (
                    origins.supports[k, support]
                    & levels.reached[SUPPORT, origins.nodes[k], support]
                ):
                    log.start[level + 1] = entries + levels.size[level % 2]
                    return level
    return -1


@kernel
def _reset(table: TwoLimbTable, levels: Levels) -> None:
    """Forget all that was reached; no support at the goal, or that cannot move, waits."""
    levels.reached[...] = 0
    levels.fresh[...] = 0
    levels.size[...] = 0
    for support in range(2):
        for point in range(levels.waiting_size.shape[1]):
            first, count = table.row_start[support, point], 0
            for k in range(first, table.row_start[support, point + 1]):
                s = table.rows[support, k]
                if levels.releasable[s, 1 - support] and not levels.is_goal[s]:
                    levels.waiting[support, first + count] = s
                    count += 1
            levels.waiting_size[support, point] = count


@kernel
def _log_goal(s: int, entry: int, levels: Levels) -> None:
    """Log a stance at the goal, whose arrivals are in the frontier."""
    log = levels.log
    log.stances[entry] = s
    for limb in range(2):
        log.branches[entry, SUPPORT, limb] = 0
        log.branches[entry, ARRIVAL, limb] = levels.fresh[0, s, limb]
        log.unchecked[entry, SUPPORT, limb] = log.unchecked[entry, ARRIVAL, limb] = 0
        levels.reached[ARRIVAL, s, limb] = levels.fresh[0, s, limb]


@kernel
def _reach_supports(
    support: int, point: int, level: int, table: TwoLimbTable, levels: Levels
) -> None:
    """Record the supports of a row from which steps lead to the arrivals of the last level."""
    last, first, k = (level - 1) % 2, table.row_start[support, point], 0
    count, together = take_group(support, point, last, table, levels)
    while k < levels.waiting_size[support, point]:
        s, got = levels.waiting[support, first + k], EMPTY
        missing = table.branch_sets[s, support] & ~levels.reached[SUPPORT, s, support]
        # Over steps that were checked, then over the first of the others for each branch.
        for more in range(2):
            rest = missing & together if more or levels.is_checked[s, support] else EMPTY
            for g in range(count):
                if rest == 0:
                    break
                after = levels.group[g]
                new = rest & levels.fresh[last, after, support]
                if new == 0 or after == s:
                    continue
                kept, is_unchecked = kept_at_most(support, s, after, table, levels)
                new = kept_on_edge(new, kept)
                if is_unchecked == more and new:
                    unchecked = levels.unchecked[last, after, support] + more
                    enter(s, support, new, unchecked, level % 2, levels)
                    got |= new
                    if more:
                        rest &= ~new
        if missing == got:
            levels.waiting_size[support, point] -= 1
            end = first + levels.waiting_size[support, point]
            levels.waiting[support, first + k] = levels.waiting[support, end]
        else:
            k += 1


@kernel
def _reach_arrivals(s: int, parity: int, entry: int, table: TwoLimbTable, levels: Levels) -> None:
    """Replace the new supports of a stance by its new arrivals, and log both."""
    log, fresh, unchecked = levels.log, levels.fresh[parity, s], levels.unchecked[parity, s]
    log.stances[entry] = s
    for limb in range(2):
        log.branches[entry, SUPPORT, limb] = fresh[limb]
        log.unchecked[entry, SUPPORT, limb] = unchecked[limb] if fresh[limb] else MOST_UNCHECKED
        levels.reached[SUPPORT, s, limb] |= fresh[limb]
    for limb in range(2):
        new, least = int(log.branches[entry, SUPPORT, limb]), log.unchecked[entry, SUPPORT, limb]
        if log.branches[entry, SUPPORT, 1 - limb] & levels.releasable[s, 1 - limb]:
            new |= levels.releasable[s, limb]
            least = min(least, log.unchecked[entry, SUPPORT, 1 - limb])
        new &= ~levels.reached[ARRIVAL, s, limb]
        log.branches[entry, ARRIVAL, limb], log.unchecked[entry, ARRIVAL, limb] = new, least
        fresh[limb], unchecked[limb] = new, least
        levels.reached[ARRIVAL, s, limb] |= new
