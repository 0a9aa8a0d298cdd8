"""Best-first search over the stances of any number of limbs.

The same states, costs and tie-breaks as `pair_search`, in Python over `LazyGraph.candidates`:
neighbours are worked out in batches, and a step is checked only when its state is taken from the
queue.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.pair_search import EXHAUSTED, FOUND, LIMIT
from mlivr_gym.postures.solver import Postures
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.stance_graph import State, join


@dataclass
class Found:
    """Outcome of a search: status, expanded states with their parents, costs and postures, number generated."""

    status: int
    states: list[State]
    parents: list[int]
    costs: list[float]
    postures: list[Postures]
    generated: int


def lazy_search(
    graph: LazyGraph,
    start: State,
    is_goal: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
    heuristic: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    cost: Cost,
    g_weight: float,
    limit: int,
    progress: Callable[[int], None] | None = None,
    blocked: Collection[tuple[tuple[int, ...], tuple[int, ...]]] = (),
) -> Found:
    """Best-first search from a state to any stance whose base position is a goal.

    Args:
        graph: The stance graph.
        start: Where to start.
        is_goal: Tells of base positions, shape (k, 3), which are goals, shape (k,).
        heuristic: Estimate for base positions, shape (k, 3) -> (k,).
        cost: Cost of a step.
        g_weight: 1 for A*, 0 for greedy best-first.
        limit: Most expansions.
        progress: Called with the number of expansions now and then.
        blocked: Steps not to take, as pairs of stances.
    """
    found = Found(EXHAUSTED, [], [], [], [], 1)
    first = graph.posture_of(start)
    h0 = float(heuristic(first.position)[0])
    queue: list[tuple[float, float, int]] = [(h0, 0.0, 0)]
    entries: list[tuple[tuple[int, ...], Postures, int]] = [(start.stance, first, -1)]
    closed: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
    complete: set[tuple[int, ...]] = set()
    best: dict[tuple[int, ...], float] = {}
    while queue:
        _, negative, index = heapq.heappop(queue)
        stance, posture, parent = entries[index]
        if parent < 0:
            state = start
        else:
            if stance in complete:
                continue
            if (found.states[parent].stance, stance) in blocked:
                continue
            step = graph.transition(
                found.states[parent], stance, join(found.postures[parent], posture)
            )
            if step is None:
                continue
            state = State(stance, step.masks)
        # A pose of the robot's own is left once; its stance is another state.
        seen = closed.setdefault(stance, []) if state.pose is None else []
        if any(
            all(m & ~old == 0 for m, old in zip(state.masks, masks, strict=True)) for masks in seen
        ):
            continue
        seen.append(state.masks)
        if state.pose is None and state.masks == tuple(posture.mask[0].tolist()):
            complete.add(stance)
        here = len(found.states)
        found.states.append(state)
        found.parents.append(parent)
        found.costs.append(-negative)
        found.postures.append(posture)
        if is_goal(posture.position)[0]:
            found.status = FOUND
            return found
        if here + 1 >= limit:
            found.status = LIMIT
            return found
        if progress is not None and here % 20 == 0:
            progress(here)
        limb, point, postures = graph.candidates(stance)
        if not len(limb):
            continue
        g = -negative + cost.base_weight * np.linalg.norm(
            postures.position - posture.position, axis=1
        )
        g += cost.step_weight
        f = g_weight * g + heuristic(postures.position)
        for k in range(len(limb)):
            after = (*stance[: limb[k]], int(point[k]), *stance[limb[k] + 1 :])
            if not graph.settings.transitions:
                if g[k] >= best.get(after, np.inf):
                    continue
                best[after] = float(g[k])
            elif after in complete:
                continue
            entries.append((after, postures.take(np.array([k])), here))
            heapq.heappush(queue, (float(f[k]), -float(g[k]), len(entries) - 1))
            found.generated += 1
    return found
