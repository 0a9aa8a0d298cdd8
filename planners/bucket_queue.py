"""Bucket queue (Dial 1969) of searches over millions of nodes (compiled).

Entries whose estimates fall into the same interval share a bucket, a linked list. Push and pop take
constant time, and entries of a bucket come in no particular order, so the order of the queue is
exact up to the width of a bucket.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record

BUCKETS = 1 << 16
"""Number of buckets; larger estimates go into the last one."""

NO_ENTRY = -1
"""Index that stands for no entry."""

BUCKET_WIDTH = 0.01
"""Base displacement that a bucket spans, where displacements are charged [m]."""


class QueueStatus(Record):
    """Scale and fill level of a queue."""

    lowest: float
    """Estimate at which the first bucket starts."""
    width: float
    """Interval of estimates that a bucket spans."""
    entry_count: int
    """Number of entries ever pushed."""
    bucket: int
    """The first bucket that may hold an entry."""


class NodeQueue(NamedTuple):
    """An open queue of nodes."""

    head: NDArray[np.int32]
    """First entry of each bucket, shape (BUCKETS,)."""
    node: NDArray[np.int32]
    """Node of each entry, shape (capacity,)."""
    next_entry: NDArray[np.int32]
    """Entry that follows in the same bucket, shape (capacity,)."""
    status: QueueStatus
    """Scale and fill level."""

    @classmethod
    def allocate(cls, capacity: int, lowest: float = 0.0, width: float = 1.0) -> NodeQueue:
        """Allocate an empty queue with a given capacity, first estimate and bucket width."""
        node, next_entry = (np.empty(capacity, dtype=np.int32) for _ in range(2))
        new = cls(np.empty(BUCKETS, dtype=np.int32), node, next_entry, QueueStatus.row())
        new.reset(lowest, width)
        return new

    def reset(self, lowest: float, width: float) -> None:
        """Empty the queue and set its first estimate and bucket width."""
        self.head[:] = NO_ENTRY
        status: Any = self.status
        status["lowest"], status["width"], status["entry_count"], status["bucket"] = (
            lowest,
            width,
            0,
            0,
        )

    @property
    def lower_bound(self) -> float:
        """Return the lower bound of all estimates in the queue, see `queue_lower_bound`."""
        status: Any = self.status
        return float(status["lowest"] + status["width"] * status["bucket"])

    def doubled(self) -> NodeQueue:
        """Return the queue with twice the capacity."""
        node, next_entry = (np.resize(one, 2 * len(one)) for one in (self.node, self.next_entry))
        return NodeQueue(self.head, node, next_entry, self.status)


def bucket_width(weights: Any) -> float:
    """Return the width of a bucket for a cost: one step if displacements are not charged."""
    return BUCKET_WIDTH * float(weights["base"]) or float(weights["step"])


@kernel
def push(queue: NodeQueue, f: float, node: int) -> None:
    """Push a node with estimate `f`; the queue must not be full.

    A node with a smaller estimate than the entry popped last goes into the current bucket.
    """
    status = queue.status
    bucket = max(int(min((f - status.lowest) / status.width, BUCKETS - 1)), status.bucket)
    entry = status.entry_count
    queue.node[entry], queue.next_entry[entry] = node, queue.head[bucket]
    queue.head[bucket] = entry
    status.entry_count = entry + 1


@kernel
def pop(queue: NodeQueue) -> int:
    """Pop an entry from the first bucket that holds one; return `NO_ENTRY` if all are empty."""
    status = queue.status
    while status.bucket < BUCKETS:
        entry = queue.head[status.bucket]
        if entry != NO_ENTRY:
            queue.head[status.bucket] = queue.next_entry[entry]
            return int(entry)
        status.bucket += 1
    return NO_ENTRY


@kernel
def requeue(queue: NodeQueue, entry: int) -> None:
    """Push an entry back into the current bucket, from which it was popped."""
    queue.next_entry[entry] = queue.head[queue.status.bucket]
    queue.head[queue.status.bucket] = entry


@kernel
def queue_lower_bound(queue: NodeQueue) -> float:
    """Return the start of the current bucket, a lower bound of all estimates in the queue.

    It is one as long as no smaller estimate is pushed, that is with a consistent heuristic.
    """
    return queue.status.lowest + queue.status.width * queue.status.bucket


@kernel
def is_current_bucket_empty(queue: NodeQueue) -> bool:
    """Return whether the current bucket is empty."""
    return bool(queue.head[queue.status.bucket] == NO_ENTRY)
