"""Kernels on `StepTables`: the steps that leave states, by the rule of `transitions.rule`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.transitions.rule import can_release, kept_on_edge

TOGETHER = 64
"""Number of states whose steps are fetched at once."""

LINE = 32
"""Number of points, or branch sets of kept branches, on a line of the processor's cache."""


@entry
def steps_of_state(
    s: int, branch_sets: tuple[int, int], tables: Any, steps: IntArray, kept: IntArray
) -> tuple[int, int]:
    """List the steps that leave a state: their indices, and the branches that the support keeps.

    Returns the number of those that move limb 0, and of all.
    """
    first = count = 0
    for moving in range(2):
        if can_release(branch_sets[moving], tables.releasable[s, moving]):
            for e in range(tables.start[2 * s + moving], tables.start[2 * s + moving + 1]):
                branches = kept_on_edge(branch_sets[1 - moving], tables.kept[e])
                if branches:
                    steps[count], kept[count] = e, branches
                    count += 1
        if moving == 0:
            first = count
    return first, count


@entry
def valid_actions(
    stances: IntArray, branch_sets: IntArray, tables: Any, out: NDArray[np.int8]
) -> np.uint16:
    """Mark the valid actions of k states by ones in `out`, zeros of shape (k, 2, m).

    The steps of random stances lie far from each other in tables larger than the processor's
    caches. To fetch them for several states at once is twice as fast as state by state. The number
    returned has no meaning but that the compiler cannot omit the fetching.
    """
    start, to_point, kept, read = tables.start, tables.to_point, tables.kept, np.uint16(0)
    for first in range(0, len(stances), TOGETHER):
        last = min(first + TOGETHER, len(stances))
        for k in range(first, last):
            for e in range(start[2 * stances[k]], start[2 * stances[k] + 2], LINE):
                read += to_point[e] ^ kept[e]
        for k in range(first, last):
            s = stances[k]
            for moving in range(2):
                if can_release(branch_sets[k, moving], tables.releasable[s, moving]):
                    row = out[k, moving]
                    of_support: Any = np.uint16(branch_sets[k, 1 - moving])
                    for e in range(start[2 * s + moving], start[2 * s + moving + 1]):
                        row[to_point[e]] = kept_on_edge(of_support, kept[e]) != 0
    return read


@entry
def valid_positions(
    stances: IntArray,
    branch_sets: IntArray,
    tables: Any,
    out: NDArray[np.int8],
    position: Array,
    releasable_after: NDArray[np.int8],
) -> None:
    """Mark the valid actions of k states, and write the base position [m] after each.

    The outputs are zeros of shape (k, 2, m), and (k, 2, m, 3) for positions; `releasable_after`
    receives ones if the support limb could be released after the action.
    """
    for k in range(len(stances)):
        s = stances[k]
        for moving in range(2):
            if not can_release(branch_sets[k, moving], tables.releasable[s, moving]):
                continue
            of_support = branch_sets[k, 1 - moving]
            for e in range(tables.start[2 * s + moving], tables.start[2 * s + moving + 1]):
                kept = kept_on_edge(of_support, tables.kept[e])
                if kept:
                    s2 = tables.after[e]
                    point = tables.to_point[e]
                    out[k, moving, point] = 1
                    if can_release(kept, tables.releasable[s2, 1 - moving]):
                        releasable_after[k, moving, point] = 1
                    for axis in range(3):
                        position[k, moving, point, axis] = tables.base_position[s2, axis]


class LookaheadGoals(NamedTuple):
    """Goals of k states, and the lookahead of points behind the steps of the tables."""

    goals: Array
    """Goal positions [m], shape (k, 3)."""
    tolerance: float
    """Radius of the goal regions [m]."""
    free: NDArray[np.bool_]
    """Whether each point may be grasped, shape (k, m)."""
    of_points: Array
    """Distances and arrivals of points, see `agents.features.point_lookahead`, (k, 2, m, 2 d)."""


@entry
def write_action_lookahead(
    stances: IntArray, branch_sets: IntArray, tables: Any, ahead: LookaheadGoals, out: Array
) -> None:
    """Compute how close to the goal each action can lead with any step after it.

    The first d + 1 entries of `out`, shape (k, 2, m, 2 d + 2), have the distance without steps. For
    valid actions they receive the minimum distances over the steps that follow, after that step and
    after 1 to d more; the other entries receive the sums of the arrivals.
    """
    depth = ahead.of_points.shape[3] // 2
    for k in range(len(stances)):
        s = stances[k]
        for moving in range(2):
            if not can_release(branch_sets[k, moving], tables.releasable[s, moving]):
                continue
            of_support = branch_sets[k, 1 - moving]
            for e in range(tables.start[2 * s + moving], tables.start[2 * s + moving + 1]):
                kept = kept_on_edge(of_support, tables.kept[e])
                if kept:
                    s2 = tables.after[e]
                    grasped = tables.releasable[s2, moving]
                    after = (grasped, kept) if moving == 0 else (kept, grasped)
                    point = tables.points[s2, moving]
                    _look_ahead(k, (s2, after), tables, ahead, out[k, moving, point], depth)


@kernel
def _look_ahead(
    k: int,
    state: tuple[int, tuple[int, int]],
    tables: Any,
    ahead: LookaheadGoals,
    out: Array,
    depth: int,
) -> None:
    """Add the steps after one action to its row of `write_action_lookahead`, shape (2 d + 2,)."""
    s, branch_sets = state
    for moving in range(2):
        if not can_release(branch_sets[moving], tables.releasable[s, moving]):
            continue
        for e in range(tables.start[2 * s + moving], tables.start[2 * s + moving + 1]):
            s2 = tables.after[e]
            point = tables.to_point[e]
            if not ahead.free[k, point] or not kept_on_edge(
                branch_sets[1 - moving], tables.kept[e]
            ):
                continue
            squared = 0.0
            for axis in range(3):
                squared += (tables.base_position[s2, axis] - ahead.goals[k, axis]) ** 2
            away = np.sqrt(squared)
            out[0] = min(out[0], away)
            if away <= ahead.tolerance:
                out[depth + 1] += 1.0
            for d in range(depth):
                out[d + 1] = min(out[d + 1], ahead.of_points[k, moving, point, d])
                out[depth + 2 + d] += ahead.of_points[k, moving, point, depth + d]


@entry
def find_step(s: int, moving: int, point: int, tables: Any) -> int:
    """Return the index of the step from stance `s` that moves a limb to `point`, or -1."""
    low, end = tables.start[2 * s + moving], tables.start[2 * s + moving + 1]
    count = end - low
    while count > 0:  # without branches, which the processor would mispredict
        half = (count + 1) // 2
        low += half * (tables.to_point[low + half - 1] < point)
        count -= half
    found: int = low if low < end and tables.to_point[low] == point else -1
    return found


@entry
def any_step(s: int, branch_sets: tuple[int, int], tables: Any) -> bool:
    """Return whether a step leaves stance `s` with its limbs on these branches."""
    for moving in range(2):
        if can_release(branch_sets[moving], tables.releasable[s, moving]):
            for e in range(tables.start[2 * s + moving], tables.start[2 * s + moving + 1]):
                if kept_on_edge(branch_sets[1 - moving], tables.kept[e]):
                    return True
    return False
