"""Steps between nodes that were checked, for searches that are asked again (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry, kernel

CAPACITY = 1 << 14
"""Places of the table to begin with, a power of two."""

PRIME, FACTOR = 2_147_483_647, 40_503
"""What spreads bits over the places."""

EMPTY = -1
"""Key of a place that is free."""


class CheckedEdges(NamedTuple):
    """What was found of steps, by the bit of their pair, see `node_pairs`."""

    keys: IntArray
    """Bits, `EMPTY` where a place is free, shape (capacity,)."""
    kept: NDArray[np.uint64]
    """Masks of `held_beside` that the limbs keep which hold, 0 for what is no step, (capacity,)."""
    at: BoolArray
    """Nodes of which a step is known, shape (n,)."""

    @classmethod
    def none(cls, nodes: int, capacity: int = CAPACITY) -> CheckedEdges:
        """Nothing known yet of some number of nodes."""
        keys, kept = np.full(capacity, EMPTY, dtype=np.int64), np.zeros(capacity, dtype=np.uint64)
        return cls(keys, kept, np.zeros(nodes, dtype=np.bool_))

    def with_steps(self, nodes: IntArray, bits: IntArray, kept: NDArray[np.uint64]) -> CheckedEdges:
        """These and more: the nodes that they leave, their bits and what is kept, each (k,)."""
        used = int((self.keys != EMPTY).sum())
        wider = self
        if 2 * (used + len(bits)) > len(self.keys):
            capacity = len(self.keys)
            while 2 * (used + len(bits)) > capacity:
                capacity *= 2
            wider = CheckedEdges.none(0, capacity)._replace(at=self.at)
            old = self.keys != EMPTY
            _put(wider, self.keys[old], self.kept[old])
        _put(wider, bits, kept)
        wider.at[nodes] = True
        return wider

    def has(self, bits: IntArray) -> BoolArray:
        """Which steps are known, by their bits, shape (k,)."""
        return np.asarray(self.keys[self._places(bits)] == bits)

    def of(self, bits: IntArray) -> NDArray[np.uint64]:
        """What is kept on steps that are known, by their bits, shape (k,)."""
        kept: NDArray[np.uint64] = self.kept[self._places(bits)]
        return kept

    def _places(self, bits: IntArray) -> IntArray:
        places = np.empty(len(bits), dtype=np.int64)
        _find(self, bits, places)
        return places


@kernel
def place_of(known: CheckedEdges, bit: int) -> int:
    """Where a step is, or would be put."""
    last = len(known.keys) - 1
    place = (bit % PRIME * FACTOR) & last
    while known.keys[place] != EMPTY and known.keys[place] != bit:
        place = (place + 1) & last
    return place


@entry
def _find(known: CheckedEdges, bits: IntArray, places: IntArray) -> None:
    """Where steps are, or would be put, into `places`."""
    for k in range(len(bits)):
        places[k] = place_of(known, bits[k])


@entry
def _put(known: CheckedEdges, bits: IntArray, kept: NDArray[np.uint64]) -> None:
    """Note steps; there must be room."""
    for k in range(len(bits)):
        place = place_of(known, bits[k])
        known.keys[place], known.kept[place] = bits[k], kept[k]
