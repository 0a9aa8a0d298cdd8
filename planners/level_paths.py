"""Paths of the fewest steps that `level_graph` has computed, and their cuts (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import EMPTY
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.planners.level_graph import (
    ARRIVAL,
    MOST_UNCHECKED,
    SUPPORT,
    Levels,
    Origins,
    active_rows,
    clear_frontier,
    enter,
    kept_at_most,
    take_group,
)
from mlivr_gym.stances.two_limb_steps import TwoLimbTable
from mlivr_gym.transitions.rule import can_release, kept_on_edge

LARGEST_CUT = 1024
"""Largest number of unchecked steps of a cut that are listed."""


class Cuts(NamedTuple):
    """Unchecked steps on the paths of fewest steps, by the steps that remain before each of them.

    Those before which as many steps remain are a cut: every path has one of them, or one that was
    checked.
    """

    is_wanted: BoolArray
    """Whether each cut is listed, shape (D + 1,)."""
    size: IntArray
    """Number of the steps listed of each cut, shape (D + 1,)."""
    steps: IntArray
    """Support limb, stance before, stance after and unchecked steps on a path along each of them,
    shape (D + 1, LARGEST_CUT, 4)."""

    @classmethod
    def allocate(cls, is_wanted: BoolArray) -> Cuts:
        """Allocate arrays for the cuts that are to be listed."""
        steps = np.empty((len(is_wanted), LARGEST_CUT, 4), dtype=np.int64)
        return cls(is_wanted, np.zeros(len(is_wanted), dtype=np.int64), steps)


@kernel
def _load(remaining: int, is_reached: bool, levels: Levels) -> None:
    """Set what was reached on a level, or clear it."""
    log = levels.log
    for k in range(log.start[remaining], log.start[remaining + 1]):
        s = log.stances[k]
        for kind in range(2):
            for limb in range(2):
                branches = int(log.branches[k, kind, limb])
                levels.on_level[kind, s, limb] = branches if is_reached else EMPTY
                levels.ahead[kind, s, limb] = log.unchecked[k, kind, limb]


@entry
def find_path(table: TwoLimbTable, origins: Origins, levels: Levels, path: IntArray) -> int:
    """Find a path of fewest steps after `compute_remaining`; return its unchecked steps.

    Support limb, stance before, stance after and branches kept at most of each step are written
    into `path`, shape (D, 4). Steps to fewer unchecked ones are preferred, and of those the
    shortest.
    """
    steps, total, least = len(path), 0, MOST_UNCHECKED
    s, support, branches = 0, 0, EMPTY
    _load(steps, True, levels)
    for k in range(len(origins.nodes)):
        for limb in range(2):
            node = origins.nodes[k]
            able = origins.supports[k, limb] & levels.on_level[SUPPORT, node, limb]
            if able and levels.ahead[SUPPORT, node, limb] < least:
                s, support, branches = node, limb, able
                least = levels.ahead[SUPPORT, node, limb]
    for step in range(steps):
        _load(steps - step, False, levels)
        _load(steps - step - 1, True, levels)
        row, moving = path[step], 1 - support
        total += _write_step(s, support, branches, table, levels, row)
        s, branches = row[2], row[3]
        same, other = branches & levels.on_level[SUPPORT, s, support], EMPTY
        if can_release(branches, levels.releasable[s, support]):
            other = levels.on_level[SUPPORT, s, moving] & levels.releasable[s, moving]
        unchecked = levels.ahead[SUPPORT, s]
        if other and (same == 0 or unchecked[moving] < unchecked[support]):
            support, branches = moving, other
        else:
            branches = same
    _load(0, False, levels)
    return total


@kernel
def _write_step(
    s: int,
    support: int,
    branches: int,
    table: TwoLimbTable,
    levels: Levels,
    row: IntArray,
) -> int:
    """Write a step from a support to an arrival of the level; return 1 if it is unchecked."""
    point, least, nearest, is_unchecked = table.points[s, support], MOST_UNCHECKED, np.inf, 0
    for k in range(table.row_start[support, point], table.row_start[support, point + 1]):
        after, distance = table.rows[support, k], 0.0
        some = branches & levels.on_level[ARRIVAL, after, support]
        if some == 0 or after == s:
            continue
        kept, more = kept_at_most(support, s, after, table, levels)
        some = kept_on_edge(some, kept)
        unchecked = levels.ahead[ARRIVAL, after, support] + more
        if some == 0 or unchecked > least:
            continue
        for axis in range(3):
            distance += (table.base[after, axis] - table.base[s, axis]) ** 2
        if unchecked < least or distance < nearest:
            least, nearest, is_unchecked = unchecked, distance, more
            row[0], row[1], row[2], row[3] = support, s, after, some
    return is_unchecked


@entry
def find_cuts(table: TwoLimbTable, origins: Origins, levels: Levels, cuts: Cuts) -> int:
    """Find cuts of the paths of fewest steps, after `compute_remaining`.

    Returns the number of stances expanded.
    """
    levels.fresh[...] = 0
    levels.size[...] = 0
    expanded, steps = 0, len(cuts.size) - 1
    _load(steps, True, levels)
    for k in range(len(origins.nodes)):
        for support in range(2):
            _enter_on_level(
                origins.nodes[k], support, origins.supports[k, support], 0, steps % 2, levels
            )
    for remaining in range(steps, 0, -1):
        now = remaining % 2
        _load(remaining, False, levels)
        _load(remaining - 1, True, levels)
        for r in range(active_rows(now, table, levels)):
            row = levels.active[r]
            _follow(row[0], row[1], remaining, table, levels, cuts)
        expanded += levels.size[now]
        clear_frontier(now, levels)
    _load(0, False, levels)
    return expanded


@kernel
def _enter_on_level(
    s: int,
    support: int,
    branches: int,
    unchecked: int,
    parity: int,
    levels: Levels,
) -> None:
    """Add those supports of a stance that are on the level to a frontier."""
    some = branches & levels.on_level[SUPPORT, s, support]
    if some:
        enter(s, support, some, unchecked, parity, levels)


@kernel
def _follow(
    support: int,
    point: int,
    remaining: int,
    table: TwoLimbTable,
    levels: Levels,
    cuts: Cuts,
) -> None:
    """Follow the paths along the steps of a row, and list those that are unchecked."""
    now, moving = remaining % 2, 1 - support
    count, together = take_group(support, point, now, table, levels)
    for k in range(table.row_start[support, point], table.row_start[support, point + 1]):
        after, got, least = table.rows[support, k], EMPTY, MOST_UNCHECKED
        arriving = together & levels.on_level[ARRIVAL, after, support]
        for g in range(count if arriving else 0):
            s = levels.group[g]
            some = arriving & levels.fresh[now, s, support]
            if some == 0 or s == after:
                continue
            kept, more = kept_at_most(support, s, after, table, levels)
            unchecked = levels.unchecked[now, s, support] + more
            if kept_on_edge(some, kept):
                got |= kept_on_edge(some, kept)
                least = min(least, unchecked)
            if more and cuts.is_wanted[remaining] and cuts.size[remaining] < LARGEST_CUT:
                row = cuts.steps[remaining, cuts.size[remaining]]
                row[0], row[1], row[2] = support, s, after
                row[3] = unchecked + levels.ahead[ARRIVAL, after, support]
                cuts.size[remaining] += 1
        if got:
            _enter_on_level(after, support, got, least, 1 - now, levels)
            if can_release(got, levels.releasable[after, support]):
                held = levels.releasable[after, moving]
                _enter_on_level(after, moving, held, least, 1 - now, levels)
