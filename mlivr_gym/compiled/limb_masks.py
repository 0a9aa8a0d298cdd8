"""Branch masks of up to four limbs in one 64-bit integer, and bit arrays of such integers.

The mask of limb 0 has the lowest 16 bits. The masks of the support limbs of a step are also
compared as one integer, in cyclic order from the limb after the one that moves. In that order they
do not change when the limbs of the robot are relabelled cyclically.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import IntArray
from mlivr_gym.compiled.kernels import entry, kernel

MOST_LIMBS = 4
"""Maximum number of limbs whose masks fit into one integer."""

WORD = 64
"""Number of bits of an integer."""

WIDTH, ONE, NO_LIMB = np.uint64(16), np.uint64(1), np.uint64(0)
"""Bits of a mask, the number one, and the empty mask.

They are of the type of the masks, since NumPy turns an unsigned and a signed integer into a float.
"""

MASK = np.uint64(0xFFFF)
"""All bits of the mask of limb 0."""

EVERY_LIMB = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
"""All bits of the masks of all limbs."""


def packed(masks: IntArray) -> NDArray[np.uint64]:
    """Return the masks of N limbs, shape (k, N), as one integer for each row, shape (k,)."""
    numbers = np.zeros(len(masks), dtype=np.uint64)
    for limb in range(masks.shape[1]):
        numbers |= masks[:, limb].astype(np.uint64) << (WIDTH * np.uint64(limb))
    return numbers


def unpacked(numbers: NDArray[np.uint64], limbs: int) -> IntArray:
    """Return the masks of N limbs, shape (k, N), from integers of shape (k,)."""
    places = WIDTH * np.arange(limbs, dtype=np.uint64)
    masks: IntArray = ((numbers[:, None] >> places) & MASK).astype(np.int64)
    return masks


@kernel
def mask_of(masks: np.uint64, limb: int) -> np.uint64:
    """Return the mask of one limb."""
    return (masks >> (WIDTH * np.uint64(limb))) & MASK


@kernel
def every_branch(limb: int) -> np.uint64:
    """Return the masks with all branches of one limb and none of the others."""
    return MASK << (WIDTH * np.uint64(limb))


@kernel
def held_beside(masks: np.uint64, limb: int, limbs: int) -> np.uint64:
    """Return the masks of the limbs other than `limb`, in cyclic order from the one after it."""
    width = WIDTH * np.uint64(limbs)
    first = WIDTH * np.uint64((limb + 1) % limbs)
    turned = masks
    if first != NO_LIMB:
        turned = (masks >> first) | (masks << (width - first))
    return turned & (EVERY_LIMB >> (WIDTH * np.uint64(MOST_LIMBS + 1 - limbs)))


@kernel
def all_keep_one(held: np.uint64, limbs: int) -> bool:
    """Return whether each mask of `held_beside` has a branch."""
    count = 0
    for k in range(limbs - 1):
        if mask_of(held, k) != NO_LIMB:
            count += 1
    return count == limbs - 1


@kernel
def beside(held: np.uint64, moved: np.uint64, limb: int, limbs: int) -> np.uint64:
    """Return the masks of all limbs: those of `held_beside`, and that of the limb that moved."""
    width = WIDTH * np.uint64(limbs)
    first = WIDTH * np.uint64((limb + 1) % limbs)
    turned = held | (moved << (width - WIDTH))
    if first != NO_LIMB:
        turned = (turned << first) | (turned >> (width - first))
    return turned & (EVERY_LIMB >> (WIDTH * np.uint64(MOST_LIMBS - limbs)))


@kernel
def has_bit(bits: NDArray[np.uint64], k: int) -> bool:
    """Return whether bit `k` of a bit array is set."""
    return bool(bits[k // WORD] >> np.uint64(k % WORD) & ONE != NO_LIMB)


@kernel
def set_bit(bits: NDArray[np.uint64], k: int) -> None:
    """Set bit `k` of a bit array."""
    bits[k // WORD] |= ONE << np.uint64(k % WORD)


@entry
def clear_bits(bits: NDArray[np.uint64], which: IntArray) -> None:
    """Clear the bits of a bit array with the given indices, shape (k,)."""
    for k in which:
        bits[k // WORD] &= ~(ONE << np.uint64(k % WORD))


@kernel
def set_before(bits: NDArray[np.uint64], k: int) -> int:
    """Return how many bits before bit `k` are set in its word of a bit array."""
    below, count = bits[k // WORD] & ((ONE << np.uint64(k % WORD)) - ONE), 0
    while below != NO_LIMB:
        below &= below - ONE
        count += 1
    return count
