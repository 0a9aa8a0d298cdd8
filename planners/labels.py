"""Labels of the label-setting search: the nodes that paths reach, and on which branches.

A label is a branch set for each limb: the branches that the limbs may be on after a path. It is
stored with the node that the path leads to, its cost, and the parent label, so that the path can be
traced back. The arrays are allocated once and reused by every search.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_branch_sets import NO_BRANCHES
from mlivr_gym.planners.open_queue import NodeQueue, requeue

CAPACITY = 1 << 22
"""Maximum number of labels of a search."""

CHECK_BATCH, NODE_BATCH = 64, 512
"""Maximum number of edges and of nodes that are checked in one batch."""

MOST_EXPLORED = 20_000
"""Maximum number of explored edges that a result tells, to be drawn."""

NO_LABEL = -1
"""Index that stands for no label."""


class Labels(NamedTuple):
    """Labels of a search, each an entry of its open queue."""

    queue: NodeQueue
    """The open queue, with the node of each label."""
    cost: NDArray[np.float64]
    """Cost of each label, shape (CAPACITY,)."""
    parent: NDArray[np.int32]
    """Parent label on the path, or -1 minus the index of the origin, shape (CAPACITY,)."""
    edges: NDArray[np.int64]
    """Number of the edge from the parent, see `node_edges`, shape (CAPACITY,)."""
    branch_sets: NDArray[np.uint64]
    """Branches that the limbs may be on, see `limb_branch_sets`, shape (CAPACITY,)."""
    previous_of_node: NDArray[np.int32]
    """The label before at the same node, shape (CAPACITY,)."""
    last_of_node: NDArray[np.int32]
    """The last label of each node, shape (n,)."""
    expanded: NDArray[np.int32]
    """Labels in the order of their expansion, shape (CAPACITY,)."""
    checked: NDArray[np.bool_]
    """Whether the edge to each label is known, or was looked at, shape (CAPACITY,)."""
    pending: IntArray
    """Labels whose edges or nodes are to be checked, shape (NODE_BATCH,)."""

    @classmethod
    def allocate(cls, nodes: int) -> Labels:
        """Allocate arrays for the labels of some number of nodes."""
        parent, previous_of_node = (np.empty(CAPACITY, dtype=np.int32) for _ in range(2))
        edges, branch_sets = np.empty(CAPACITY, dtype=np.int64), np.empty(CAPACITY, dtype=np.uint64)
        last_of_node = np.full(nodes, NO_LABEL, dtype=np.int32)
        expanded = np.empty(CAPACITY, dtype=np.int32)
        checked, pending = np.empty(CAPACITY, dtype=np.bool_), np.empty(NODE_BATCH, dtype=np.int64)
        paths = np.empty(CAPACITY), parent, edges, branch_sets, previous_of_node, last_of_node
        return cls(NodeQueue.allocate(CAPACITY), *paths, expanded, checked, pending)

    def reset_nodes(self) -> None:
        """Forget the labels of all nodes, before the queue is reset."""
        used = self.queue.node[: self.label_count]
        few = len(used) < len(self.last_of_node) // 8
        self.last_of_node[used if few else slice(None)] = NO_LABEL

    @property
    def label_count(self) -> int:
        """Number of labels that the last search made."""
        status: Any = self.queue.status
        return int(status["entry_count"])

    def path_to(self, label: int) -> NodePath:
        """Return the path that leads to a label."""
        chain = [label]
        while self.parent[chain[-1]] >= 0:
            chain.append(int(self.parent[chain[-1]]))
        chain.reverse()
        origin, cost = -1 - int(self.parent[chain[0]]), float(self.cost[label])
        nodes = self.queue.node[chain].astype(np.int64)
        return NodePath(cost, origin, nodes, self.edges[chain[1:]], self.branch_sets[chain])

    def explored_edges(self, expanded: int, base: Array, origins: Array) -> Array:
        """Return base positions at both ends of the edges to expanded labels [m], shape (e, 2, 3).

        With many labels these are the edges to the first ones.

        Nodes have base positions (n, 3), places before the origins (k, 3). Edges to origins that
        start where they end are omitted.
        """
        explored = self.expanded[: min(expanded, MOST_EXPLORED)]
        parent = self.parent[explored]
        after, is_step = base[self.queue.node[explored]], parent >= 0
        before = after.copy()
        before[is_step] = base[self.queue.node[parent[is_step]]]
        before[~is_step] = origins[-1 - parent[~is_step]]
        ends: Array = np.stack([before, after], axis=1)
        return np.asarray(ends[is_step | np.any(before != after, axis=1)])


class NodePath(NamedTuple):
    """A path over k + 1 nodes of the table."""

    cost: float
    """Cost of the path."""
    origin: int
    """Index of the origin at which it starts."""
    nodes: IntArray
    """Rows of the nodes, shape (k + 1,)."""
    edges: IntArray
    """Numbers of the edges between them, shape (k,)."""
    branch_sets: NDArray[np.uint64]
    """Branches that the limbs may be on at the nodes, shape (k + 1,)."""


class NodeOrigins(NamedTuple):
    """The k nodes at which paths may start."""

    nodes: IntArray
    """Rows of the nodes, shape (k,)."""
    branch_sets: NDArray[np.uint64]
    """Branches that the limbs may be on there, shape (k,)."""
    cost: Array
    """Cost of reaching each of them, shape (k,)."""


@entry
def requeue_checked(
    labels: Labels, pending: IntArray, estimates: Array, after: NDArray[np.uint64]
) -> None:
    """Push labels that were checked back into the queue, unless no branch is kept, shape (k,)."""
    for k in range(len(pending)):
        label = pending[k]
        labels.branch_sets[label], labels.checked[label] = after[k], True
        if after[k] != NO_BRANCHES:
            requeue(labels.queue, estimates[k], label)


@kernel
def add_label(
    labels: Labels,
    s: int,
    branch_sets: np.uint64,
    cost: float,
    parent: int,
    edge: int,
    checked: bool,
) -> None:
    """Append a label as the last of its node; the caller pushes it into the queue."""
    label = labels.queue.status.entry_count
    labels.branch_sets[label], labels.cost[label] = branch_sets, cost
    labels.parent[label], labels.edges[label] = parent, edge
    labels.previous_of_node[label], labels.last_of_node[s] = labels.last_of_node[s], label
    labels.checked[label] = checked
