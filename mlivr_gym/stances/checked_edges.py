"""Edges that were looked at or checked, in a hash table with open addressing (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.stances.node_edges import edge_ends
from mlivr_gym.stances.node_table import NodeTable

INITIAL_CAPACITY = 1 << 14
"""Initial number of slots of the hash table, a power of two."""

PRIME, FACTOR = 2_147_483_647, 40_503
"""Modulus and factor of the hash function."""

EMPTY = -1
"""Key of an empty slot."""


class CheckedEdges(NamedTuple):
    """Branches kept on edges that were looked at, by the number of the edge, see `node_edges`."""

    keys: IntArray
    """Numbers of the edges, `EMPTY` in an empty slot, shape (capacity,)."""
    kept: NDArray[np.uint64]
    """Branch sets of `supports_of` that the support limbs keep, 0 for an edge that is no step,
    shape (capacity,)."""
    is_exact: BoolArray
    """Whether these were checked, so that they keep no fewer, shape (capacity,)."""
    has_edges: BoolArray
    """Whether an edge from each node is here, shape (n,)."""

    @classmethod
    def empty(cls, nodes: int, capacity: int = INITIAL_CAPACITY) -> CheckedEdges:
        """Return an empty hash table for the edges of some number of nodes."""
        keys, kept = np.full(capacity, EMPTY, dtype=np.int64), np.zeros(capacity, dtype=np.uint64)
        flags = np.zeros(capacity, dtype=np.bool_), np.zeros(nodes, dtype=np.bool_)
        return cls(keys, kept, *flags)

    def with_edges(
        self, nodes: IntArray, edges: IntArray, kept: NDArray[np.uint64], is_exact: BoolArray
    ) -> CheckedEdges:
        """Return the hash table with k more edges, in place if there is capacity.

        Each leaves a node, and its support limbs keep branch sets, exactly or at most.
        """
        edge_count = int((self.keys != EMPTY).sum())
        table = self
        if 2 * (edge_count + len(edges)) > len(self.keys):
            capacity = len(self.keys)
            while 2 * (edge_count + len(edges)) > capacity:
                capacity *= 2
            table = CheckedEdges.empty(0, capacity)._replace(has_edges=self.has_edges)
            occupied = self.keys != EMPTY
            _put(table, self.keys[occupied], self.kept[occupied], self.is_exact[occupied])
        _put(table, edges, kept, is_exact)
        table.has_edges[nodes] = True
        return table

    def without_nodes(self, table: NodeTable, gone: BoolArray) -> CheckedEdges:
        """Return the hash table without the edges from or to some nodes of a table, (n,)."""
        edges, kept = self.all_edges()
        (before, _), (after, _), _ = edge_ends(table, edges)
        stay = ~(gone[before] | gone[after])
        is_exact = self.is_exact[self.keys != EMPTY]
        found = before[stay], edges[stay], kept[stay], is_exact[stay]
        return CheckedEdges.empty(len(gone)).with_edges(*found)

    def all_edges(self) -> tuple[IntArray, NDArray[np.uint64]]:
        """Return the numbers of all edges and the branch sets kept on them, shape (k,) each."""
        is_used = self.keys != EMPTY
        return self.keys[is_used], self.kept[is_used]

    def contains(self, edges: IntArray) -> BoolArray:
        """Return whether edges were looked at or checked, by their numbers, shape (k,)."""
        return np.asarray(self.keys[self._slots(edges)] == edges)

    def are_exact(self, edges: IntArray) -> BoolArray:
        """Return whether edges were checked, by their numbers, shape (k,)."""
        slots = self._slots(edges)
        return np.asarray((self.keys[slots] == edges) & self.is_exact[slots])

    def kept_on(self, edges: IntArray) -> NDArray[np.uint64]:
        """Return the branch sets kept on edges that it has, by their numbers, shape (k,)."""
        kept: NDArray[np.uint64] = self.kept[self._slots(edges)]
        return kept

    def _slots(self, edges: IntArray) -> IntArray:
        """Return the slots of edges, shape (k,)."""
        slots = np.empty(len(edges), dtype=np.int64)
        _find(self, edges, slots)
        return slots


@kernel
def slot_of(checked_edges: CheckedEdges, edge: int) -> int:
    """Return the slot of an edge, or the empty slot for it."""
    last_slot = len(checked_edges.keys) - 1
    slot = (edge % PRIME * FACTOR) & last_slot
    while checked_edges.keys[slot] != EMPTY and checked_edges.keys[slot] != edge:
        slot = (slot + 1) & last_slot
    return slot


@entry
def _find(checked_edges: CheckedEdges, edges: IntArray, slots: IntArray) -> None:
    """Write the slots of edges into `slots`."""
    for k in range(len(edges)):
        slots[k] = slot_of(checked_edges, edges[k])


@entry
def _put(
    checked_edges: CheckedEdges, edges: IntArray, kept: NDArray[np.uint64], is_exact: BoolArray
) -> None:
    """Store edges; the hash table must have capacity."""
    for k in range(len(edges)):
        slot = slot_of(checked_edges, edges[k])
        checked_edges.keys[slot], checked_edges.kept[slot] = edges[k], kept[k]
        checked_edges.is_exact[slot] = is_exact[k]
