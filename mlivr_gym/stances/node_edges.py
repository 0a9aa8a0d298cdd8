"""Edges between nodes of a table, and the branches that steps along them keep at most (compiled).

Two nodes with a common support set differ in the point of one limb. An edge leads from one to the
other unless a support limb would have to change its branch, or cannot follow the base. The table
has a bit for each ordered pair of nodes, in a square for each support set with a row and a column
for each member; the number of an edge is that of its bit. Along most edges the support limbs keep
every branch that both nodes have; for the others the table has the branches that are lost. They
are the same for an edge and the one back.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_branch_sets import (
    NO_BRANCHES,
    WORD,
    each_keeps_one,
    has_bit,
    packed,
    set_before,
    set_bit,
    supports_of,
    unpacked,
)
from mlivr_gym.compiled.records import Record
from mlivr_gym.postures.relabelling import relabelled
from mlivr_gym.stances.node_table import NodeTable


class EdgeSet(NamedTuple):
    """Edges among the pairs of nodes that share branches, in the order of `list_node_pairs`."""

    joined: BoolArray
    """Whether an edge joins each pair, shape (p,)."""
    loses_branches: BoolArray
    """Whether each edge loses branches that both nodes have, shape (j,)."""
    lost: NDArray[np.uint64]
    """The lost branches, as `supports_of`, of each edge that loses some, shape (l,)."""

    @classmethod
    def of(cls, shared: NDArray[np.uint64], kept: NDArray[np.uint64]) -> EdgeSet:
        """Return the edges by the branches that both nodes have and those kept at most, (p,)."""
        joined = kept != NO_BRANCHES
        lost = shared[joined] & ~kept[joined]
        return cls(joined, lost != NO_BRANCHES, lost[lost != NO_BRANCHES])


class NodePair(Record):
    """Two members of a support set, in any order, from which `next_node_pair` continues."""

    support_set: int
    """Number of the support set."""
    first: int
    """Index of the first of the two in `members`."""
    second: int
    """Index of the second, which is larger."""

    @classmethod
    def before(cls, table: NodeTable, support_set: int) -> Any:
        """Return the place before the first pair of a support set, a row."""
        pair = cls.row()
        pair["support_set"], pair["first"], pair["second"] = (
            support_set,
            table.start[support_set],
            table.start[support_set],
        )
        return pair


def edge_ends(
    table: NodeTable, edges: IntArray
) -> tuple[tuple[IntArray, IntArray], tuple[IntArray, IntArray], IntArray]:
    """Return (nodes, limbs) before edges, those after them, and the reverse edges, all (k,)."""
    support_sets = np.searchsorted(table.offset, edges, side="right") - 1
    begin = table.start[support_sets]
    size = (table.start[support_sets + 1] - begin).astype(np.int64)
    inside: IntArray = edges - table.offset[support_sets]
    a, b = inside // size, inside % size
    one, other = (table.members[begin + k].astype(np.int64) for k in (a, b))
    back: IntArray = table.offset[support_sets] + b * size + a
    limbs = table.limbs
    return (one // limbs, one % limbs), (other // limbs, other % limbs), back


def every_edge(table: NodeTable) -> IntArray:
    """Return the numbers of all edges of a table, ascending, shape (e,)."""
    bits = np.unpackbits(table.joined.view(np.uint8), bitorder="little")
    return np.flatnonzero(bits)


def kept_by_table(table: NodeTable, edges: IntArray) -> NDArray[np.uint64]:
    """Return the branches that supports keep by a table, as `supports_of`; 0 for no edge, (k,)."""
    (before, i), (after, j), _ = edge_ends(table, edges)
    kept = _shared(table, before, i) & _shared(table, after, j)
    word, bit = edges // WORD, (edges % WORD).astype(np.uint64)
    one, loses = np.uint64(1), table.loses_branches[word]
    losing = np.flatnonzero(loses >> bit & one)
    rank = table.ranks[word] + np.bitwise_count(loses & ((one << bit) - one))
    kept[losing] &= ~table.lost[rank[losing]]
    kept[(table.joined[word] >> bit & one) == 0] = NO_BRANCHES
    return kept


def _shared(table: NodeTable, rows: IntArray, limb: IntArray) -> NDArray[np.uint64]:
    """Return the branch sets of the supports of nodes if limbs move, as `supports_of`, (k,)."""
    return packed(relabelled(unpacked(table.branch_sets[rows], table.limbs), limb + 1)[:, :-1])


def with_kept(table: NodeTable, edges: IntArray, kept: NDArray[np.uint64]) -> NodeTable:
    """Return a table whose edges, of ascending numbers, keep branches, as `supports_of`, (e,)."""
    (before, i), (after, j), _ = edge_ends(table, edges)
    lost = _shared(table, before, i) & _shared(table, after, j) & ~kept
    lost[kept == NO_BRANCHES] = NO_BRANCHES
    size = WORD * len(table.joined)
    joined, loses_branches = np.zeros((2, size), dtype=np.uint8)
    joined[edges[kept != NO_BRANCHES]] = 1
    loses_branches[edges[lost != NO_BRANCHES]] = 1
    bits, loses = (
        np.packbits(one, bitorder="little").view(np.uint64) for one in (joined, loses_branches)
    )
    lost = lost[lost != NO_BRANCHES]
    return table._replace(joined=bits, loses_branches=loses, ranks=_ranks(loses), lost=lost)


def _ranks(loses_branches: NDArray[np.uint64]) -> NDArray[np.int32]:
    """Return the number of bits set before each word, see `NodeTable.ranks`."""
    counts = np.bitwise_count(loses_branches)
    ranks: NDArray[np.int32] = np.cumsum(counts, dtype=np.int32) - counts
    return ranks


@kernel
def row_of(table: NodeTable, node: int, limb: int) -> int:
    """Return the first bit of the row of a member; -1 if its limb cannot be released."""
    support_set, member = table.support_sets[node, limb], node * table.points.shape[1] + limb
    first, last = int(table.start[support_set]), int(table.start[support_set + 1])
    low, high = first, last
    while low < high:
        middle = (low + high) // 2
        if table.members[middle] < member:
            low = middle + 1
        else:
            high = middle
    if low < last and table.members[low] == member:
        return int(table.offset[support_set]) + (low - first) * (last - first)
    return -1


@kernel
def share_branches(table: NodeTable, a: int, b: int) -> bool:
    """Return whether each support limb of two members has a branch that both nodes have."""
    limbs = table.points.shape[1]
    shared = supports_of(table.branch_sets[a // limbs], a % limbs, limbs) & supports_of(
        table.branch_sets[b // limbs], b % limbs, limbs
    )
    return each_keeps_one(shared, limbs)


@kernel
def branches_lost(table: NodeTable, edge: int) -> np.uint64:
    """Return the branches that both nodes of an edge have and a step loses, as `supports_of`."""
    if not has_bit(table.loses_branches, edge):
        return NO_BRANCHES
    return np.uint64(table.lost[table.ranks[edge // WORD] + set_before(table.loses_branches, edge)])


@kernel
def next_node_pair(table: NodeTable, pair: NodePair, last: int) -> bool:
    """Go on to the next pair that shares branches; return False if none comes before `last`."""
    while pair.support_set < last:
        stop = int(table.start[pair.support_set + 1])
        pair.second += 1
        if pair.second >= stop:
            pair.first += 1
            pair.second = pair.first + 1
        if pair.second < stop:
            if share_branches(table, table.members[pair.first], table.members[pair.second]):
                return True
        elif pair.first + 1 >= stop:
            pair.support_set += 1
            pair.first = pair.second = stop
    return False


@kernel
def _edge_of(table: NodeTable, support_set: int, row: int, column: int) -> int:
    """Return the number of the edge between two members."""
    begin, end = int(table.start[support_set]), int(table.start[support_set + 1])
    return int(table.offset[support_set]) + (row - begin) * (end - begin) + column - begin


@entry
def count_node_pairs(table: NodeTable, pair: NodePair, last: int) -> int:
    """Count the pairs of members that share branches, see `next_node_pair`."""
    count = 0
    while next_node_pair(table, pair, last):
        count += 1
    return count


@entry
def list_node_pairs(table: NodeTable, pair: NodePair, last: int, pairs: IntArray) -> None:
    """List the pairs of members that share branches from `pair` on, up to support set `last`.

    Their indices are written into `pairs`, shape (p, 2), see `count_node_pairs`.
    """
    count = 0
    while next_node_pair(table, pair, last):
        pairs[count, 0], pairs[count, 1] = pair.first, pair.second
        count += 1


def with_edges(table: NodeTable, known: EdgeSet) -> NodeTable:
    """Return a table with all its edges; a ValueError if they are those of another table."""
    words, support_sets = len(table.joined), len(table.offset) - 1
    joined, loses_branches = (np.zeros(words, dtype=np.uint64) for _ in range(2))
    blank = table._replace(joined=joined, loses_branches=loses_branches)
    complete = _set_bits(blank, NodePair.before(table, 0), support_sets, known)
    count = int(np.bitwise_count(loses_branches).sum())
    if not complete or count != 2 * len(known.lost):
        raise ValueError
    full = blank._replace(ranks=_ranks(loses_branches), lost=np.empty(count, dtype=np.uint64))
    _set_lost(full, NodePair.before(table, 0), support_sets, known)
    return full


def edges_of(table: NodeTable) -> EdgeSet:
    """Return all edges of a table, the inverse of `with_edges`."""
    support_sets, steps = len(table.offset) - 1, int(np.bitwise_count(table.joined).sum()) // 2
    edge_set = EdgeSet(
        np.zeros(count_node_pairs(table, NodePair.before(table, 0), support_sets), dtype=np.bool_),
        np.zeros(steps, dtype=np.bool_),
        np.zeros(len(table.lost) // 2, dtype=np.uint64),
    )
    _get(table, NodePair.before(table, 0), support_sets, edge_set)
    return edge_set


@entry
def _set_bits(table: NodeTable, pair: NodePair, last: int, known: EdgeSet) -> bool:
    """Set the bits of the edges, and of those that lose branches.

    Returns whether their number is that of the pairs of nodes.
    """
    count, steps = 0, 0
    while next_node_pair(table, pair, last):
        if count == len(known.joined):
            return False
        if known.joined[count]:
            if steps == len(known.loses_branches):
                return False
            there = _edge_of(table, pair.support_set, pair.first, pair.second)
            back = _edge_of(table, pair.support_set, pair.second, pair.first)
            set_bit(table.joined, there)
            set_bit(table.joined, back)
            if known.loses_branches[steps]:
                set_bit(table.loses_branches, there)
                set_bit(table.loses_branches, back)
            steps += 1
        count += 1
    return count == len(known.joined) and steps == len(known.loses_branches)


@entry
def _set_lost(table: NodeTable, pair: NodePair, last: int, known: EdgeSet) -> None:
    """Write the branches that edges lose where `branches_lost` reads them."""
    count = 0
    while next_node_pair(table, pair, last):
        for back in range(2):
            first, second = (pair.second, pair.first) if back else (pair.first, pair.second)
            edge = _edge_of(table, pair.support_set, first, second)
            if has_bit(table.loses_branches, edge):
                rank = table.ranks[edge // WORD] + set_before(table.loses_branches, edge)
                table.lost[rank] = known.lost[count]
                count += back


@entry
def _get(table: NodeTable, pair: NodePair, last: int, found: EdgeSet) -> None:
    """Read the edges, see `edges_of`."""
    count, steps, loses_branches = 0, 0, 0
    while next_node_pair(table, pair, last):
        edge = _edge_of(table, pair.support_set, pair.first, pair.second)
        if has_bit(table.joined, edge):
            found.joined[count] = True
            if has_bit(table.loses_branches, edge):
                found.loses_branches[steps], found.lost[loses_branches] = (
                    True,
                    branches_lost(table, edge),
                )
                loses_branches += 1
            steps += 1
        count += 1
