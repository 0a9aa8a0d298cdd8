"""Pairs of nodes that are one step apart, and the branches that steps keep at most (compiled).

Nodes with a common support set differ in the point of one limb. Many such pairs are no steps: a
support limb would have to change its branch, or cannot follow the base. The table has a bit for
each pair: a square for each support set, with a row and a column for each member. On most steps the
support limbs keep every branch that both nodes have; for the others the table has those that are
lost.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_masks import (
    NO_LIMB,
    WORD,
    all_keep_one,
    has_bit,
    held_beside,
    set_before,
    set_bit,
)
from mlivr_gym.compiled.records import Record
from mlivr_gym.stances.node_table import NodeTable


class EdgeSet(NamedTuple):
    """Results for pairs that share branches, in the order of `list_pairs`."""

    joined: BoolArray
    """Whether a step may join each pair, there or back, shape (p,)."""
    loses_branches: BoolArray
    """Whether a step loses branches that both nodes have, for each joined pair, shape (j,)."""
    lost: NDArray[np.uint64]
    """The lost branches, as `held_beside`, for each pair that loses some, shape (l,)."""

    @classmethod
    def of(cls, shared: NDArray[np.uint64], kept: NDArray[np.uint64]) -> EdgeSet:
        """Return results from the branches that both nodes have and those kept at most, (p,)."""
        joined = kept != NO_LIMB
        lost = shared[joined] & ~kept[joined]
        return cls(joined, lost != NO_LIMB, lost[lost != NO_LIMB])

    @classmethod
    def joint(cls, parts: list[EdgeSet]) -> EdgeSet:
        """Return several results in order."""
        return cls(*map(np.concatenate, zip(*parts, strict=True)))


class Pair(Record):
    """A pair of members of a support set, from which `next_pair` continues."""

    support: int
    """Number of the support set."""
    first: int
    """Index of the first of the two in `members`."""
    second: int
    """Index of the second, which is larger."""

    @classmethod
    def before(cls, table: NodeTable, support: int) -> Any:
        """Return the place before the first pair of a support set, a row."""
        pair = cls.row()
        pair["support"], pair["first"], pair["second"] = (
            support,
            table.start[support],
            table.start[support],
        )
        return pair


def edge_ends(
    table: NodeTable, bits: IntArray
) -> tuple[tuple[IntArray, IntArray], tuple[IntArray, IntArray], IntArray]:
    """Return the nodes and limbs of pairs by their bits, and the bits of the reverse pairs.

    Parameters
    ----------
    table
        The nodes.
    bits
        Bits, shape (k,).

    Returns
    -------
    tuple[tuple[IntArray, IntArray], tuple[IntArray, IntArray], IntArray]
        Nodes and limbs of the rows, those of the columns, and bits, all of shape (k,).
    """
    supports = np.searchsorted(table.offset, bits, side="right") - 1
    begin, size = table.start[supports], np.diff(table.start)[supports].astype(np.int64)
    inside: IntArray = bits - table.offset[supports]
    a, b = inside // size, inside % size
    one, other = (table.members[begin + k].astype(np.int64) for k in (a, b))
    back: IntArray = table.offset[supports] + b * size + a
    limbs = table.limbs
    return (one // limbs, one % limbs), (other // limbs, other % limbs), back


@kernel
def row_of(table: NodeTable, node: int, limb: int) -> int:
    """Return the first bit of the row of a member; -1 if its limb cannot be released."""
    support, member = table.supports[node, limb], node * table.points.shape[1] + limb
    first, last = int(table.start[support]), int(table.start[support + 1])
    low, high = first, last
    while low < high:
        middle = (low + high) // 2
        if table.members[middle] < member:
            low = middle + 1
        else:
            high = middle
    if low < last and table.members[low] == member:
        return int(table.offset[support]) + (low - first) * (last - first)
    return -1


@kernel
def share_branches(table: NodeTable, a: int, b: int) -> bool:
    """Return whether each support limb of two members has a branch that both nodes have."""
    limbs = table.points.shape[1]
    held = held_beside(table.masks[a // limbs], a % limbs, limbs) & held_beside(
        table.masks[b // limbs], b % limbs, limbs
    )
    return all_keep_one(held, limbs)


@kernel
def branches_lost(table: NodeTable, bit: int) -> np.uint64:
    """Return the branches that both nodes of a pair have and a step loses, as `held_beside`."""
    if not has_bit(table.loses_branches, bit):
        return NO_LIMB
    return np.uint64(table.lost[table.ranks[bit // WORD] + set_before(table.loses_branches, bit)])


@kernel
def next_pair(table: NodeTable, pair: Pair, last: int) -> bool:
    """Go on to the next pair that shares branches; return False if none comes before `last`."""
    while pair.support < last:
        stop = int(table.start[pair.support + 1])
        pair.second += 1
        if pair.second >= stop:
            pair.first += 1
            pair.second = pair.first + 1
        if pair.second < stop:
            if share_branches(table, table.members[pair.first], table.members[pair.second]):
                return True
        elif pair.first + 1 >= stop:
            pair.support += 1
            pair.first = pair.second = stop
    return False


@kernel
def _bit_of(table: NodeTable, support: int, row: int, column: int) -> int:
    """Return the bit of a pair of members."""
    begin, end = int(table.start[support]), int(table.start[support + 1])
    return int(table.offset[support]) + (row - begin) * (end - begin) + column - begin


@entry
def count_pairs(table: NodeTable, pair: Pair, last: int) -> int:
    """Count the pairs of members that share branches, see `next_pair`."""
    count = 0
    while next_pair(table, pair, last):
        count += 1
    return count


@entry
def list_pairs(table: NodeTable, pair: Pair, last: int, pairs: IntArray) -> None:
    """List the pairs of members that share branches, in order, see `next_pair`.

    Parameters
    ----------
    table
        The nodes.
    pair
        Place before the first pair.
    last
        Number of the support set at which the list ends.
    pairs
        Receives indices of members, shape (p, 2), see `count_pairs`.
    """
    count = 0
    while next_pair(table, pair, last):
        pairs[count, 0], pairs[count, 1] = pair.first, pair.second
        count += 1


def spread(table: NodeTable, known: EdgeSet) -> NodeTable:
    """Return a table with the results for all its pairs, which it does not have yet.

    Raises
    ------
    ValueError
        If there are results for more or fewer pairs.
    """
    words, supports = len(table.bits), len(table.offset) - 1
    bits, loses_branches = (np.zeros(words, dtype=np.uint64) for _ in range(2))
    blank = table._replace(bits=bits, loses_branches=loses_branches)
    complete = _set_bits(blank, Pair.before(table, 0), supports, known)
    counts = np.bitwise_count(loses_branches)
    if not complete or counts.sum() != 2 * len(known.lost):
        raise ValueError
    ranks = np.cumsum(counts, dtype=np.int32) - counts
    full = blank._replace(ranks=ranks, lost=np.empty(int(counts.sum()), dtype=np.uint64))
    _set_lost(full, Pair.before(table, 0), supports, known)
    return full


def gather(table: NodeTable) -> EdgeSet:
    """Return the results for all pairs of a table, the inverse of `spread`."""
    supports, steps = len(table.offset) - 1, int(np.bitwise_count(table.bits).sum()) // 2
    found = EdgeSet(
        np.zeros(count_pairs(table, Pair.before(table, 0), supports), dtype=np.bool_),
        np.zeros(steps, dtype=np.bool_),
        np.zeros(len(table.lost) // 2, dtype=np.uint64),
    )
    _get(table, Pair.before(table, 0), supports, found)
    return found


@entry
def _set_bits(table: NodeTable, pair: Pair, last: int, known: EdgeSet) -> bool:
    """Set the bits of joined pairs, and of those that lose branches.

    Returns whether there is a result for each pair, and no other.
    """
    count, steps = 0, 0
    while next_pair(table, pair, last):
        if count == len(known.joined):
            return False
        if known.joined[count]:
            if steps == len(known.loses_branches):
                return False
            there = _bit_of(table, pair.support, pair.first, pair.second)
            back = _bit_of(table, pair.support, pair.second, pair.first)
            set_bit(table.bits, there)
            set_bit(table.bits, back)
            if known.loses_branches[steps]:
                set_bit(table.loses_branches, there)
                set_bit(table.loses_branches, back)
            steps += 1
        count += 1
    return count == len(known.joined) and steps == len(known.loses_branches)


@entry
def _set_lost(table: NodeTable, pair: Pair, last: int, known: EdgeSet) -> None:
    """Write the branches that steps lose where `branches_lost` reads them."""
    count = 0
    while next_pair(table, pair, last):
        for turn in range(2):
            first, second = (pair.second, pair.first) if turn else (pair.first, pair.second)
            bit = _bit_of(table, pair.support, first, second)
            if has_bit(table.loses_branches, bit):
                place = table.ranks[bit // WORD] + set_before(table.loses_branches, bit)
                table.lost[place] = known.lost[count]
                count += turn


@entry
def _get(table: NodeTable, pair: Pair, last: int, found: EdgeSet) -> None:
    """Read the results for pairs, see `gather`."""
    count, steps, loses_branches = 0, 0, 0
    while next_pair(table, pair, last):
        bit = _bit_of(table, pair.support, pair.first, pair.second)
        if has_bit(table.bits, bit):
            found.joined[count] = True
            if has_bit(table.loses_branches, bit):
                found.loses_branches[steps], found.lost[loses_branches] = (
                    True,
                    branches_lost(table, bit),
                )
                loses_branches += 1
            steps += 1
        count += 1
