"""Open queue of searches over millions of nodes: a binary heap (Williams 1964, compiled)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record

NO_ENTRY = -1
"""Index that stands for no entry."""


CLOCK_INTERVAL = 1 << 14
"""Maximum number of entries taken from the queue between two readings of the clock."""


class QueueStatus(Record):
    """Fill level of a queue."""

    entry_count: int
    """Number of entries ever made."""
    waiting: int
    """Number of entries in the queue."""


class NodeQueue(NamedTuple):
    """An open queue of nodes."""

    node: NDArray[np.int32]
    """Node of each entry, shape (capacity,)."""
    estimates: Array
    """Estimates of the entries in the queue, in the order of a heap, shape (capacity,)."""
    entries: NDArray[np.int32]
    """These entries, shape (capacity,)."""
    status: QueueStatus
    """Fill level."""

    @classmethod
    def allocate(cls, capacity: int) -> NodeQueue:
        """Allocate an empty queue with a given capacity."""
        node, entries = (np.empty(capacity, dtype=np.int32) for _ in range(2))
        return cls(node, np.empty(capacity), entries, QueueStatus.row())

    def reset(self) -> None:
        """Empty the queue."""
        status: Any = self.status
        status["entry_count"] = status["waiting"] = 0

    @property
    def lower_bound(self) -> float:
        """Return the least estimate in the queue, infinite if it is empty."""
        status: Any = self.status
        return float(self.estimates[0]) if status["waiting"] else np.inf

    def doubled(self) -> NodeQueue:
        """Return the queue with twice the capacity."""
        node, entries = (np.resize(one, 2 * len(one)) for one in (self.node, self.entries))
        return NodeQueue(node, np.resize(self.estimates, len(node)), entries, self.status)


@kernel
def push(queue: NodeQueue, f: float, node: int) -> None:
    """Push a node with estimate `f` as a new entry; the queue must not be full."""
    entry = queue.status.entry_count
    queue.node[entry] = node
    queue.status.entry_count = entry + 1
    requeue(queue, f, entry)


@kernel
def requeue(queue: NodeQueue, f: float, entry: int) -> None:
    """Push an entry that was popped again, with estimate `f`."""
    at = queue.status.waiting
    queue.status.waiting = at + 1
    while at > 0:
        above = (at - 1) // 2
        if queue.estimates[above] < f:
            break
        queue.estimates[at], queue.entries[at] = queue.estimates[above], queue.entries[above]
        at = above
    queue.estimates[at], queue.entries[at] = f, entry


@kernel
def pop(queue: NodeQueue) -> int:
    """Pop an entry with the least estimate; return `NO_ENTRY` if the queue is empty."""
    estimates, entries, last = queue.estimates, queue.entries, queue.status.waiting - 1
    if last < 0:
        return NO_ENTRY
    first, f, entry = entries[0], estimates[last], entries[last]
    queue.status.waiting = last
    at, below = 0, 1
    while below < last:
        if below + 1 < last and estimates[below + 1] < estimates[below]:
            below += 1
        if f <= estimates[below]:
            break
        estimates[at], entries[at] = estimates[below], entries[below]
        at, below = below, 2 * below + 1
    estimates[at], entries[at] = f, entry
    return int(first)


@kernel
def least_estimate(queue: NodeQueue) -> float:
    """Return the least estimate in the queue, infinite if it is empty."""
    return float(queue.estimates[0]) if queue.status.waiting else np.inf
