"""The stances and steps of two limbs as a node table, which searches read (compiled)."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.compiled.limb_branch_sets import packed, set_bit
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.stances.two_limb_steps import TwoLimbTable, branches_kept
from mlivr_gym.transitions.rule import kept_on_edge


def two_limb_nodes(pairs: TwoLimbTable, pose_number: IntArray) -> NodeTable:
    """Return a node table with the edges checked so far.

    Its support sets are the rows of the stances, whether or not the limb can be released, so that
    the number of an edge is its index in `pairs.edges`. An unchecked edge is assumed to keep all
    branches that both of its stances have.
    """
    releasable, folds = pairs.branch_sets, np.zeros_like(pairs.branch_sets)
    if pairs.check:
        known = pairs.releases["known"]
        releasable = np.where(known, pairs.releases["branches"], pairs.branch_sets).astype(np.int64)
        folds = pairs.releases["folds"].astype(np.int64)
    (n, m), points = (len(pairs.points), pairs.degree.shape[1]), pairs.points
    edges = int((pairs.degree**2).sum())
    joined, loses_branches = np.zeros((2, edges // 64 + 1), dtype=np.uint64)
    table = NodeTable(
        points=points.astype(np.uint16),
        base_position=pairs.base,
        branch_sets=packed(pairs.branch_sets),
        releasable=packed(releasable),
        folds=packed(folds),
        pose_number=pose_number.astype(np.uint16),
        support_sets=np.stack([m + points[:, 1], points[:, 0]], axis=1).astype(np.int32),
        start=np.append(pairs.row_start[0, :-1], n + pairs.row_start[1]).astype(np.int32),
        members=(2 * pairs.rows + [[1], [0]]).ravel().astype(np.int32),
        offset=np.append(pairs.offset.ravel(), edges),
        joined=joined,
        loses_branches=loses_branches,
        ranks=np.zeros(0, dtype=np.int32),
        lost=np.empty(edges, dtype=np.uint64),
    )
    node, limb = np.divmod(table.members, 2)
    count = write_edges(
        table, pairs, pairs.branch_sets[node, 1 - limb], releasable[node, limb] != 0
    )
    counts = np.bitwise_count(loses_branches)
    ranks = np.cumsum(counts, dtype=np.int32) - counts
    return table._replace(ranks=ranks, lost=table.lost[:count])


@entry
def write_edges(
    table: NodeTable, pairs: TwoLimbTable, held: IntArray, can_release: BoolArray
) -> int:
    """Set the bits of the edges, and of those that lose branches, which are written into `lost`.

    Of each member of the support sets are given the branches on which its support limb may hold,
    and whether its other limb can be released. Returns the number of edges that lose branches.
    """
    count = 0
    for support_set in range(len(table.start) - 1):
        first, last = int(table.start[support_set]), int(table.start[support_set + 1])
        for i in range(first, last):
            if not can_release[i]:
                continue
            row = table.offset[support_set] + (i - first) * (last - first) - first
            for j in range(first, last):
                edge = row + j
                kept = shared = kept_on_edge(held[i], held[j])
                if pairs.check and pairs.edges[edge].known:
                    kept = kept_on_edge(shared, branches_kept(pairs.edges[edge]))
                if kept and can_release[j] and i != j:
                    set_bit(table.joined, edge)
                    if kept != shared:
                        set_bit(table.loses_branches, edge)
                        table.lost[count] = np.uint64(shared & ~kept)
                        count += 1
    return count
