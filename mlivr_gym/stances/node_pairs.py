"""Pairs of nodes a move apart, and which of them a step may join (compiled).

Nodes with a rest in common differ in the point of one limb. Most such pairs are no steps: a limb
that holds would have to change its branch, or cannot follow the base. Those of which that is known
are left out of the bits that are kept: a square for each rest, a row and a column for each member.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_masks import all_keep_one, has_bit, held_beside, set_bit
from mlivr_gym.stances.node_table import NodeTable


def gathered(table: NodeTable) -> NDArray[np.uint8]:
    """Bits of the pairs that share branches, eight in a byte."""
    joined = np.zeros(count_pairs(table, 0, len(table.offset) - 1), dtype=np.bool_)
    gather(table, joined)
    return np.packbits(joined)


def ends_of(
    table: NodeTable, bits: IntArray
) -> tuple[tuple[IntArray, IntArray], tuple[IntArray, IntArray], IntArray]:
    """Members of pairs by their bits, and the bits of the same pairs the other way round.

    Args:
        table: The nodes.
        bits: Bits, shape (k,).

    Returns:
        Nodes and limbs of the rows, those of the columns, and bits, all of shape (k,).
    """
    rests = np.searchsorted(table.offset, bits, side="right") - 1
    begin, size = table.start[rests], np.diff(table.start)[rests].astype(np.int64)
    inside: IntArray = bits - table.offset[rests]
    a, b = inside // size, inside % size
    one, other = (table.members[begin + k].astype(np.int64) for k in (a, b))
    back: IntArray = table.offset[rests] + b * size + a
    limbs = table.limbs
    return (one // limbs, one % limbs), (other // limbs, other % limbs), back


@kernel
def row_of(table: NodeTable, node: int, limb: int) -> int:
    """The first bit of the row of a member of a rest; -1 if its limb cannot be released."""
    rest, limbs = table.rests[node, limb], table.points.shape[1]
    first, last = int(table.start[rest]), int(table.start[rest + 1])
    for k in range(first, last):
        if table.members[k] == node * limbs + limb:
            return int(table.offset[rest]) + (k - first) * (last - first)
    return -1


@kernel
def share_branches(table: NodeTable, a: int, b: int) -> bool:
    """Whether the limbs that hold at two members of a rest may be on a common branch each."""
    limbs = table.points.shape[1]
    held = held_beside(table.masks[a // limbs], a % limbs, limbs) & held_beside(
        table.masks[b // limbs], b % limbs, limbs
    )
    return all_keep_one(held, limbs)


@entry
def count_pairs(table: NodeTable, first: int, last: int) -> int:
    """How many pairs of members of some rests share branches."""
    count = 0
    for rest in range(first, last):
        for k in range(table.start[rest], table.start[rest + 1]):
            for m in range(k + 1, table.start[rest + 1]):
                if share_branches(table, table.members[k], table.members[m]):
                    count += 1
    return count


@entry
def list_pairs(table: NodeTable, first: int, last: int, pairs: IntArray) -> None:
    """The pairs of members of some rests that share branches, in order.

    Args:
        table: The nodes.
        first: The first rest.
        last: One past the last.
        pairs: Filled with indices of members, shape (p, 2), see `count_pairs`.
    """
    count = 0
    for rest in range(first, last):
        for k in range(table.start[rest], table.start[rest + 1]):
            for m in range(k + 1, table.start[rest + 1]):
                if share_branches(table, table.members[k], table.members[m]):
                    pairs[count, 0], pairs[count, 1] = k, m
                    count += 1


@entry
def spread(table: NodeTable, joined: BoolArray) -> None:
    """Set the bits of the table from those of the pairs that share branches.

    Args:
        table: The nodes; its bits are none, and are filled.
        joined: Whether a step may join each pair of `list_pairs`, all rests, shape (p,).
    """
    count = 0
    for rest in range(len(table.offset) - 1):
        first, last = int(table.start[rest]), int(table.start[rest + 1])
        size, at = last - first, int(table.offset[rest])
        for k in range(size):
            for m in range(k + 1, size):
                if share_branches(table, table.members[first + k], table.members[first + m]):
                    if joined[count]:
                        set_bit(table.bits, at + k * size + m)
                        set_bit(table.bits, at + m * size + k)
                    count += 1


@entry
def gather(table: NodeTable, joined: BoolArray) -> None:
    """The reverse of `spread`: `joined` from the bits of the table."""
    count = 0
    for rest in range(len(table.offset) - 1):
        first, last = int(table.start[rest]), int(table.start[rest + 1])
        size, at = last - first, int(table.offset[rest])
        for k in range(size):
            for m in range(k + 1, size):
                if share_branches(table, table.members[first + k], table.members[first + m]):
                    joined[count] = has_bit(table.bits, at + k * size + m)
                    count += 1
