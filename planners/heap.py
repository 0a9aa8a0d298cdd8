"""Binary heaps of the compiled searches.

A heap holds indices of queue entries, shape (k,), in the order of their estimates `f`: the smallest
first, of equal ones the largest cost so far `g`, then the earliest entry.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import allocating_kernel, kernel

AnyArray = TypeVar("AnyArray", Array, IntArray)


@allocating_kernel
def grown(old: AnyArray) -> AnyArray:
    """A copy of an array of one axis with room for twice as many entries."""
    new = np.empty(2 * len(old), old.dtype)
    for k in range(len(old)):
        new[k] = old[k]
    return new


@kernel
def sift_up(heap: IntArray, size: int, f: Array, g: Array) -> None:
    """Move the last of `size` entries to its place in the heap."""
    place = size - 1
    item = heap[place]
    while place > 0:
        parent = (place - 1) >> 1
        other = heap[parent]
        if f[item] > f[other] or (
            f[item] == f[other] and (g[item] < g[other] or (g[item] == g[other] and item > other))
        ):
            break
        heap[place] = other
        place = parent
    heap[place] = item


@kernel
def sift_down(heap: IntArray, size: int, f: Array, g: Array) -> None:
    """Restore the order of `size` entries after the first of them was replaced."""
    place = 0
    item = heap[0]
    while True:
        child = 2 * place + 1
        if child >= size:
            break
        best = heap[child]
        if child + 1 < size:
            other = heap[child + 1]
            if f[other] < f[best] or (
                f[other] == f[best]
                and (g[other] > g[best] or (g[other] == g[best] and other < best))
            ):
                child += 1
                best = other
        if f[item] < f[best] or (
            f[item] == f[best] and (g[item] > g[best] or (g[item] == g[best] and item < best))
        ):
            break
        heap[place] = best
        place = child
    heap[place] = item
