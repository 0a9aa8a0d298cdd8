"""Measure what a step in place would give: a limb releases its point and grasps it again.

    python experiments/step_in_place.py

Such a step changes no point; afterwards the limb may be on any branch on which it can be released
from it. Random tasks of two limbs on the JEM, with and without such steps, by an A* search over all
states that is written apart from the planner. A start is either a stance, on whose branches limbs
may be at will, or one on which each limb is on one branch, as in the middle of a walk. Without such
steps the planner's costs must come out.
"""

from __future__ import annotations

import heapq

import numpy as np
from numba import njit

from mlivr_gym import stance_graph
from mlivr_gym.planners import Planner
from mlivr_gym.planners.query import Goal
from mlivr_gym.stances.step_tables import step_tables

TASKS = 300
MOST = 200_000
"""Maximum number of expansions of a search."""


@njit
def search(tables, h, start, goals, by_steps, in_place):
    """Return cost and number of steps of a cheapest path; infinite if there is none, -1 if late."""
    first, after, kept, releasable, positions = tables
    key = (np.int64(start[0]) << 32) | (np.int64(start[1]) << 16) | np.int64(start[2])
    best, queue, expanded = {key: 0.0}, [(h[start[0]], 0.0, key, 0)], 0
    while queue:
        _, cost, key, steps = heapq.heappop(queue)
        node, sets = key >> 32, ((key >> 16) & 0xFFFF, key & 0xFFFF)
        if cost > best[key]:
            continue
        if goals[node]:
            return cost, steps
        expanded += 1
        if expanded > MOST:
            return -1.0, 0
        for limb in range(2):
            if sets[limb] & releasable[node, limb] == 0:
                continue
            edges = range(first[2 * node + limb], first[2 * node + limb + 1])
            for e in range(edges.start - 1 if in_place else edges.start, edges.stop):
                there = node if e < edges.start else np.int64(after[e])
                support = sets[1 - limb] & (0xFFFF if e < edges.start else kept[e])
                if support == 0 or not np.isfinite(h[there]):
                    continue
                moved = releasable[there, limb] | (sets[limb] if e < edges.start else 0)
                both = (moved, support) if limb == 0 else (support, moved)
                way = np.sqrt(((positions[there] - positions[node]) ** 2).sum())
                total = cost + (1.0 if by_steps else way)
                found = (there << 32) | (both[0] << 16) | both[1]
                if found not in best or total < best[found] - 1e-12:
                    best[found] = total
                    heapq.heappush(queue, (total + h[there], total, found, steps + 1))
    return np.inf, 0


def one_branch(rng, some):
    """Return a set of one of some branches."""
    return 1 << int(rng.choice([k for k in range(16) if some >> k & 1]))


def main() -> None:
    """Run all tasks and print what they give."""
    graph = stance_graph()
    planner, tables, rng = Planner(graph), step_tables(graph), np.random.default_rng(5)
    bounds = planner._searcher.lower_bounds()
    arrays = (
        tables.start, tables.after, tables.kept.astype(np.int64),
        tables.releasable.astype(np.int64), tables.base_position,
    )  # fmt: skip
    for cost in ("base", "steps"):
        for single in (False, True):
            rows = []
            while len(rows) < TASKS:
                node, end = rng.integers(len(graph.points), size=2).tolist()
                sets = [int(s) for s in tables.branch_sets[node]]
                if single:
                    moved = int(rng.integers(2))
                    sets[moved] &= int(tables.releasable[node, moved])
                    if sets[moved] == 0:
                        continue
                    sets = [one_branch(rng, some) for some in sets]
                goal = Goal.from_arguments(graph, graph.base_position[end], cost, None, 0.2)
                h = bounds.compute(goal, np.array([node])).h
                near = graph.base_position - graph.base_position[end]
                given = arrays, h, (node, *sets), np.linalg.norm(near, axis=1) <= 0.2
                both = [search(*given, cost == "steps", way) for way in (False, True)]
                if not single:
                    stance = graph.points[node].tolist()
                    plan = planner.plan(stance, graph.base_position[end].tolist(), cost).plan
                    expected = np.inf if plan is None else plan.cost
                    assert abs(both[0][0] - expected) < 1e-6 or both[0][0] == expected
                rows.append([*both[0], *both[1]])
            found = np.array(rows)
            done = np.isfinite(found[:, [0, 2]]).all(axis=1) & (found[:, [0, 2]] >= 0).all(axis=1)
            without, with_them = found[done, 0], found[done, 2]
            print(
                f"{cost}, {'one branch' if single else 'all branches'}: {TASKS} tasks, no path in "
                f"{np.isinf(found[:, 0]).sum()} and {np.isinf(found[:, 2]).sum()}, late in "
                f"{(found[:, [0, 2]] < 0).any(axis=1).sum()}; cost {without.sum():.3f} and "
                f"{with_them.sum():.3f}, {100 * (1 - with_them.sum() / without.sum()):.2f} % less, "
                f"steps {found[done, 1].mean():.2f} and {found[done, 3].mean():.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
