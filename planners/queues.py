"""Items of the open queues of the search over an implicit graph, see `implicit_search`.

An item changes while it waits in several queues. Each change raises its `version`, and a queue
skips an item that was pushed with another one.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.postures.postures import Postures
from mlivr_gym.transitions.state import State


@dataclass(slots=True)
class Block:
    """Neighbours of an expanded state, in order of estimate, of which only the points are known.

    Attributes
    ----------
    parent
        Index of the expanded state.
    cost
        Lower bound of the cost so far at each of them.
    stances
        Their points, shape (k, N).
    lower_bounds
        Lower bounds of the cost of plans through each of them and all after it, shape (k,).
    estimates
        Keys by which they are ordered in the search for a first plan, shape (k,).
    version
        Number of neighbours already taken, which identifies the state of the block.
    """

    parent: int
    cost: float
    stances: IntArray
    lower_bounds: Array
    estimates: Array
    version: int = 0

    @property
    def done(self) -> bool:
        """Whether all neighbours were taken."""
        return self.version == len(self.stances)

    @property
    def lower_bound(self) -> float:
        """Lower bound of the cost of plans through the neighbours not taken."""
        return float(self.lower_bounds[self.version])

    @property
    def estimate(self) -> float:
        """Estimate of the first neighbour not taken."""
        return float(self.estimates[self.version])


@dataclass(slots=True)
class Entry:
    """A stance with a known posture in the open queue.

    Attributes
    ----------
    stance
        Its points.
    parent
        Index of the expanded state before it, -1 at the start.
    cost
        Cost so far.
    lower_bound
        Lower bound of the cost of plans through it.
    estimate
        Key by which it is ordered in the search for a first plan.
    posture
        Its posture.
    state
        Its state, once the step to it is checked.
    done
        Whether it is expanded or dropped.
    """

    stance: tuple[int, ...]
    parent: int
    cost: float
    lower_bound: float
    estimate: float
    posture: Postures
    state: State | None = None
    done: bool = False

    @property
    def version(self) -> int:
        """0 before the step to it is checked, 1 after."""
        return int(self.state is not None)


class OpenQueue:
    """An open queue of blocks and entries that skips items changed since their push."""

    def __init__(self) -> None:
        """Create an empty queue."""
        self._heap: list[tuple[float, float, int, int, Block | Entry]] = []
        self._pushed = 0

    def push(self, order: float, item: Block | Entry) -> None:
        """Push an item with a key; ties go to the larger cost so far."""
        self._pushed += 1
        heapq.heappush(self._heap, (order, -item.cost, self._pushed, item.version, item))

    def top(self) -> Block | Entry | None:
        """Return the first item without removing it, or None."""
        while self._heap:
            *_, version, item = self._heap[0]
            if not item.done and version == item.version:
                return item
            heapq.heappop(self._heap)
        return None

    def pop(self) -> Block | Entry | None:
        """Remove and return the first item, or None."""
        item = self.top()
        if item is not None:
            heapq.heappop(self._heap)
        return item
