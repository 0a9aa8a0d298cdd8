"""The queue of a search over millions of nodes, kept small: a binary heap (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.compiled.kernels import kernel


class NodeQueue(NamedTuple):
    """Nodes that wait, those of the smallest estimate first."""

    f: NDArray[np.float64]
    """Estimates, in the order of the heap, shape (room,)."""
    node: NDArray[np.int32]
    """Nodes, shape (room,)."""

    @classmethod
    def of(cls, room: int) -> NodeQueue:
        """Room for some entries."""
        return cls(np.empty(room), np.empty(room, dtype=np.int32))

    def wider(self) -> NodeQueue:
        """The same with twice as much room."""
        return NodeQueue(*(np.concatenate([one, np.empty_like(one)]) for one in self))


@kernel
def put(waiting: NodeQueue, size: int, f: float, node: int) -> None:
    """Add an entry to a queue of some size; there must be room."""
    place = size
    while place > 0:
        parent = (place - 1) // 2
        if waiting.f[parent] <= f:
            break
        waiting.f[place], waiting.node[place] = waiting.f[parent], waiting.node[parent]
        place = parent
    waiting.f[place], waiting.node[place] = f, node


@kernel
def drop(waiting: NodeQueue, size: int) -> None:
    """Remove the first entry of a queue, of which `size` are left then."""
    f, node, place = waiting.f[size], waiting.node[size], 0
    while True:
        child = 2 * place + 1
        if child >= size:
            break
        if child + 1 < size and waiting.f[child + 1] < waiting.f[child]:
            child += 1
        if f <= waiting.f[child]:
            break
        waiting.f[place], waiting.node[place] = waiting.f[child], waiting.node[child]
        place = child
    waiting.f[place], waiting.node[place] = f, node
