"""Paths of two limbs with the fewest steps, of these with the fewest unchecked ones (compiled).

A step that was not checked is assumed to keep all branches that both of its stances have, so the
fewest steps over the graph bound those of every plan from below. A *support* is a stance at which
one limb stays on one branch while the other moves next; an *arrival* is one at which the other limb
has just grasped. After it that limb may move again, or the supporting one if it can be released.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import EMPTY, has, only
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.stances.two_limb_steps import TwoLimbTable, branches_kept, edge_index
from mlivr_gym.transitions.rule import can_release, kept_on_edge

BITS = 16
"""Number of branches and flips in a branch set."""

SUPPORT, ARRIVAL = 0, 1
"""Indices of supports and arrivals in `Levels`."""

UNREACHED = 2**16 - 1
"""Steps that remain from a support that was not reached."""

LARGEST_CUT = 1024
"""Largest number of unchecked steps of a cut that are listed."""


class Origins(NamedTuple):
    """States at which paths may start, before any step."""

    nodes: IntArray
    """The stances, shape (k,)."""
    branch_sets: IntArray
    """Branches that the limbs may be on, shape (k, 2)."""


class Levels(NamedTuple):
    """Arrays for breadth-first searches over n stances."""

    remaining: NDArray[np.uint16]
    """Fewest steps to the goal from supports and from arrivals, by stance, limb and branch, shape
    (2, n, 2, 16)."""
    unchecked: NDArray[np.uint16]
    """Fewest unchecked steps on paths of fewest steps, shape (2, n, 2, 16)."""
    supports: IntArray
    """Branches of the supports reached on earlier levels, shape (n, 2)."""
    arrivals: IntArray
    """Branches of the arrivals reached, shape (n, 2)."""
    is_goal: BoolArray
    """Whether each stance is at the goal, shape (n,)."""
    fresh: IntArray
    """Branches reached on the last level and on this one, by its parity, shape (2, n, 2)."""
    frontier: NDArray[np.int32]
    """Stances that have some of them, shape (2, n)."""
    size: IntArray
    """Number of these stances, shape (2,)."""

    @classmethod
    def allocate(cls, is_goal: BoolArray) -> Levels:
        """Allocate arrays for the stances of a goal."""
        n = len(is_goal)
        remaining, unchecked = (np.empty((2, n, 2, BITS), dtype=np.uint16) for _ in range(2))
        supports, arrivals = (np.empty((n, 2), dtype=np.int64) for _ in range(2))
        fresh, frontier = np.empty((2, n, 2), dtype=np.int64), np.empty((2, n), dtype=np.int32)
        size = np.empty(2, dtype=np.int64)
        return cls(remaining, unchecked, supports, arrivals, is_goal, fresh, frontier, size)

    def reset(self) -> None:
        """Forget all that was reached."""
        self.remaining[...] = self.unchecked[...] = UNREACHED
        for array in (self.supports, self.arrivals, self.fresh, self.size):
            array[...] = 0


class Cuts(NamedTuple):
    """Unchecked steps on the paths with the fewest of them, one of each cut on every path."""

    sizes: IntArray
    """Number of the steps that are the first, second ... unchecked one of a path, shape (P,)."""
    steps: IntArray
    """Support limb, stance before and stance after of the first of them, (P, LARGEST_CUT, 3)."""

    @classmethod
    def allocate(cls, unchecked: int) -> Cuts:
        """Allocate arrays for paths with some number of unchecked steps."""
        steps = np.empty((unchecked, LARGEST_CUT, 3), dtype=np.int64)
        return cls(np.zeros(unchecked, dtype=np.int64), steps)


@kernel
def releasable(s: int, limb: int, table: TwoLimbTable) -> int:
    """Return the branches on which a limb can be released, those of the stance if unknown."""
    release = table.releases[s, limb]
    branches: int = table.branch_sets[s, limb]
    return release.branches if release.known else branches


@kernel
def supports_at_origin(k: int, support: int, table: TwoLimbTable, origins: Origins) -> int:
    """Return the branches of a support limb at an origin from which the other limb can move."""
    able = can_release(
        origins.branch_sets[k, 1 - support], releasable(origins.nodes[k], 1 - support, table)
    )
    branches: int = origins.branch_sets[k, support]
    return branches if able else EMPTY


@kernel
def _enter(s: int, support: int, branches: int, parity: int, levels: Levels) -> None:
    """Add branches of a stance to a frontier."""
    if levels.fresh[parity, s, 0] == 0 and levels.fresh[parity, s, 1] == 0:
        levels.frontier[parity, levels.size[parity]] = s
        levels.size[parity] += 1
    levels.fresh[parity, s, support] |= branches


@kernel
def _kept(support: int, before: int, after: int, table: TwoLimbTable) -> int:
    """Return the branches that a support limb keeps on a step, at most if it is unchecked."""
    kept = kept_on_edge(table.branch_sets[before, support], table.branch_sets[after, support])
    edge = table.edges[edge_index(support, before, after, table)]
    return kept_on_edge(kept, branches_kept(edge)) if edge.known else kept


@entry
def compute_remaining(
    goals: IntArray, table: TwoLimbTable, origins: Origins, levels: Levels
) -> int:
    """Compute the steps that remain from supports by breadth-first search from the goal stances.

    Returns the fewest steps from an origin, where the search ends; -1 if no path leads from there.
    """
    level = 0
    for s in goals:
        for support in range(2):
            if releasable(s, 1 - support, table):
                branches = table.branch_sets[s, support]
                levels.arrivals[s, support] = branches
                for b in range(BITS):
                    if has(branches, b):
                        _set(ARRIVAL, s, support, b, 0, 0, levels)
                _enter(s, support, branches, 0, levels)
    while levels.size[level % 2]:
        last, level = level % 2, level + 1
        for f in range(levels.size[last]):
            s = int(levels.frontier[last, f])
            for support in range(2):
                branches, levels.fresh[last, s, support] = levels.fresh[last, s, support], 0
                if branches:
                    _reach_supports(s, support, branches, level, table, levels)
        levels.size[last] = 0
        for f in range(levels.size[level % 2]):
            _reach_arrivals(int(levels.frontier[level % 2, f]), level, table, levels)
        for k in range(len(origins.nodes)):
            for support in range(2):
                able = supports_at_origin(k, support, table, origins)
                if able & levels.supports[origins.nodes[k], support]:
                    return level
    return -1


@kernel
def _reach_supports(
    after: int, support: int, branches: int, level: int, table: TwoLimbTable, levels: Levels
) -> None:
    """Record the supports from which steps lead to arrivals."""
    moving, point = 1 - support, table.points[after, support]
    for k in range(table.row_start[support, point], table.row_start[support, point + 1]):
        s = table.rows[support, k]
        new = branches & table.branch_sets[s, support] & ~levels.supports[s, support]
        if s == after or new == 0 or levels.is_goal[s] or releasable(s, moving, table) == 0:
            continue
        new &= _kept(support, s, after, table)
        if new == 0:
            continue
        more = 1 - table.edges[edge_index(support, s, after, table)].known
        _enter(s, support, new, level % 2, levels)
        for b in range(BITS):
            if has(new, b):
                unchecked = int(levels.unchecked[ARRIVAL, after, support, b]) + more
                _set(SUPPORT, s, support, b, level, unchecked, levels)


@kernel
def _reach_arrivals(s: int, level: int, table: TwoLimbTable, levels: Levels) -> None:
    """Replace the new supports of a stance by its new arrivals."""
    first, second = levels.fresh[level % 2, s, 0], levels.fresh[level % 2, s, 1]
    for support in range(2):
        moving, same, other = 1 - support, first, second
        if support:
            same, other = second, first
        levels.supports[s, support] |= same
        other &= releasable(s, moving, table)
        able = releasable(s, support, table) if other else EMPTY
        least = UNREACHED
        for b in range(BITS):
            if has(other, b):
                least = min(least, int(levels.unchecked[SUPPORT, s, moving, b]))
        new = (same | able) & ~levels.arrivals[s, support]
        for b in range(BITS):
            if has(new & same, b):
                unchecked = int(levels.unchecked[SUPPORT, s, support, b])
                _set(ARRIVAL, s, support, b, level, unchecked, levels)
            if has(new & able, b):
                _set(ARRIVAL, s, support, b, level, least, levels)
        levels.fresh[level % 2, s, support] = new
        levels.arrivals[s, support] |= new


@kernel
def _set(
    kind: int, s: int, support: int, b: int, remaining: int, unchecked: int, levels: Levels
) -> None:
    """Set the steps that remain, and the unchecked ones unless fewer are set."""
    levels.remaining[kind, s, support, b] = remaining
    levels.unchecked[kind, s, support, b] = min(
        int(levels.unchecked[kind, s, support, b]), unchecked
    )


@entry
def find_cuts(steps: int, table: TwoLimbTable, origins: Origins, levels: Levels, cuts: Cuts) -> int:
    """Find the cuts of the paths of fewest steps and unchecked steps, after `compute_remaining`.

    The latter number is the length of `cuts`. Returns the number of stances expanded.
    """
    levels.fresh[...] = 0
    levels.size[...] = 0
    expanded = 0
    for k in range(len(origins.nodes)):
        for support in range(2):
            able = supports_at_origin(k, support, table, origins)
            _enter_tight(origins.nodes[k], support, able, steps, len(cuts.sizes), levels)
    for remaining in range(steps, 0, -1):
        now = remaining % 2
        for f in range(levels.size[now]):
            s = int(levels.frontier[now, f])
            expanded += 1
            for support in range(2):
                branches, levels.fresh[now, s, support] = levels.fresh[now, s, support], 0
                if branches:
                    _follow(s, support, branches, remaining, table, levels, cuts)
        levels.size[now] = 0
    return expanded


@kernel
def _is_tight(
    kind: int, s: int, support: int, b: int, remaining: int, unchecked: int, levels: Levels
) -> bool:
    """Return whether so many steps and unchecked steps remain."""
    steps, rest = levels.remaining[kind, s, support, b], levels.unchecked[kind, s, support, b]
    return bool(steps == remaining and rest == unchecked)


@kernel
def _enter_tight(
    s: int, support: int, branches: int, remaining: int, unchecked: int, levels: Levels
) -> None:
    """Add the supports from which so many steps and unchecked steps remain to a frontier."""
    some = EMPTY
    for b in range(BITS):
        if has(branches, b) and _is_tight(SUPPORT, s, support, b, remaining, unchecked, levels):
            some |= only(b)
    if some:
        _enter(s, support, some, remaining % 2, levels)


@kernel
def _follow(
    s: int,
    support: int,
    branches: int,
    remaining: int,
    table: TwoLimbTable,
    levels: Levels,
    cuts: Cuts,
) -> None:
    """Follow the steps of the paths from supports, and list those that are unchecked."""
    moving, point = 1 - support, table.points[s, support]
    for k in range(table.row_start[support, point], table.row_start[support, point + 1]):
        after = table.rows[support, k]
        kept, listed = branches & levels.arrivals[after, support], -1
        if after == s or kept == 0 or releasable(after, moving, table) == 0:
            continue
        kept &= _kept(support, s, after, table)
        if kept == 0:
            continue
        more = 1 - int(table.edges[edge_index(support, s, after, table)].known)
        for b in range(BITS):
            rest = int(levels.unchecked[SUPPORT, s, support, b]) - more
            if not (
                has(kept, b) and _is_tight(ARRIVAL, after, support, b, remaining - 1, rest, levels)
            ):
                continue
            if more and rest != listed:
                listed = rest
                _list(len(cuts.sizes) - rest - 1, support, s, after, cuts)
            _enter_tight(after, support, only(b), remaining - 1, rest, levels)
            if can_release(only(b), releasable(after, support, table)):
                held = releasable(after, moving, table)
                _enter_tight(after, moving, held, remaining - 1, rest, levels)


@kernel
def _list(cut: int, support: int, s: int, after: int, cuts: Cuts) -> None:
    """Count a step of a cut, and list it."""
    if cuts.sizes[cut] < LARGEST_CUT:
        row = cuts.steps[cut, cuts.sizes[cut]]
        row[0], row[1], row[2] = support, s, after
    cuts.sizes[cut] += 1


@entry
def unchecked_from_origins(
    steps: int, table: TwoLimbTable, origins: Origins, levels: Levels
) -> int:
    """Return the fewest unchecked steps on paths of some steps from the origins."""
    least = UNREACHED
    for k in range(len(origins.nodes)):
        for support in range(2):
            able = supports_at_origin(k, support, table, origins)
            for b in range(BITS):
                if (
                    has(able, b)
                    and levels.remaining[SUPPORT, origins.nodes[k], support, b] == steps
                ):
                    least = min(least, int(levels.unchecked[SUPPORT, origins.nodes[k], support, b]))
    return least


@entry
def find_path(
    unchecked: int, table: TwoLimbTable, origins: Origins, levels: Levels, path: IntArray
) -> None:
    """Find one of the paths of fewest steps and unchecked steps, after `compute_remaining`.

    Support limb, stance before and stance after of each step are written into `path`, (D, 3).
    """
    s, support, branch, rest = 0, 0, -1, unchecked
    for k in range(len(origins.nodes)):
        for limb in range(2):
            able = supports_at_origin(k, limb, table, origins)
            for b in range(BITS):
                node = origins.nodes[k]
                if has(able, b) and _is_tight(SUPPORT, node, limb, b, len(path), unchecked, levels):
                    s, support, branch = node, limb, b
    for step in range(len(path)):
        remaining = len(path) - step - 1
        after, rest = _tight_step(s, support, branch, remaining, rest, table, levels)
        path[step, 0], path[step, 1], path[step, 2], s = support, s, after, after
        if remaining and not _is_tight(SUPPORT, s, support, branch, remaining, rest, levels):
            support = 1 - support
            for b in range(BITS):
                if has(releasable(s, support, table), b) and _is_tight(
                    SUPPORT, s, support, b, remaining, rest, levels
                ):
                    branch = b


@kernel
def _tight_step(
    s: int,
    support: int,
    branch: int,
    remaining: int,
    rest: int,
    table: TwoLimbTable,
    levels: Levels,
) -> tuple[int, int]:
    """Return the stance after a step of the paths, and the unchecked steps that remain then."""
    point = table.points[s, support]
    for k in range(table.row_start[support, point], table.row_start[support, point + 1]):
        after = table.rows[support, k]
        kept = has(_kept(support, s, after, table), branch)
        if after != s and kept and releasable(after, 1 - support, table):
            more = 1 - int(table.edges[edge_index(support, s, after, table)].known)
            if _is_tight(ARRIVAL, after, support, branch, remaining, rest - more, levels):
                return int(after), rest - more
    return -1, -1
