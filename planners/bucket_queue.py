"""The queue of searches over millions of nodes: lists of about equal estimates (compiled).

To put one in and to take one out takes the same time however many wait, and hardly leaves what the
processor has at hand. Of those in one list any may come first.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record

LISTS = 1 << 16
"""Number of lists; what is farther yet is in the last."""

NOTHING = -1
"""In place of an entry."""

WIDTH = 0.01
"""Base displacement that a list spans [m], where that is charged."""


class Filled(Record):
    """How full a queue is."""

    low: float
    """Estimate with which the first list begins."""
    width: float
    """How many estimates a list spans."""
    used: int
    """Entries ever made."""
    list: int
    """The first list that may hold something."""


class NodeQueue(NamedTuple):
    """Nodes that wait."""

    first: NDArray[np.int32]
    """First entry of each list, shape (LISTS,)."""
    node: NDArray[np.int32]
    """Nodes of the entries, shape (room,)."""
    following: NDArray[np.int32]
    """Entry that follows each in its list, shape (room,)."""
    filled: Filled
    """How full it is."""

    @classmethod
    def of(cls, capacity: int, low: float = 0.0, width: float = 1.0) -> NodeQueue:
        """Room for some entries; the first list begins at an estimate, each spans some."""
        node, following = (np.empty(capacity, dtype=np.int32) for _ in range(2))
        new = cls(np.empty(LISTS, dtype=np.int32), node, following, Filled.row())
        new.empty(low, width)
        return new

    def empty(self, low: float, width: float) -> None:
        """Begin anew."""
        self.first[:] = NOTHING
        filled: Any = self.filled
        filled["low"], filled["width"], filled["used"], filled["list"] = low, width, 0, 0

    @property
    def least(self) -> float:
        """See `least_waiting`."""
        filled: Any = self.filled
        return float(filled["low"] + filled["width"] * filled["list"])

    def wider(self) -> NodeQueue:
        """The same with twice as much room."""
        node, following = (np.resize(one, 2 * len(one)) for one in (self.node, self.following))
        return NodeQueue(self.first, node, following, self.filled)


def width_for(weights: Any) -> float:
    """What lists span of a cost: a step, where nothing else is charged."""
    return WIDTH * float(weights["base"]) or float(weights["step"])


@kernel
def put(waiting: NodeQueue, f: float, node: int) -> None:
    """Add a node; there must be room. It comes no sooner than what was taken last."""
    filled = waiting.filled
    place = max(int(min((f - filled.low) / filled.width, LISTS - 1)), filled.list)
    entry = filled.used
    waiting.node[entry], waiting.following[entry] = node, waiting.first[place]
    waiting.first[place] = entry
    filled.used = entry + 1


@kernel
def take(waiting: NodeQueue) -> int:
    """Remove an entry of the first list that holds one; `NOTHING` if none does."""
    filled = waiting.filled
    while filled.list < LISTS:
        entry = waiting.first[filled.list]
        if entry != NOTHING:
            waiting.first[filled.list] = waiting.following[entry]
            return int(entry)
        filled.list += 1
    return NOTHING


@kernel
def put_back(waiting: NodeQueue, entry: int) -> None:
    """Put an entry that was taken last in its place again."""
    waiting.following[entry] = waiting.first[waiting.filled.list]
    waiting.first[waiting.filled.list] = entry


@kernel
def least_waiting(waiting: NodeQueue) -> float:
    """What the estimates of all that wait are not less than, once a list was looked at."""
    return waiting.filled.low + waiting.filled.width * waiting.filled.list


@kernel
def nothing_at_hand(waiting: NodeQueue) -> bool:
    """Whether the list that was looked at last is empty."""
    return bool(waiting.first[waiting.filled.list] == NOTHING)
