"""Which stances of a roadmap serve: those that the shortest walks to many goals pass through.

Of an exploration most stances are the end of no walk but their own. A walk over the stances that
serve most is hardly longer than over all, and these are fewer to check, to keep and to search.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from mlivr_gym.arrays import Array, BoolArray, IntArray

TREES = 60
"""Goals to which the shortest walks are looked for."""

AROUND = 0.1
"""Radius of a goal region [m]."""

LEAST = 1e-6
"""Added to every base translation, so that no step is for nothing [m]."""

UNREACHED = -9999
"""What the search puts before a stance that nothing leads on from."""

Progress = Callable[[float], None]
"""Called with the share of the work that is done."""


def use_of(
    pairs: IntArray, base_position: Array, cost: str, progress: Progress | None = None
) -> Array:
    """How much each stance serves, shape (n,).

    It counts, for each goal, the square root of the number of stances whose walk passes through it.

    Args:
        pairs: Stances that are joined, shape (p, 2).
        base_position: Base positions of the stances [m], shape (n, 3); goals are among them.
        cost: `"steps"` for the walks of fewest steps, `"base"` for those of least base translation.
        progress: Called with the share of the work that is done.
    """
    count, (a, b) = len(base_position), pairs.T
    length = np.ones(len(a))
    if cost == "base":
        length = np.linalg.norm(base_position[a] - base_position[b], axis=1) + LEAST
    places = np.concatenate([a, b]), np.concatenate([b, a])
    matrix = scipy.sparse.csr_array(
        (np.concatenate([length, length]), places), shape=(count, count)
    )
    rng, use = np.random.default_rng(0), np.zeros(count)
    for k in range(TREES):
        goal = base_position[rng.integers(count)]
        goals = np.flatnonzero(np.linalg.norm(base_position - goal, axis=1) <= AROUND)
        _, before, _ = scipy.sparse.csgraph.dijkstra(
            matrix, indices=goals, min_only=True, return_predecessors=True
        )
        use += np.sqrt(_passing(before, goals))
        if progress is not None:
            progress((k + 1) / TREES)
    return use


def most_used(use: Array, most: int) -> BoolArray:
    """The stances that serve most, shape (n,): all if there are no more than that."""
    chosen = np.zeros(len(use), dtype=np.bool_)
    chosen[np.argsort(-use, kind="stable")[:most]] = True
    return chosen


def _passing(before: IntArray, goals: IntArray) -> Array:
    """How many stances there are behind each in a tree of walks to some goals, shape (n,).

    Args:
        before: The stance that comes next on the way to the goals, shape (n,).
        goals: The goals, shape (g,).
    """
    layers, known = [goals], np.zeros(len(before), dtype=np.bool_)
    known[goals] = True
    waiting = np.flatnonzero((before != UNREACHED) & ~known)
    while len(waiting):
        here = known[before[waiting]]
        layers.append(waiting[here])
        waiting = waiting[~here]
        known[layers[-1]] = True
    behind = np.zeros(len(before))
    for layer in reversed(layers[1:]):
        np.add.at(behind, before[layer], behind[layer] + 1.0)
    return behind
