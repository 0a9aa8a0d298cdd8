"""The stances and steps of two limbs as a node table, which searches read (compiled)."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_branch_sets import set_bit
from mlivr_gym.stances.node_table import Nodes, NodeTable, table_of
from mlivr_gym.stances.two_limb_steps import TwoLimbTable, branches_kept, edge_index
from mlivr_gym.transitions.rule import kept_on_edge


def two_limb_nodes(pairs: TwoLimbTable, pose_number: IntArray) -> NodeTable:
    """Return a node table with the edges checked so far.

    An unchecked edge is assumed to keep all branches that both of its stances have.
    """
    releasable, folds = pairs.branch_sets, np.zeros_like(pairs.branch_sets)
    if pairs.check:
        known = pairs.releases["known"]
        releasable = np.where(known, pairs.releases["branches"], pairs.branch_sets).astype(np.int64)
        folds = pairs.releases["folds"].astype(np.int64)
    table = table_of(
        Nodes(pairs.points, pairs.base, pairs.branch_sets, releasable, folds, pose_number),
        is_symmetric=False,
    )
    joined, loses_branches = (np.zeros_like(table.joined) for _ in range(2))
    lost = np.empty(int(table.offset[-1]), dtype=np.uint64)
    table = table._replace(joined=joined, loses_branches=loses_branches, lost=lost)
    count = write_edges(table, pairs)
    counts = np.bitwise_count(loses_branches)
    ranks = np.cumsum(counts, dtype=np.int32) - counts
    return table._replace(ranks=ranks, lost=lost[:count].copy())


@entry
def write_edges(table: NodeTable, pairs: TwoLimbTable) -> int:
    """Set the bits of the edges, and of those that lose branches, which are written into `lost`.

    Returns the number of edges that lose branches.
    """
    count = 0
    for support_set in range(len(table.start) - 1):
        first, last = int(table.start[support_set]), int(table.start[support_set + 1])
        for i in range(first, last):
            for j in range(first, last):
                shared, kept = _shared_and_kept(table.members[i], table.members[j], pairs)
                if i != j and kept:
                    bit = int(table.offset[support_set]) + (i - first) * (last - first) + j - first
                    set_bit(table.joined, bit)
                    if kept != shared:
                        set_bit(table.loses_branches, bit)
                        table.lost[count] = np.uint64(shared & ~kept)
                        count += 1
    return count


@kernel
def _shared_and_kept(a: int, b: int, pairs: TwoLimbTable) -> tuple[int, int]:
    """Return the branches that two members share for the support limb, and those kept."""
    before, after, support = a // 2, b // 2, 1 - a % 2
    shared = kept_on_edge(pairs.branch_sets[before, support], pairs.branch_sets[after, support])
    kept = shared
    if pairs.check and before != after:
        edge = pairs.edges[edge_index(support, before, after, pairs)]
        if edge.known:
            kept = kept_on_edge(shared, branches_kept(edge))
    return shared, kept
