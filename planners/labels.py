"""Labels of the label-setting search: the nodes that walks reach, and on which branches.

A label holds its cost, the branches that each limb may be on, and its parent, so that the walk to
it can be traced back. Labels are stored in arrays that are allocated once and reused by every
search.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.planners.bucket_queue import NodeQueue

CAPACITY = 1 << 22
"""Maximum number of labels of a search."""

CHECK_BATCH = 64
"""Maximum number of edges that are checked in one batch."""

NO_LABEL = -1
"""Index that stands for no label."""


class Labels(NamedTuple):
    """Labels of a search, each an entry of its open queue."""

    queue: NodeQueue
    """The open queue, with the node of each label."""
    cost: NDArray[np.float64]
    """Cost of each label, shape (CAPACITY,)."""
    parent: NDArray[np.int32]
    """Parent label on the walk, or -1 minus the index of the origin, shape (CAPACITY,)."""
    edges: NDArray[np.int64]
    """Edge from the parent by its bit in the table, see `node_pairs`, shape (CAPACITY,)."""
    masks: NDArray[np.uint64]
    """Branches that the limbs may be on, see `limb_masks`, shape (CAPACITY,)."""
    previous_of_node: NDArray[np.int32]
    """The label before at the same node, shape (CAPACITY,)."""
    last_of_node: NDArray[np.int32]
    """The last label of each node, shape (n,)."""
    expanded: NDArray[np.int32]
    """Labels in the order of their expansion, shape (CAPACITY,)."""
    checked: NDArray[np.bool_]
    """Whether the edge to each label was checked, shape (CAPACITY,)."""
    pending: IntArray
    """Labels whose edges are to be checked, shape (CHECK_BATCH,)."""

    @classmethod
    def allocate(cls, nodes: int) -> Labels:
        """Allocate arrays for the labels of some number of nodes."""
        parent, previous_of_node = (np.empty(CAPACITY, dtype=np.int32) for _ in range(2))
        edges, masks = np.empty(CAPACITY, dtype=np.int64), np.empty(CAPACITY, dtype=np.uint64)
        last_of_node, expanded = np.empty(nodes, dtype=np.int32), np.empty(CAPACITY, dtype=np.int32)
        checked, pending = np.empty(CAPACITY, dtype=np.bool_), np.empty(CHECK_BATCH, dtype=np.int64)
        walks = np.empty(CAPACITY), parent, edges, masks, previous_of_node, last_of_node
        return cls(NodeQueue.allocate(CAPACITY), *walks, expanded, checked, pending)

    @property
    def label_count(self) -> int:
        """Number of labels that the last search made."""
        status: Any = self.queue.status
        return int(status["entry_count"])

    def walk_to(self, label: int) -> NodeWalk:
        """Return the walk that leads to a label."""
        chain = [label]
        while self.parent[chain[-1]] >= 0:
            chain.append(int(self.parent[chain[-1]]))
        chain.reverse()
        origin, cost = -1 - int(self.parent[chain[0]]), float(self.cost[label])
        nodes = self.queue.node[chain].astype(np.int64)
        return NodeWalk(cost, origin, nodes, self.edges[chain[1:]], self.masks[chain])


class NodeWalk(NamedTuple):
    """A walk over k + 1 nodes of the table."""

    cost: float
    """Cost of the walk."""
    origin: int
    """Index of the origin at which it starts."""
    nodes: IntArray
    """Rows of the nodes, shape (k + 1,)."""
    edges: IntArray
    """Edges between them by their bits in the table, shape (k,)."""
    masks: NDArray[np.uint64]
    """Branches that the limbs may be on at the nodes, shape (k + 1,)."""


class NodeOrigins(NamedTuple):
    """The k nodes at which walks may start."""

    nodes: IntArray
    """Rows of the nodes, shape (k,)."""
    masks: NDArray[np.uint64]
    """Branches that the limbs may be on there, shape (k,)."""
    cost: Array
    """Cost of reaching each of them, shape (k,)."""
