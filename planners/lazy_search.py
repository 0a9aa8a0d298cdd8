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
from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.stance_graph import StanceGraph
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
    return _LazySearch(graph, start, search).run()


class _LazySearch:
    """A search in progress: its queue, and what was expanded."""

    def __init__(self, graph: StanceGraph, start: State, search: Search) -> None:
        self.graph, self.start, self.search = graph, start, search
        self.max_step = graph.max_step
        self.found = Found(EXHAUSTED, [], [], [], [], 1)
        first = graph.posture_of(start)
        self.queue: list[tuple[float, float, int]]
        """Estimate, minus the cost so far, and index of the entry."""
        self.queue = [(float(self._estimate(first.base_position)[0]), 0.0, 0)]
        self.entries: list[tuple[tuple[int, ...], Postures, int]] = [(start.stance, first, -1)]
        """Stance, its posture, and index of the expanded state before it, -1 at the start."""
        self.closed: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
        """Masks with which each stance was expanded."""
        self.complete: set[tuple[int, ...]] = set()
        """Stances expanded with all their branches."""
        self.best: dict[tuple[int, ...], float] = {}
        """Least cost to each stance where steps are not checked."""

    def run(self) -> Found:
        """Expand states until one is at the goal."""
        found, search = self.found, self.search
        while self.queue:
            _, negative, index = heapq.heappop(self.queue)
            stance, posture, parent = self.entries[index]
            state = self.start if parent < 0 else self._state(stance, posture, parent)
            if state is None or not self._close(state, posture):
                continue
            here = len(found.states)
            found.states.append(state)
            found.parents.append(parent)
            found.costs.append(-negative)
            found.postures.append(posture)
            if search.goal.reached(posture.base_position[0], stance):
                found.status = FOUND
                return found
            if here + 1 >= search.limit:
                found.status = LIMIT
                return found
            if search.progress is not None and here % 20 == 0:
                search.progress(here)
            self._expand(here)
        return found

    def _estimate(self, positions: Array) -> Array:
        """Estimate of the cost to the goal from base positions, shape (k, 3) -> (k,)."""
        return self.search.estimate(self.search.goal.distance(positions), self.max_step)

    def _state(self, stance: tuple[int, ...], posture: Postures, parent: int) -> State | None:
        """The state at a stance after an expanded one; None if no such step leaves that."""
        if stance in self.complete:
            return None
        both = join(self.found.postures[parent], posture)
        return self.graph.transition(self.found.states[parent], stance, both)

    def _close(self, state: State, posture: Postures) -> bool:
        """Note that a state is expanded; False if one with its branches was expanded before."""
        # The start may be in a given pose; its stance is another state.
        seen = self.closed.setdefault(state.stance, []) if state.pose is None else []
        if any(
            all(m & ~old == 0 for m, old in zip(state.masks, masks, strict=True)) for masks in seen
        ):
            return False
        seen.append(state.masks)
        if state.pose is None and state.masks == tuple(posture.mask[0].tolist()):
            self.complete.add(state.stance)
        return True

    def _expand(self, here: int) -> None:
        """Put the neighbours of an expanded state into the queue."""
        graph, cost = self.graph, self.search.goal.cost
        state, position = self.found.states[here], self.found.postures[here].base_position
        limb, point, postures = graph.candidates(state.stance)
        if not len(limb):
            return
        shift = np.linalg.norm(postures.base_position - position, axis=1)
        g = self.found.costs[here] + cost.base_weight * shift
        g += cost.step_weight
        f = self.search.g_weight * g + self._estimate(postures.base_position)
        for k in range(len(limb)):
            after = state.stance_after(int(limb[k]), int(point[k]))
            if not graph.settings.transitions:
                if g[k] >= self.best.get(after, np.inf):
                    continue
                self.best[after] = float(g[k])
            elif after in self.complete:
                continue
            self.entries.append((after, postures.take(np.array([k])), here))
            heapq.heappush(self.queue, (float(f[k]), -float(g[k]), len(self.entries) - 1))
            self.found.generated += 1
