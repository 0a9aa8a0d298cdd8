"""The queue of the compiled searches: a binary heap whose arrays grow between two calls (compiled).

Entries are taken in the order of their estimates `f`: the smallest first, of equal ones that with
the largest cost so far `g`, then the earliest.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record


class QueueSize(Record):
    """How far a queue is filled."""

    used: int
    """Entries made so far; entries are not used again."""
    size: int
    """Entries that wait."""


class Queue(NamedTuple):
    """Entries of a search, and a heap of those that wait."""

    filled: QueueSize
    f: Array
    """Estimate of each entry."""
    g: Array
    """Cost so far of each, or what else breaks ties."""
    cost: Array
    """Cost that goes with it where `g` is something else."""
    node: IntArray
    """What it is about."""
    link: IntArray
    """Where it comes from, or leads to."""
    bits: IntArray
    """Branches that go with it."""
    heap: IntArray
    """Entries that wait, by order."""


def queue(room: int) -> Queue:
    """An empty queue with room for some entries."""
    f, g, cost = (np.empty(room) for _ in range(3))
    node, link, bits, heap = (np.empty(room, dtype=np.int64) for _ in range(4))
    return Queue(QueueSize.row(), f, g, cost, node, link, bits, heap)


def grown(old: Any) -> Any:
    """A named tuple of arrays with room for twice as many entries; records stay."""
    return type(old)(
        *(
            np.concatenate([field, np.empty_like(field)])
            if isinstance(field, np.ndarray)
            else field
            for field in old
        )
    )


@kernel
def has_room(entries: Queue, more: int) -> bool:
    """Whether some more entries fit."""
    return int(entries.filled.used) + more <= len(entries.f)


@kernel
def first(entries: Queue) -> int:
    """The entry that comes first; there must be one."""
    return int(entries.heap[0])


@kernel
def _before(a: int, b: int, entries: Queue) -> bool:
    """Whether entry `a` comes before `b`."""
    f, g = entries.f, entries.g
    if f[a] != f[b]:
        return bool(f[a] < f[b])
    return bool(g[a] > g[b] or (g[a] == g[b] and a < b))


@kernel
def push(entries: Queue, f: float, g: float, cost: float, node: int, link: int, bits: int) -> None:
    """Add an entry; there must be room."""
    item, place = entries.filled.used, entries.filled.size
    entries.f[item], entries.g[item], entries.cost[item] = f, g, cost
    entries.node[item], entries.link[item], entries.bits[item] = node, link, bits
    entries.filled.used, entries.filled.size = item + 1, place + 1
    heap = entries.heap
    while place > 0:
        parent = (place - 1) // 2
        if _before(heap[parent], item, entries):
            break
        heap[place] = heap[parent]
        place = parent
    heap[place] = item


@kernel
def pop(entries: Queue) -> None:
    """Remove the entry that comes first."""
    entries.filled.size -= 1
    heap, size = entries.heap, entries.filled.size
    if size == 0:
        return
    item, place = heap[size], 0
    while True:
        child = 2 * place + 1
        if child >= size:
            break
        if child + 1 < size and _before(heap[child + 1], heap[child], entries):
            child += 1
        if _before(item, heap[child], entries):
            break
        heap[place] = heap[child]
        place = child
    heap[place] = item
