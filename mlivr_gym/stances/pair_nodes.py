"""The stances and steps of two limbs as a node table, which searches read (compiled)."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_masks import WORD, has_bit, set_before, set_bit
from mlivr_gym.stances.node_table import Nodes, NodeTable, table_of
from mlivr_gym.stances.pair_steps import PairTable, branches_kept, edge_index
from mlivr_gym.transitions.rule import kept_on_edge


def pair_nodes(pairs: PairTable, tried: IntArray) -> NodeTable:
    """Return a node table with the steps known so far.

    A step that is not known is assumed to keep all branches that both of its stances have.

    Parameters
    ----------
    pairs
        The stances and steps.
    tried
        Number of the candidate base pose of each stance, shape (n,).
    """
    released, folds = pairs.mask, np.zeros_like(pairs.mask)
    if pairs.check:
        known = pairs.released["known"]
        released = np.where(known, pairs.released["branches"], pairs.mask).astype(np.int64)
        folds = pairs.released["folds"].astype(np.int64)
    table = table_of(Nodes(pairs.points, pairs.base, pairs.mask, released, folds, tried))
    bits, loses_branches = (np.zeros_like(table.bits) for _ in range(2))
    table = table._replace(bits=bits, loses_branches=loses_branches)
    mark_steps(table, pairs)
    counts = np.bitwise_count(loses_branches)
    ranks = np.cumsum(counts, dtype=np.int32) - counts
    table = table._replace(ranks=ranks, lost=np.empty(int(counts.sum()), dtype=np.uint64))
    fill_lost(table, pairs)
    return table


@entry
def mark_steps(table: NodeTable, pairs: PairTable) -> None:
    """Set the bits of steps that keep a branch, and of those that lose some."""
    for support in range(len(table.start) - 1):
        first, last = int(table.start[support]), int(table.start[support + 1])
        for i in range(first, last):
            for j in range(first, last):
                shared, kept = _shared_and_kept(table.members[i], table.members[j], pairs)
                if i != j and kept:
                    bit = int(table.offset[support]) + (i - first) * (last - first) + j - first
                    set_bit(table.bits, bit)
                    if kept != shared:
                        set_bit(table.loses_branches, bit)


@entry
def fill_lost(table: NodeTable, pairs: PairTable) -> None:
    """Write the branches that steps lose."""
    for support in range(len(table.start) - 1):
        first, last = int(table.start[support]), int(table.start[support + 1])
        for i in range(first, last):
            for j in range(first, last):
                bit = int(table.offset[support]) + (i - first) * (last - first) + j - first
                if has_bit(table.loses_branches, bit):
                    shared, kept = _shared_and_kept(table.members[i], table.members[j], pairs)
                    place = table.ranks[bit // WORD] + set_before(table.loses_branches, bit)
                    table.lost[place] = np.uint64(shared & ~kept)


@kernel
def _shared_and_kept(a: int, b: int, pairs: PairTable) -> tuple[int, int]:
    """Return the branches that two members share for the support limb, and those kept."""
    before, after, held = a // 2, b // 2, 1 - a % 2
    shared = kept_on_edge(pairs.mask[before, held], pairs.mask[after, held])
    kept = shared
    if pairs.check and before != after:
        edge = pairs.edges[edge_index(held, before, after, pairs)]
        if edge.known:
            kept = kept_on_edge(shared, branches_kept(edge))
    return shared, kept
