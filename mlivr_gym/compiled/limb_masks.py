"""Numbers of 64 bits: rows of bits, and the masks of up to four limbs in one (compiled).

Limb 0 has the lowest 16 bits.

What the limbs hold that do not move is compared as one number too: the masks of the others, in turn
from the limb after the one that moves. In that order they are the same whatever the robot's turn.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import IntArray
from mlivr_gym.compiled.kernels import entry, kernel

MOST_LIMBS = 4
"""Limbs whose masks fit into a number."""

WORD = 64
"""Bits of a number."""

WIDTH, ONE, NO_LIMB = np.uint64(16), np.uint64(1), np.uint64(0)
"""Bits of a mask; and numbers of the same type, since others would make floats of the result."""

MASK = np.uint64(0xFFFF)
"""All bits of the mask of limb 0."""

EVERY_LIMB = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
"""All bits."""


def packed(masks: IntArray) -> NDArray[np.uint64]:
    """Masks of limbs as numbers, shape (k, N) -> (k,)."""
    numbers = np.zeros(len(masks), dtype=np.uint64)
    for limb in range(masks.shape[1]):
        numbers |= masks[:, limb].astype(np.uint64) << (WIDTH * np.uint64(limb))
    return numbers


def unpacked(numbers: NDArray[np.uint64], limbs: int) -> IntArray:
    """Masks of N limbs, shape (k,) -> (k, N)."""
    places = WIDTH * np.arange(limbs, dtype=np.uint64)
    masks: IntArray = ((numbers[:, None] >> places) & MASK).astype(np.int64)
    return masks


@kernel
def mask_of(masks: np.uint64, limb: int) -> np.uint64:
    """Mask of one limb."""
    return (masks >> (WIDTH * np.uint64(limb))) & MASK


@kernel
def every_branch(limb: int) -> np.uint64:
    """All branches of one limb, none of the others."""
    return MASK << (WIDTH * np.uint64(limb))


@kernel
def held_beside(masks: np.uint64, limb: int, limbs: int) -> np.uint64:
    """Masks of the limbs other than `limb`, in turn from the one after it."""
    width = WIDTH * np.uint64(limbs)
    first = WIDTH * np.uint64((limb + 1) % limbs)
    turned = masks
    if first != NO_LIMB:
        turned = (masks >> first) | (masks << (width - first))
    return turned & (EVERY_LIMB >> (WIDTH * np.uint64(MOST_LIMBS + 1 - limbs)))


@kernel
def all_keep_one(held: np.uint64, limbs: int) -> bool:
    """Whether each of the masks of `held_beside` has a branch."""
    count = 0
    for k in range(limbs - 1):
        if mask_of(held, k) != NO_LIMB:
            count += 1
    return count == limbs - 1


@kernel
def beside(held: np.uint64, moved: np.uint64, limb: int, limbs: int) -> np.uint64:
    """Masks of all limbs from those of `held_beside` and that of the one that moved."""
    width = WIDTH * np.uint64(limbs)
    first = WIDTH * np.uint64((limb + 1) % limbs)
    turned = held | (moved << (width - WIDTH))
    if first != NO_LIMB:
        turned = (turned << first) | (turned >> (width - first))
    return turned & (EVERY_LIMB >> (WIDTH * np.uint64(MOST_LIMBS - limbs)))


@kernel
def has_bit(bits: NDArray[np.uint64], k: int) -> bool:
    """Whether bit `k` of a row of numbers is set."""
    return bool(bits[k // WORD] >> np.uint64(k % WORD) & ONE != NO_LIMB)


@kernel
def set_bit(bits: NDArray[np.uint64], k: int) -> None:
    """Set bit `k` of a row of numbers."""
    bits[k // WORD] |= ONE << np.uint64(k % WORD)


@entry
def clear_bits(bits: NDArray[np.uint64], which: IntArray) -> None:
    """Clear some bits of a row of numbers, by their indices, shape (k,)."""
    for k in which:
        bits[k // WORD] &= ~(ONE << np.uint64(k % WORD))


@kernel
def set_before(bits: NDArray[np.uint64], k: int) -> int:
    """How many bits of the same number before bit `k` of a row of numbers are set."""
    below, count = bits[k // WORD] & ((ONE << np.uint64(k % WORD)) - ONE), 0
    while below != NO_LIMB:
        below &= below - ONE
        count += 1
    return count
