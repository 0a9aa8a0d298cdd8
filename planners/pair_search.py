"""Best-first search over the stances of a two-limb robot (compiled).

A search state is (stance, limb that moved last, branches that the other limb has kept): the limb
that grasped has all branches on which it can be released again. A limb that has held must be on one
of those when it moves. Edges are checked when a state is taken from the queue, not when it is put
there, so only edges the search wants to use are worked out. For each (stance, limb) one mask says
which branches were expanded already; a state with nothing new is dropped, which is exact because
the cost of going on is the least over the branches kept.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.kernels import allocating_kernel
from mlivr_gym.planners.heap import grown
from mlivr_gym.planners.heap import sift_down as _sift_down
from mlivr_gym.planners.heap import sift_up as _sift_up
from mlivr_gym.stances.pair_steps import KNOWN, edge_entry
from mlivr_gym.transitions.rule import can_release, kept_on_edge, mask_of_grasp

FOUND, EXHAUSTED, LIMIT = 0, 1, 2
"""How a search ends: at a goal, with nothing more to expand, or at its limit of expansions."""


@allocating_kernel
def search(
    seeds: IntArray, seed_costs: Array, goal: BoolArray, h: Array, base_weight: float,
    step_weight: float, g_weight: float, limit: int, check: bool, rows: IntArray,
    row_start: IntArray, row_position: Array, edges: tuple[Any, ...], closed: IntArray, best: Array,
) -> tuple[int, int, IntArray, IntArray, IntArray, Array]:  # fmt: skip
    """Best-first search from one or more stances to any goal stance.

    Args:
        seeds: Where to begin: stance index, limb that moved there (2 if none did) and branches of
            the other limb, shape (k, 3).
        seed_costs: What it cost to get to each, shape (k,).
        goal: Which stances are goals, shape (n,).
        h: Heuristic of each stance, shape (n,).
        base_weight: Weight of the base displacement [1/m].
        step_weight: Charge for each step.
        g_weight: 1 for A*, 0 for greedy best-first.
        limit: Most expansions.
        check: Whether steps are checked.
        rows: `PairGraph.rows`.
        row_start: `PairGraph.row_start`.
        row_position: `PairGraph.row_position`.
        edges: `PairGraph.edges`.
        closed: Zeros, shape (n, 2); branches of the other limb with which a stance was expanded, by
            limb moved last.
        best: Infinities, shape (n, 2); least cost known to lead to a stance with nothing taken
            away.

    Returns:
        Status, number generated, and for each expanded state `3 * stance + limb moved` (2 at the
        start), mask of the limb that held, parent (-1 for a seed), and cost so far. If found, the
        last one is the goal.
    """
    points, position, mask = edges[0], edges[5], edges[7]
    ready, released = edges[17][1], edges[17][2]
    local, degree, offset, table = edges[1], edges[2], edges[3], edges[4]
    size_pool = 1 << 14
    f, g = np.empty(size_pool), np.empty(size_pool)
    node, parent = np.empty(size_pool, np.int64), np.empty(size_pool, np.int64)
    heap = np.empty(size_pool, np.int64)
    size_out = 1 << 10
    out_node, out_mask = np.empty(size_out, np.int64), np.empty(size_out, np.int64)
    out_parent, out_g = np.empty(size_out, np.int64), np.empty(size_out)
    used = size = expanded = 0
    for k in range(len(seeds)):
        if used == size_pool:
            f, g, node, parent = grown(f), grown(g), grown(node), grown(parent)
            heap = grown(heap)
            size_pool *= 2
        s = seeds[k, 0]
        f[used], g[used] = g_weight * seed_costs[k] + h[s], seed_costs[k]
        node[used], parent[used], heap[size] = 3 * s + seeds[k, 1], -1 - k, used
        used += 1
        size += 1
        _sift_up(heap, size, f, g)
    status = EXHAUSTED
    while size > 0:
        item = heap[0]
        size -= 1
        if size > 0:
            heap[0] = heap[size]
            _sift_down(heap, size, f, g)
        s, moved = node[item] // 3, node[item] % 3
        above = parent[item]
        if moved == 2:
            kept = 0
            full = True
        else:
            held = 1 - moved
            kept = mask[s, held]
            if check:
                if closed[s, moved] & kept == kept:
                    continue
                if above < 0:
                    kept = seeds[-1 - above, 2]
                else:
                    before, last = out_node[above] // 3, out_node[above] % 3
                    kept = kept_on_edge(mask[s, held], edge_entry(held, before, s, edges))
                    if last == moved:
                        kept = kept_on_edge(out_mask[above], kept)
                    elif last == held:
                        kept = kept_on_edge(mask_of_grasp(released[before, held]), kept)
                        if not can_release(out_mask[above], released[before, moved]):
                            continue
            if kept & ~closed[s, moved] == 0:
                continue
            full = kept == mask[s, held]
            if check and ready[s, held]:
                full = mask_of_grasp(released[s, held]) & ~kept == 0
            closed[s, moved] |= kept
        if full and moved < 2:
            # A limb that grasped here instead would be on branches that the one that holds has.
            closed[s, 1 - moved] |= mask_of_grasp(released[s, moved]) if check else mask[s, moved]
        elif full:
            closed[s, 0], closed[s, 1] = mask[s, 1], mask[s, 0]
        if expanded == size_out:
            out_node, out_mask = grown(out_node), grown(out_mask)
            out_parent, out_g = grown(out_parent), grown(out_g)
            size_out *= 2
        here = expanded
        cost = g[item]
        out_node[here], out_mask[here] = 3 * s + moved, kept
        out_parent[here], out_g[here] = max(above, -1), cost
        expanded += 1
        if goal[s]:
            status = FOUND
            break
        if expanded >= limit:
            status = LIMIT
            break
        x, y, z = position[s, 0], position[s, 1], position[s, 2]
        for limb in range(2):
            if limb == moved and not check:
                # Moving one limb twice in a row never pays where every step is possible.
                continue
            holds = 1 - limb
            point = points[s, holds]
            of_held, sure = mask[s, holds], True
            if moved == limb:
                of_held = kept
            elif moved == holds and check:
                of_held &= mask_of_grasp(released[s, holds])
                sure = ready[s, limb]
                if sure and not can_release(kept, released[s, limb]):
                    continue
            first = offset[holds, point] + local[holds, s] * degree[holds, point]
            for k in range(row_start[holds, point], row_start[holds, point + 1]):
                s2 = rows[holds, k]
                if s2 == s:
                    continue
                theirs = mask[s2, holds]
                if closed[s2, limb] & theirs == theirs:
                    continue
                dx = row_position[holds, k, 0] - x
                dy = row_position[holds, k, 1] - y
                dz = row_position[holds, k, 2] - z
                cost2 = cost + base_weight * np.sqrt(dx * dx + dy * dy + dz * dz) + step_weight
                if cost2 >= best[s2, limb]:
                    continue
                after = kept_on_edge(of_held, theirs)
                if check:
                    entry = table[first + local[holds, s2]]
                    if entry & KNOWN:
                        after = kept_on_edge(after, entry)
                        if after & ~closed[s2, limb] == 0:
                            continue
                        if sure and after == theirs:
                            best[s2, limb] = cost2
                else:
                    # Without checks it does not matter which limb moved.
                    best[s2, 0] = best[s2, 1] = cost2
                if used == size_pool:
                    f, g, node, parent = grown(f), grown(g), grown(node), grown(parent)
                    heap = grown(heap)
                    size_pool *= 2
                f[used] = g_weight * cost2 + h[s2]
                g[used] = cost2
                node[used] = 3 * s2 + limb
                parent[used] = here
                heap[size] = used
                used += 1
                size += 1
                _sift_up(heap, size, f, g)
    return (
        status, used, out_node[:expanded], out_mask[:expanded], out_parent[:expanded],
        out_g[:expanded],
    )  # fmt: skip


@allocating_kernel
def steps_to_goal(
    goal: BoolArray, rows: IntArray, row_start: IntArray, points: IntArray, mask: IntArray,
    value: Array, opened: BoolArray,
) -> None:  # fmt: skip
    """Fewest steps from every stance to the goal region when steps are not checked.

    A breadth-first search in which each row is opened once: all its stances are one step from the
    first of them that was reached.

    Args:
        goal: Which stances are goals, shape (n,).
        rows: `PairGraph.rows`.
        row_start: `PairGraph.row_start`.
        points: `PairGraph.points`.
        mask: `PairGraph.mask`; stances without a branch are omitted.
        value: Infinities, shape (n,), filled with the steps but where no goal can be reached.
        opened: False, shape (2, m).
    """
    n = len(goal)
    queue = np.empty(n, np.int64)
    head = tail = 0
    for s in range(n):
        if goal[s] and mask[s, 0]:
            value[s] = 0.0
            queue[tail] = s
            tail += 1
    while head < tail:
        s = queue[head]
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
                    queue[tail] = s2
                    tail += 1


@allocating_kernel
def distance_to_goal(
    goal: BoolArray, start: int, toward: Array, base_weight: float, step_weight: float,
    rows: IntArray, row_start: IntArray, points: IntArray, position: Array, row_position: Array,
    mask: IntArray, value: Array, closed: Array, along: IntArray,
) -> None:  # fmt: skip
    """Exact cost from stances to the goal region when steps are not checked.

    It is found by a search backward from the goal. Moving one limb twice in a row never pays, so a
    stance reached along a row does not open that row again.

    Args:
        goal: Which stances are goals, shape (n,).
        start: Stance at which to stop, or -1 to go on to the end.
        toward: Lower bound of the cost between each stance and the start, shape (n,); zeros without
            one.
        base_weight: Weight of the base displacement [1/m].
        step_weight: Charge for each step.
        rows: `PairGraph.rows`.
        row_start: `PairGraph.row_start`.
        points: `PairGraph.points`.
        position: `PairGraph.base_in_world`.
        row_position: `PairGraph.row_position`.
        mask: `PairGraph.mask`; stances without a branch are omitted.
        value: Infinities, shape (n,); least costs found.
        closed: Infinities, shape (n,), filled with the cost of each stance that was expanded.
        along: Minus ones, shape (n,); the limb that held when a stance was reached.
    """
    n = len(goal)
    size_pool = n + 1
    f, g = np.empty(size_pool), np.empty(size_pool)
    node, heap = np.empty(size_pool, np.int64), np.empty(size_pool, np.int64)
    used = size = 0
    for s in range(n):
        if goal[s] and mask[s, 0]:
            value[s] = g[used] = 0.0
            f[used], node[used], heap[size] = toward[s], s, used
            used += 1
            size += 1
            _sift_up(heap, size, f, g)
    while size > 0:
        item = heap[0]
        size -= 1
        if size > 0:
            heap[0] = heap[size]
            _sift_down(heap, size, f, g)
        s = node[item]
        if closed[s] < np.inf:
            continue
        cost = value[s]
        closed[s] = cost
        if s == start:
            break
        x, y, z = position[s, 0], position[s, 1], position[s, 2]
        for held in range(2):
            if held == along[s]:
                continue
            point = points[s, held]
            for k in range(row_start[held, point], row_start[held, point + 1]):
                s2 = rows[held, k]
                dx = row_position[held, k, 0] - x
                dy = row_position[held, k, 1] - y
                dz = row_position[held, k, 2] - z
                cost2 = cost + base_weight * np.sqrt(dx * dx + dy * dy + dz * dz) + step_weight
                if cost2 < value[s2] and mask[s2, 0]:
                    value[s2] = cost2
                    along[s2] = held
                    if used == size_pool:
                        f, g, node, heap = grown(f), grown(g), grown(node), grown(heap)
                        size_pool *= 2
                    f[used], g[used], node[used], heap[size] = cost2 + toward[s2], cost2, s2, used
                    used += 1
                    size += 1
                    _sift_up(heap, size, f, g)
