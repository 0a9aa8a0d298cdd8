"""Costs to a goal region when steps are not checked, by searches backward (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.planners.pair_search import EXHAUSTED, FOUND, NO_ROOM, Progress, Weights
from mlivr_gym.planners.queue import Queue, first, grown, has_room, pop, push, queue
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.pair_steps import PairTable


@entry
def steps_to_goal(
    goal: BoolArray, table: PairTable, value: Array, opened: BoolArray, waiting: IntArray
) -> None:
    """Fewest steps from every stance to the goal region when steps are not checked.

    A breadth-first search in which each row is opened once: all its stances are one step from the
    first of them that was reached.

    Args:
        goal: Which stances are goals, shape (n,).
        table: The stances; those without a branch are omitted.
        value: Infinities, shape (n,), filled with the steps but where no goal can be reached.
        opened: False, shape (2, m).
        waiting: Scratch, shape (n,).
    """
    n = len(goal)
    rows, row_start, points, mask = table.rows, table.row_start, table.points, table.mask
    head = tail = 0
    for s in range(n):
        if goal[s] and mask[s, 0]:
            value[s] = 0.0
            waiting[tail] = s
            tail += 1
    while head < tail:
        s = waiting[head]
        head += 1
        for held in range(2):
            point = points[s, held]
            if opened[held, point]:
                continue
            opened[held, point] = True
            for k in range(row_start[held, point], row_start[held, point + 1]):
                s2 = rows[held, k]
                if value[s2] == np.inf and mask[s2, 0]:
                    value[s2] = value[s] + 1.0
                    waiting[tail] = s2
                    tail += 1


def distance_to_goal(
    graph: PairGraph,
    goal: BoolArray,
    weights: Weights,
    start: int = -1,
    toward: Array | None = None,
) -> Array:
    """Exact cost from stances to the goal region when steps are not checked, shape (n,).

    It is found by a search backward from the goal. Moving one limb twice in a row never pays, so a
    stance reached along a row does not open that row again.

    Args:
        graph: The stance graph; stances without a branch are omitted.
        goal: Which stances are goals, shape (n,).
        weights: What is minimised.
        start: Stance at which to stop, or -1 to go on to the end; infinity is left where the
            search did not get to.
        toward: Lower bound of the cost between each stance and the start, shape (n,).
    """
    n = len(goal)
    cost = Costs(np.full(n, np.inf), np.full(n, np.inf), np.full(n, -1))
    entries, progress = queue(n + 1), Progress.row()
    progress["after"] = start
    toward = np.zeros(n) if toward is None else toward
    while _distance(goal, toward, weights, graph.steps, cost, entries, progress) == NO_ROOM:
        entries = grown(entries)
    return cost.closed


class Costs(NamedTuple):
    """Costs from n stances."""

    value: Array
    """The least found."""
    closed: Array
    """Those of stances that were expanded."""
    along: IntArray
    """Limb that held when a stance was reached, -1 for none."""


@entry
def _distance(
    goal: BoolArray,
    toward: Array,
    weights: Weights,
    table: PairTable,
    cost: Costs,
    entries: Queue,
    progress: Progress,
) -> int:
    """Go on with a search until it ends or its queue is full, see `distance_to_goal`."""
    if not progress.seeded:
        progress.seeded = True
        for s in range(len(goal)):
            if goal[s] and table.mask[s, 0]:
                cost.value[s] = 0.0
                push(entries, toward[s], 0.0, 0.0, s, -1, 0)
    while entries.filled.size > 0:
        item = first(entries)
        s = entries.node[item]
        if cost.closed[s] < np.inf:
            pop(entries)
            continue
        degree = table.degree[0, table.points[s, 0]] + table.degree[1, table.points[s, 1]]
        if not has_room(entries, degree):
            return NO_ROOM
        pop(entries)
        spent = cost.value[s]
        cost.closed[s] = spent
        if s == progress.after:
            return FOUND
        x, y, z = table.base[s, 0], table.base[s, 1], table.base[s, 2]
        for held in range(2):
            if held == cost.along[s]:
                continue
            point = table.points[s, held]
            for k in range(table.row_start[held, point], table.row_start[held, point + 1]):
                s2 = table.rows[held, k]
                if cost.value[s2] <= spent:
                    continue
                dx = table.row_base[held, k, 0] - x
                dy = table.row_base[held, k, 1] - y
                dz = table.row_base[held, k, 2] - z
                cost2 = spent + weights.base * np.sqrt(dx * dx + dy * dy + dz * dz) + weights.step
                if cost2 < cost.value[s2] and table.mask[s2, 0]:
                    cost.value[s2] = cost2
                    cost.along[s2] = held
                    push(entries, cost2 + toward[s2], cost2, cost2, s2, -1, 0)
    return EXHAUSTED
