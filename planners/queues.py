"""What a search of many limbs has in its queues; see `lazy_search`."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.postures.postures import Postures
from mlivr_gym.transitions.state import State


@dataclass(slots=True)
class Block:
    """Neighbours of a state of which their points alone are known, the most promising first.

    Attributes
    ----------
    parent
        Index of the expanded state before them.
    cost
        A lower bound of the cost so far of all of them.
    stances
        Their points, shape (k, N).
    lows
        Lower bounds of the cost of plans through each of them and those after it, shape (k,).
    promises
        What they are ordered by in the search for a first plan, shape (k,).
    version
        How many of them were taken.
    """

    parent: int
    cost: float
    stances: IntArray
    lower_bounds: Array
    estimates: Array
    version: int = 0

    @property
    def done(self) -> bool:
        """Whether all were taken."""
        return self.version == len(self.stances)

    @property
    def lower_bound(self) -> float:
        """Lower bound of the cost of a plan through any that was not taken."""
        return float(self.lower_bounds[self.version])

    @property
    def estimate(self) -> float:
        """That of the first which was not taken."""
        return float(self.estimates[self.version])


@dataclass(slots=True)
class Entry:
    """A node in the queue.

    Attributes
    ----------
    stance
        Its points.
    parent
        Index of the expanded state before it, -1 at the start.
    cost
        Cost so far.
    low
        Lower bound of the cost of a plan through it.
    promise
        What it is ordered by in the search for a first plan, the least first.
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
    """Blocks and entries in an order; what was pushed again or is done counts no more."""

    def __init__(self) -> None:
        """Start empty."""
        self._heap: list[tuple[float, float, int, int, Block | Entry]] = []
        self._pushed = 0

    def push(self, order: float, item: Block | Entry) -> None:
        """Add something, or put it in another place; ties go to the larger cost so far."""
        self._pushed += 1
        heapq.heappush(self._heap, (order, -item.cost, self._pushed, item.version, item))

    def top(self) -> Block | Entry | None:
        """The first, which stays; None if there is none."""
        while self._heap:
            *_, version, item = self._heap[0]
            if not item.done and version == item.version:
                return item
            heapq.heappop(self._heap)
        return None

    def pop(self) -> Block | Entry | None:
        """Take the first."""
        item = self.top()
        if item is not None:
            heapq.heappop(self._heap)
        return item
