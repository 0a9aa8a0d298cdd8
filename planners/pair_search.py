"""Best-first search over the stances of a two-limb robot (compiled).

A search state is (stance, limb that moved last, branches that the other limb has kept): the limb
that grasped has all branches on which it can be released again. A limb that has held must be on one
of those when it moves. Edges are checked when a state is taken from the queue, not when it is put
there, so only edges the search wants to use are worked out. For each (stance, limb) one mask says
which branches were expanded already; a state with nothing new is dropped, which is exact because
the cost of going on is the least over the branches kept.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import EMPTY
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Record
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.queue import Queue, first, grown, has_room, pop, push, queue
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.pair_steps import PairTable, branches_kept, edge_index, releasable
from mlivr_gym.transitions.rule import can_release, kept_on_edge

FOUND, EXHAUSTED, LIMIT = 0, 1, 2
"""How a search ends: at a goal, with nothing more to expand, or at its limit of expansions."""

UNKNOWN_STEP, NO_ROOM = 3, 4
"""Why a search stops for a while: it wants to know a step, or its arrays are full."""

NOBODY = 2
"""Limb that moved last where none did."""


class Weights(Record):
    """What a search minimises, and when it gives up."""

    base: float
    """Weight of the base displacement [1/m]."""
    step: float
    """Charge for each step."""
    g: float
    """1 for A*, 0 for greedy best-first."""
    limit: int
    """Most expansions."""


NO_LIMIT = int(np.iinfo(np.int64).max)
"""Entries that a search may take from its queue where nothing limits it."""


def weights_of(cost: Cost, g: float = 1.0, limit: int = NO_LIMIT) -> Weights:
    """What a search for the least of some cost minimises."""
    out: Weights = Weights.row()
    out["base"], out["step"], out["g"], out["limit"] = cost.base_weight, cost.step_weight, g, limit
    return out


class Progress(Record):
    """Where a search is."""

    seeded: bool
    """Whether the seeds are in the queue."""
    expanded: int
    """States expanded."""
    held: int
    """Limb that holds on the step that it wants to know."""
    before: int
    """Stance before that step."""
    after: int
    """Stance after it."""


class Seeds(NamedTuple):
    """K stances at which a search begins."""

    stance: IntArray
    """Stance, shape (k,)."""
    moved: IntArray
    """Limb that moved there, `NOBODY` if none did, shape (k,)."""
    mask: IntArray
    """Branches of the other limb, shape (k,)."""
    cost: Array
    """What it cost to get there, shape (k,)."""


class Expanded(NamedTuple):
    """States that were expanded."""

    stance: IntArray
    moved: IntArray
    """Limb that moved there, `NOBODY` at the start."""
    mask: IntArray
    """Branches of the limb that held."""
    parent: IntArray
    """The state before, -1 for a seed."""
    cost: Array
    """Cost so far."""


class Closed(NamedTuple):
    """What is known of each stance by the limb that moved last, shape (n, 2)."""

    mask: IntArray
    """Branches of the other limb with which it was expanded."""
    best: Array
    """Least cost known to lead there with nothing taken away."""


def search(
    graph: PairGraph, seeds: Seeds, goal: BoolArray, h: Array, weights: Weights
) -> tuple[int, int, Expanded]:
    """Best-first search from one or more stances to any goal stance.

    Args:
        graph: The stance graph; steps that the search wants to know are checked.
        seeds: Where to begin.
        goal: Which stances are goals, shape (n,).
        h: Heuristic of each stance, shape (n,).
        weights: What is minimised.

    Returns:
        Status, number generated, and the expanded states; if found, the last one is the goal.
    """
    n, progress = len(graph), Progress.row()
    entries, out = queue(1 << 14), _expanded(1 << 10)
    closed = Closed(np.zeros((n, 2), dtype=np.int64), np.full((n, 2), np.inf))
    while True:
        status = int(
            _search(seeds, goal, h, weights, graph.steps, closed, (entries, out), progress)
        )
        if status == UNKNOWN_STEP:
            graph.know_step(*(int(progress[name]) for name in ("held", "before", "after")))
        elif status == NO_ROOM:
            entries, out = grown(entries), grown(out)
        else:
            count = int(progress["expanded"])
            return status, int(entries.filled["used"]), first_of(out, count)


def first_of(out: Expanded, count: int) -> Expanded:
    """The first of some expanded states."""
    parts: Any = (field[:count] for field in out)
    return Expanded(*parts)


def _expanded(room: int) -> Expanded:
    stance, moved, mask, parent = (np.empty(room, dtype=np.int64) for _ in range(4))
    return Expanded(stance, moved, mask, parent, np.empty(room))


@entry
def _search(
    seeds: Seeds,
    goal: BoolArray,
    h: Array,
    weights: Weights,
    table: PairTable,
    closed: Closed,
    arrays: tuple[Queue, Expanded],
    progress: Progress,
) -> int:
    """Go on with a search until it ends or stops for a while, see `search`."""
    entries, out = arrays
    if not progress.seeded:
        if not has_room(entries, len(seeds.stance)):
            return NO_ROOM
        progress.seeded = True
        for k in range(len(seeds.stance)):
            s, cost = seeds.stance[k], seeds.cost[k]
            push(entries, weights.g * cost + h[s], cost, cost, 3 * s + seeds.moved[k], -1 - k, 0)
    while entries.filled.size > 0:
        item = first(entries)
        s, moved = entries.node[item] // 3, entries.node[item] % 3
        above, held, full = entries.link[item], 1 - moved, True
        kept = EMPTY
        if moved < NOBODY:
            kept = table.mask[s, held]
            if table.check:
                if closed.mask[s, moved] & kept == kept:
                    pop(entries)
                    continue
                if above < 0:
                    kept = seeds.mask[-1 - above]
                else:
                    before, last = out.stance[above], out.moved[above]
                    edge = table.edges[edge_index(held, before, s, table)]
                    if not edge.known:
                        progress.held, progress.before, progress.after = held, before, s
                        return UNKNOWN_STEP
                    kept = kept_on_edge(kept, branches_kept(edge))
                    if last == moved:
                        kept = kept_on_edge(out.mask[above], kept)
                    elif last == held:
                        kept = kept_on_edge(releasable(table, before, held), kept)
                        if not can_release(out.mask[above], releasable(table, before, moved)):
                            kept = EMPTY
            if kept & ~closed.mask[s, moved] == 0:
                pop(entries)
                continue
            full = kept == table.mask[s, held]
            if table.check and table.released[s, held].known:
                full = releasable(table, s, held) & ~kept == 0
        degree = table.degree[0, table.points[s, 0]] + table.degree[1, table.points[s, 1]]
        if not has_room(entries, degree) or progress.expanded == len(out.stance):
            return NO_ROOM
        pop(entries)
        if moved < NOBODY:
            closed.mask[s, moved] |= kept
            if full:
                # A limb that grasped here instead would be on branches that the one that holds has.
                grasped = releasable(table, s, moved) if table.check else table.mask[s, moved]
                closed.mask[s, held] |= grasped
        else:
            closed.mask[s, 0], closed.mask[s, 1] = table.mask[s, 1], table.mask[s, 0]
        here, cost = progress.expanded, entries.g[item]
        out.stance[here], out.moved[here], out.mask[here] = s, moved, kept
        out.parent[here], out.cost[here] = max(above, -1), cost
        progress.expanded += 1
        if goal[s]:
            return FOUND
        if progress.expanded >= weights.limit:
            return LIMIT
        _expand(here, cost, h, weights, table, closed, arrays)
    return EXHAUSTED


@kernel
def _expand(
    here: int,
    cost: float,
    h: Array,
    weights: Weights,
    table: PairTable,
    closed: Closed,
    arrays: tuple[Queue, Expanded],
) -> None:
    """Put the neighbours of expanded state `here` into the queue."""
    entries, out = arrays
    s, moved, kept = out.stance[here], out.moved[here], out.mask[here]
    check, mask, local = table.check, table.mask, table.local
    x, y, z = table.base[s, 0], table.base[s, 1], table.base[s, 2]
    for limb in range(2):
        if limb == moved and not check:
            # Moving one limb twice in a row never pays where every step is possible.
            continue
        holds = 1 - limb
        point = table.points[s, holds]
        of_held, sure = mask[s, holds], True
        if moved == limb:
            of_held = kept
        elif moved == holds and check:
            of_held &= releasable(table, s, holds)
            sure = table.released[s, limb].known
            if sure and not can_release(kept, releasable(table, s, limb)):
                continue
        first_edge = table.offset[holds, point] + local[holds, s] * table.degree[holds, point]
        for k in range(table.row_start[holds, point], table.row_start[holds, point + 1]):
            s2 = table.rows[holds, k]
            if s2 == s:
                continue
            theirs = mask[s2, holds]
            if closed.mask[s2, limb] & theirs == theirs:
                continue
            dx = table.row_base[holds, k, 0] - x
            dy = table.row_base[holds, k, 1] - y
            dz = table.row_base[holds, k, 2] - z
            cost2 = cost + weights.base * np.sqrt(dx * dx + dy * dy + dz * dz) + weights.step
            if cost2 >= closed.best[s2, limb]:
                continue
            if check:
                edge = table.edges[first_edge + local[holds, s2]]
                if edge.known:
                    after = kept_on_edge(kept_on_edge(of_held, theirs), branches_kept(edge))
                    if after & ~closed.mask[s2, limb] == 0:
                        continue
                    if sure and after == theirs:
                        closed.best[s2, limb] = cost2
            else:
                # Without checks it does not matter which limb moved.
                closed.best[s2, 0] = closed.best[s2, 1] = cost2
            push(entries, weights.g * cost2 + h[s2], cost2, cost2, 3 * s2 + limb, here, 0)


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
                dx = table.row_base[held, k, 0] - x
                dy = table.row_base[held, k, 1] - y
                dz = table.row_base[held, k, 2] - z
                cost2 = spent + weights.base * np.sqrt(dx * dx + dy * dy + dz * dz) + weights.step
                if cost2 < cost.value[s2] and table.mask[s2, 0]:
                    cost.value[s2] = cost2
                    cost.along[s2] = held
                    push(entries, cost2 + toward[s2], cost2, cost2, s2, -1, 0)
    return EXHAUSTED
