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
from mlivr_gym.compiled.bit_sets import EMPTY, NONE
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
        h: Heuristic of each stance, shape (n,); infinite where no goal can be reached from.
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
    if not (progress.seeded or _seed(seeds, h, weights, entries, progress)):
        return NO_ROOM
    while entries.filled.size > 0:
        item = first(entries)
        s, moved = entries.node[item] // 3, entries.node[item] % 3
        above, held, full = entries.link[item], 1 - moved, True
        kept = EMPTY
        if moved < NOBODY:
            whole = table.mask[s, held]
            if table.check and closed.mask[s, moved] & whole == whole:
                pop(entries)
                continue
            kept = _kept(s, moved, above, seeds, table, out)
            if kept < 0:
                progress.held, progress.before, progress.after = held, out.stance[above], s
                return UNKNOWN_STEP
            if kept & ~closed.mask[s, moved] == 0:
                pop(entries)
                continue
            full = kept == whole
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
def _seed(seeds: Seeds, h: Array, weights: Weights, entries: Queue, progress: Progress) -> bool:
    """Put the seeds into the queue; whether there is room."""
    if not has_room(entries, len(seeds.stance)):
        return False
    progress.seeded = True
    for k in range(len(seeds.stance)):
        s, cost = seeds.stance[k], seeds.cost[k]
        push(entries, weights.g * cost + h[s], cost, cost, 3 * s + seeds.moved[k], -1 - k, 0)
    return True


@kernel
def _kept(s: int, moved: int, above: int, seeds: Seeds, table: PairTable, out: Expanded) -> int:
    """Branches of the limb that held on the step to stance `s`; -1 if the step is not known."""
    held = 1 - moved
    kept = table.mask[s, held]
    if not table.check:
        return int(kept)
    if above < 0:
        return int(seeds.mask[-1 - above])
    before, last = out.stance[above], out.moved[above]
    edge = table.edges[edge_index(held, before, s, table)]
    if not edge.known:
        return NONE
    kept = kept_on_edge(kept, branches_kept(edge))
    if last == moved:
        kept = kept_on_edge(out.mask[above], kept)
    elif last == held:
        kept = kept_on_edge(releasable(table, before, held), kept)
        if not can_release(out.mask[above], releasable(table, before, moved)):
            kept = EMPTY
    return int(kept)


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
            if closed.mask[s2, limb] & theirs == theirs or h[s2] == np.inf:
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
