"""Items of the open queues of the search over an implicit graph, see `implicit_search`.

An item changes while it waits in several queues. Each change raises its `version`, and a queue
skips an item that was pushed with another one. Items of the same `stage` are evaluated in batches.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import ClassVar

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.postures.postures import Postures
from mlivr_gym.transitions.state import State


@dataclass(slots=True, eq=False)
class Entry:
    """A stance with a known posture in the open queue, once expanded a node of the search tree."""

    state: State
    """Its state, with all branches of its posture until the step to it is checked."""
    parent: Entry | None
    """The expanded entry before it, None at the start."""
    cost: float
    """Cost so far."""
    lower_bound: float
    """Lower bound of the cost of plans through it."""
    estimate: float
    """Key by which it is ordered in the search for a first plan."""
    posture: Postures
    """Its posture."""
    checked: bool = False
    """Whether the step to it was checked."""
    done: bool = False
    """Whether it is expanded or dropped."""

    @property
    def position(self) -> Array:
        """Base position [m], shape (3,)."""
        position: Array = self.posture.base_position[0]
        return position

    @property
    def stage(self) -> int:
        """1 before the step to it is checked, 2 after."""
        return 1 + self.checked

    version = stage

    def path(self) -> list[Entry]:
        """Return the entries from the start to it."""
        entries = [self]
        while entries[-1].parent is not None:
            entries.append(entries[-1].parent)
        return entries[::-1]


@dataclass(slots=True, eq=False)
class Block:
    """Neighbours of an expanded state, in order of estimate, of which only the points are known."""

    parent: Entry
    """The expanded entry."""
    cost: float
    """Lower bound of the cost so far at each of them."""
    stances: IntArray
    """Their points, shape (k, N)."""
    lower_bounds: Array
    """Lower bounds of the cost of plans through each of them and all after it, shape (k,)."""
    estimates: Array
    """Keys by which they are ordered in the search for a first plan, shape (k,)."""
    version: int = 0
    """Number of neighbours already taken, which identifies the state of the block."""
    stage: ClassVar[int] = 0

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

    def take(self, count: int) -> IntArray:
        """Take the next neighbours, at most some number of them; return their points, (k, N)."""
        taken = self.stances[self.version : self.version + count]
        self.version += len(taken)
        return taken


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

    def pop(self, stage: int | None = None) -> Block | Entry | None:
        """Remove and return the first item, or None; with a stage, only if the item has it."""
        item = self.top()
        if item is None or stage not in (None, item.stage):
            return None
        heapq.heappop(self._heap)
        return item
