"""Branch sets of up to four limbs in one 64-bit integer, and bit arrays of such integers.

The branch set of limb 0 has the lowest 16 bits. The branch sets of the support limbs of a step are
also compared as one integer, in cyclic order from the limb after the one that moves. In that order
they do not change when the limbs of the robot are relabelled cyclically.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import IntArray
from mlivr_gym.compiled.kernels import entry, kernel

PACKED_LIMBS = 4
"""Maximum number of limbs whose branch sets fit into one integer."""

WORD = 64
"""Number of bits of an integer."""

WIDTH, ONE, NO_BRANCHES = np.uint64(16), np.uint64(1), np.uint64(0)
"""Bits of a branch set, the number one, and the empty branch set.

They are of the type of the branch sets, since NumPy turns an unsigned and a signed integer into a
float. """

BRANCH_SET = np.uint64(0xFFFF)
"""All bits of the branch set of limb 0."""

EVERY_BRANCH_SET = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
"""All bits of the branch sets of all limbs."""


def packed(branch_sets: IntArray) -> NDArray[np.uint64]:
    """Return the branch sets of N limbs, shape (k, N), as one integer for each row, shape (k,)."""
    numbers = np.zeros(len(branch_sets), dtype=np.uint64)
    for limb in range(branch_sets.shape[1]):
        numbers |= branch_sets[:, limb].astype(np.uint64) << (WIDTH * np.uint64(limb))
    return numbers


def unpacked(numbers: NDArray[np.uint64], limbs: int) -> IntArray:
    """Return the branch sets of N limbs, shape (k, N), from integers of shape (k,)."""
    shifts = WIDTH * np.arange(limbs, dtype=np.uint64)
    branch_sets: IntArray = ((numbers[:, None] >> shifts) & BRANCH_SET).astype(np.int64)
    return branch_sets


@kernel
def branch_set_of(branch_sets: np.uint64, limb: int) -> np.uint64:
    """Return the branch set of one limb."""
    return (branch_sets >> (WIDTH * np.uint64(limb))) & BRANCH_SET


@kernel
def every_branch(limb: int) -> np.uint64:
    """Return the branch sets with all branches of one limb and none of the others."""
    return BRANCH_SET << (WIDTH * np.uint64(limb))


@kernel
def supports_of(branch_sets: np.uint64, limb: int, limbs: int) -> np.uint64:
    """Return the branch sets of the support limbs if `limb` moves, the one after it first."""
    width = WIDTH * np.uint64(limbs)
    first = WIDTH * np.uint64((limb + 1) % limbs)
    turned = branch_sets
    if first != NO_BRANCHES:
        turned = (branch_sets >> first) | (branch_sets << (width - first))
    return turned & (EVERY_BRANCH_SET >> (WIDTH * np.uint64(PACKED_LIMBS + 1 - limbs)))


@kernel
def each_keeps_one(of_supports: np.uint64, limbs: int) -> bool:
    """Return whether each branch set of `supports_of` has a branch."""
    count = 0
    for k in range(limbs - 1):
        if branch_set_of(of_supports, k) != NO_BRANCHES:
            count += 1
    return count == limbs - 1


@kernel
def after_move(of_supports: np.uint64, moved: np.uint64, limb: int, limbs: int) -> np.uint64:
    """Return the branch sets of all limbs from `supports_of` and that of the limb that moved."""
    width = WIDTH * np.uint64(limbs)
    first = WIDTH * np.uint64((limb + 1) % limbs)
    turned = of_supports | (moved << (width - WIDTH))
    if first != NO_BRANCHES:
        turned = (turned << first) | (turned >> (width - first))
    return turned & (EVERY_BRANCH_SET >> (WIDTH * np.uint64(PACKED_LIMBS - limbs)))


@kernel
def has_bit(bits: NDArray[np.uint64], k: int) -> bool:
    """Return whether bit `k` of a bit array is set."""
    return bool(bits[k // WORD] >> np.uint64(k % WORD) & ONE != NO_BRANCHES)


@kernel
def set_bit(bits: NDArray[np.uint64], k: int) -> None:
    """Set bit `k` of a bit array."""
    bits[k // WORD] |= ONE << np.uint64(k % WORD)


@entry
def clear_bits(bits: NDArray[np.uint64], indices: IntArray) -> None:
    """Clear the bits of a bit array with the given indices, shape (k,)."""
    for k in indices:
        bits[k // WORD] &= ~(ONE << np.uint64(k % WORD))


@kernel
def set_before(bits: NDArray[np.uint64], k: int) -> int:
    """Return how many bits before bit `k` are set in its word of a bit array."""
    below, count = bits[k // WORD] & ((ONE << np.uint64(k % WORD)) - ONE), 0
    while below != NO_BRANCHES:
        below &= below - ONE
        count += 1
    return count
