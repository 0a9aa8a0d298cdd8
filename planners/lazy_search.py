"""Best-first search over the stances of any number of limbs.

The same states, costs and tie-breaks as `pair_search`, in Python over `StanceGraph.candidates`:
neighbours are worked out in batches, and a step is checked only when its state is taken from the
queue.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.planners.pair_search import EXHAUSTED, FOUND, LIMIT
from mlivr_gym.planners.query import Search
from mlivr_gym.postures.solver import Postures
from mlivr_gym.stances.stance_graph import StanceGraph, join
from mlivr_gym.transitions.state import State


@dataclass
class Found:
    """Outcome of a search: expanded states with their parents, costs and postures."""

    status: int
    states: list[State]
    parents: list[int]
    costs: list[float]
    postures: list[Postures]
    generated: int


def lazy_search(graph: StanceGraph, start: State, search: Search) -> Found:
    """Best-first search from a state to any stance whose base lies in the goal region.

    Args:
        graph: The stance graph.
        start: Where to start.
        search: What to look for, and how.
    """
    cost, max_step = search.goal.cost, graph.max_step

    def heuristic(positions: Array) -> Array:
        return search.estimate(search.goal.distance(positions), max_step)

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
            both = join(found.postures[parent], posture)
            after = graph.transition(found.states[parent], stance, both)
            if after is None:
                continue
            state = after
        # The start may be in a given pose; its stance is another state.
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
        if search.goal.reached(posture.position)[0]:
            found.status = FOUND
            return found
        if here + 1 >= search.limit:
            found.status = LIMIT
            return found
        if search.progress is not None and here % 20 == 0:
            search.progress(here)
        limb, point, postures = graph.candidates(stance)
        if not len(limb):
            continue
        g = -negative + cost.base_weight * np.linalg.norm(
            postures.position - posture.position, axis=1
        )
        g += cost.step_weight
        f = search.g_weight * g + heuristic(postures.position)
        for k in range(len(limb)):
            next_ = state.stance_after(int(limb[k]), int(point[k]))
            if not graph.settings.transitions:
                if g[k] >= best.get(next_, np.inf):
                    continue
                best[next_] = float(g[k])
            elif next_ in complete:
                continue
            entries.append((next_, postures.take(np.array([k])), here))
            heapq.heappush(queue, (float(f[k]), -float(g[k]), len(entries) - 1))
            found.generated += 1
    return found
