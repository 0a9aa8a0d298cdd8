"""Kernels over `StepTables`: the steps that leave states, by the rule of `transitions.rule`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.transitions.rule import can_release, kept_on_edge


@entry
def steps_of_state(
    s: int, masks: tuple[int, int], tables: Any, steps: IntArray, kept: IntArray
) -> tuple[int, int]:
    """The steps that leave a state.

    Args:
        s: Stance index.
        masks: Branches that each limb may be on.
        tables: `StepTables`.
        steps: Their indices in the tables, written.
        kept: Branches that the limb that holds keeps on each, written.

    Returns:
        How many move limb 0, and how many there are.
    """
    first = count = 0
    for moving in range(2):
        if can_release(masks[moving], tables.releasable[s, moving]):
            for e in range(tables.start[2 * s + moving], tables.start[2 * s + moving + 1]):
                branches = kept_on_edge(masks[1 - moving], tables.kept[e])
                if branches:
                    steps[count], kept[count] = e, branches
                    count += 1
        if moving == 0:
            first = count
    return first, count


@entry
def legal_actions(stances: IntArray, masks: IntArray, tables: Any, out: NDArray[np.int8]) -> None:
    """Mark the actions that states allow.

    Args:
        stances: Stance indices, shape (k,).
        masks: Branches each limb may be on, shape (k, 2).
        tables: `StepTables`.
        out: Zeros, shape (k, 2 m); ones are written.
    """
    points, start, after, kept = tables.points, tables.start, tables.after, tables.kept
    m = out.shape[1] // 2
    for k in range(len(stances)):
        s = stances[k]
        for moving in range(2):
            if not can_release(masks[k, moving], tables.releasable[s, moving]):
                continue
            of_held = masks[k, 1 - moving]
            for e in range(start[2 * s + moving], start[2 * s + moving + 1]):
                if kept_on_edge(of_held, kept[e]):
                    out[k, moving * m + points[after[e], moving]] = 1


@entry
def legal_positions(
    stances: IntArray,
    masks: IntArray,
    tables: Any,
    out: NDArray[np.int8],
    position: Array,
    releasable_after: NDArray[np.int8],
) -> None:
    """Mark the actions that states allow and write where the base is after each.

    Args:
        stances: Stance indices, shape (k,).
        masks: Branches each limb may be on, shape (k, 2).
        tables: `StepTables`.
        out: Zeros, shape (k, 2, m); ones are written.
        position: Shape (k, 2, m, 3); base positions [m] are written for the actions allowed.
        releasable_after: Zeros, shape (k, 2, m); ones are written where the limb that holds could
            be released after the action.
    """
    for k in range(len(stances)):
        s = stances[k]
        for moving in range(2):
            if not can_release(masks[k, moving], tables.releasable[s, moving]):
                continue
            of_held = masks[k, 1 - moving]
            for e in range(tables.start[2 * s + moving], tables.start[2 * s + moving + 1]):
                kept = kept_on_edge(of_held, tables.kept[e])
                if kept:
                    s2 = tables.after[e]
                    point = tables.points[s2, moving]
                    out[k, moving, point] = 1
                    if can_release(kept, tables.releasable[s2, 1 - moving]):
                        releasable_after[k, moving, point] = 1
                    for axis in range(3):
                        position[k, moving, point, axis] = tables.base_in_world[s2, axis]


@entry
def find_step(s: int, moving: int, s2: int, tables: Any) -> int:
    """Index of the step from stance `s` to `s2` that moves limb `moving`, or -1."""
    low, high = tables.start[2 * s + moving], tables.start[2 * s + moving + 1]
    target = tables.points[s2, moving]
    while low < high:
        middle = (low + high) // 2
        if tables.points[tables.after[middle], moving] < target:
            low = middle + 1
        else:
            high = middle
    if low < tables.start[2 * s + moving + 1] and tables.after[low] == s2:
        step: int = low
        return step
    return -1


@entry
def any_step(s: int, masks: tuple[int, int], tables: Any) -> bool:
    """Whether a step leaves stance `s` with its limbs on these branches."""
    for moving in range(2):
        if can_release(masks[moving], tables.releasable[s, moving]):
            for e in range(tables.start[2 * s + moving], tables.start[2 * s + moving + 1]):
                if kept_on_edge(masks[1 - moving], tables.kept[e]):
                    return True
    return False
