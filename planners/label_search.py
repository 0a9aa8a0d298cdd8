"""Label-setting A* over the nodes of a table, for any number of limbs (compiled).

A state is a node and a label: the branches that each limb may still be on. An edge takes from the
label of each limb that holds the branches that it cannot keep; a label is dropped where others of
the same node that cost no more have all its branches, which dominates it. Edges that were checked
keep what was found; the others are taken to keep what the table says they keep at most, so that the
least cost found without the former is a lower bound of the cost of all plans.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_masks import (
    MOST_LIMBS,
    NO_LIMB,
    all_keep_one,
    beside,
    every_branch,
    has_bit,
    held_beside,
    mask_of,
)
from mlivr_gym.compiled.records import Record
from mlivr_gym.planners.backward_search import degree, least_cost
from mlivr_gym.planners.bucket_queue import (
    NOTHING,
    NodeQueue,
    least_waiting,
    nothing_at_hand,
    put,
    put_back,
    take,
    width_for,
)
from mlivr_gym.planners.checked_edges import CheckedEdges, place_of
from mlivr_gym.planners.costs import Weights
from mlivr_gym.stances.node_pairs import branches_lost, row_of
from mlivr_gym.stances.node_table import NodeTable

CAPACITY = 1 << 22
"""Most labels of a search."""

PAUSE = 1 << 14
"""Labels that are taken before a search looks at the clock."""

NO_LABEL, FULL, PAUSED, LIMIT, PENDING = -1, -2, -3, -4, -5
"""How a search ends: with no label waiting, its arrays full, to look at the clock, at its limit of
expansions, or for the edges to some labels to be checked."""

BATCH = 64
"""Most edges that are checked at once."""

Check = Callable[[IntArray, NDArray[np.uint64]], NDArray[np.uint64]]
"""Checks edges, by their bits and the branches before them; returns those after, 0 for none."""

SearchGraph = tuple[NodeTable, CheckedEdges, Weights]
"""The nodes, the steps known of them, and what is minimised."""


class SearchParameters(NamedTuple):
    """How a search looks for a walk."""

    cost_weight: float = 1.0
    """Weight of the cost so far in the order of the queue, that of the bound being 1: 1 for A*,
    `1 / w` for a walk that costs at most w times the least, 0 for greedy search."""
    labels_per_node: int = CAPACITY
    """Most labels of a node."""
    max_labels: int = CAPACITY
    """Labels after which it gives up."""
    max_expansions: int = CAPACITY
    """Most labels that are expanded."""
    lazy: bool = False
    """Whether the edge to a label is checked when the label is taken from the queue; otherwise the
    edges of the walk that is found remain to be checked."""
    equal_only: bool = False
    """Whether labels are dominated by equal ones alone, both checked: every state is come to."""


class SearchStatus(Record):
    """Where a search is."""

    cost_weight: float
    labels_per_node: int
    max_labels: int
    max_expansions: int
    lazy: bool
    equal_only: bool
    incumbent_cost: float
    """Cost that a walk must not reach; once one was found its own: the incumbent."""
    pause: int
    """Labels that are taken before the search looks at the clock."""
    seeded: bool
    """Whether the origins are in the queue."""
    incumbent: int
    """Label of the cheapest walk found, `NO_LABEL` without one."""
    expanded: int
    """Labels expanded."""
    pending: int
    """Labels whose edges are to be checked."""


class Labels(NamedTuple):
    """Labels of a search, each an entry of its queue: which nodes are reached on which branches."""

    waiting: NodeQueue
    """The queue, with the node of each label."""
    cost: NDArray[np.float64]
    """Cost of each, shape (room,)."""
    link: NDArray[np.int32]
    """Label before on the walk, or -1 less the origin, shape (room,)."""
    bits: NDArray[np.int64]
    """Bit of the step from there, see `node_pairs`, shape (room,)."""
    masks: NDArray[np.uint64]
    """Branches that the limbs may be on, see `limb_masks`, shape (room,)."""
    previous: NDArray[np.int32]
    """Label before at the same node, shape (room,)."""
    last: NDArray[np.int32]
    """Last label of each node, shape (n,)."""
    expanded: NDArray[np.int32]
    """Labels in the order in which they were expanded, shape (room,)."""
    checked: NDArray[np.bool_]
    """Labels the edge to which was checked, shape (room,)."""
    pending: IntArray
    """Labels the edges to which are to be checked, shape (BATCH,)."""

    @classmethod
    def of(cls, nodes: int) -> Labels:
        """Room for the labels of some number of nodes."""
        link, previous = (np.empty(CAPACITY, dtype=np.int32) for _ in range(2))
        bits, masks = np.empty(CAPACITY, dtype=np.int64), np.empty(CAPACITY, dtype=np.uint64)
        last, expanded = np.empty(nodes, dtype=np.int32), np.empty(CAPACITY, dtype=np.int32)
        checked, pending = np.empty(CAPACITY, dtype=np.bool_), np.empty(BATCH, dtype=np.int64)
        walks = np.empty(CAPACITY), link, bits, masks, previous, last
        return cls(NodeQueue.of(CAPACITY), *walks, expanded, checked, pending)

    @property
    def used(self) -> int:
        """Labels made by the last search."""
        filled: Any = self.waiting.filled
        return int(filled["used"])

    def walk_to(self, label: int) -> NodeWalk:
        """The walk that leads to a label."""
        chain = [label]
        while self.link[chain[-1]] >= 0:
            chain.append(int(self.link[chain[-1]]))
        chain.reverse()
        origin, cost = -1 - int(self.link[chain[0]]), float(self.cost[label])
        nodes = self.waiting.node[chain].astype(np.int64)
        return NodeWalk(cost, origin, nodes, self.bits[chain[1:]], self.masks[chain])


class NodeWalk(NamedTuple):
    """A walk over nodes."""

    cost: float
    """What it costs."""
    origin: int
    """Which origin it begins at."""
    nodes: IntArray
    """Rows of the nodes, shape (k + 1,)."""
    bits: IntArray
    """Bits of the steps between them, shape (k,)."""
    masks: NDArray[np.uint64]
    """Branches that the limbs may be on at the nodes, shape (k + 1,)."""


class NodeOrigins(NamedTuple):
    """Where walks begin, k nodes."""

    nodes: IntArray
    """Rows, shape (k,)."""
    masks: NDArray[np.uint64]
    """Branches that the limbs may be on, shape (k,)."""
    cost: Array
    """What it cost to get there, shape (k,)."""


class SearchOutcome(NamedTuple):
    """What a search found."""

    walk: NodeWalk | None
    """The walk, None if none was found."""
    low: float
    """No walk costs less; `below` if none costs less than that. Only with weight 1 of the cost."""
    end: int
    """Why it ended: `NO_LABEL`, `FULL`, `LIMIT`, or `PAUSED` if its time was over."""
    expanded: int
    """Labels expanded."""


def cheapest_walk(
    steps: SearchGraph,
    h: Array,
    origins: NodeOrigins,
    labels: Labels,
    parameters: SearchParameters,
    *,
    below: float = np.inf,
    until: float = np.inf,
    check: Check | None = None,
) -> SearchOutcome:
    """A walk to a node of which `h` is 0.

    With weight 1 of the cost and any number of labels it costs the least.

    Parameters
    ----------
    steps
        The nodes, the steps known of them, and what is minimised.
    h
        Consistent lower bounds of the cost from each node, shape (n,).
    origins
        Where it may begin.
    labels
        Room.
    parameters
        How it is searched.
    below
        Cost that it must not reach.
    until
        When to give up, on the clock of `time.perf_counter`.
    check
        What checks edges, where they are checked one by one.
    """
    status = SearchStatus.row()
    for name, value in parameters._asdict().items():
        status[name] = value
    status["incumbent_cost"], status["pause"], status["incumbent"] = below, PAUSE, NO_LABEL
    estimates = status["cost_weight"] * origins.cost + h[origins.nodes]
    labels.waiting.empty(float(estimates.min(initial=np.inf)), width_for(steps[2]))
    labels.last[:] = NO_LABEL
    end = PAUSED
    while end in (PAUSED, PENDING) and time.perf_counter() < until:
        end = int(_search(steps, h, status, origins, labels))
        if end == PENDING:
            assert check is not None
            pending = labels.pending[: int(status["pending"])]
            after = check(labels.bits[pending], labels.masks[labels.link[pending]])
            put_back_checked(labels, pending, after)
            status["pending"] = 0
    if not status["seeded"]:
        return SearchOutcome(None, 0.0, end, 0)
    low, found = float(status["incumbent_cost"]), int(status["incumbent"])
    if end != NO_LABEL:
        low = min(low, labels.waiting.least)
    walk = None if found == NO_LABEL else labels.walk_to(found)
    return SearchOutcome(walk, low, end, int(status["expanded"]))


@entry
def _search(
    steps: SearchGraph, h: Array, status: SearchStatus, origins: NodeOrigins, labels: Labels
) -> int:
    """Go on until the cheapest label of a node of which `h` is 0 is found, see `cheapest_walk`.

    Returns
    -------
    int
        `NO_LABEL` at the end, or why it stopped: `FULL`, `PAUSED` or `LIMIT`.
    """
    table, _, _ = steps
    waiting, count = labels.waiting, 0
    if not status.seeded:
        status.seeded = True
        for k in range(len(origins.nodes)):
            s, cost = origins.nodes[k], origins.cost[k]
            if h[s] < np.inf:
                if waiting.filled.used >= len(waiting.node):
                    return FULL
                _add_label(labels, s, origins.masks[k], cost, -1 - k, -1)
                labels.checked[waiting.filled.used] = True
                put(waiting, status.cost_weight * cost + h[s], s)
    while True:
        if count == status.pause:
            return PAUSED
        count += 1
        if status.pending and nothing_at_hand(waiting):
            return PENDING
        here = take(waiting)
        if here == NOTHING:
            return NO_LABEL
        s, cost = int(waiting.node[here]), labels.cost[here]
        proved = least_waiting(waiting) >= status.cost_weight * status.incumbent_cost
        if status.incumbent != NO_LABEL and proved:
            return NO_LABEL
        if not cost + h[s] < status.incumbent_cost:
            continue
        if status.lazy and not labels.checked[here]:
            masks = labels.masks[here]
            if status.equal_only or not _is_dominated(labels, s, masks, cost, here, status):
                labels.pending[status.pending] = here
                status.pending += 1
                if status.pending == BATCH:
                    return PENDING
            continue
        if h[s] == 0.0:
            status.incumbent, status.incumbent_cost = here, cost
            continue
        if waiting.filled.used + degree(table, s) > min(len(waiting.node), status.max_labels):
            put_back(waiting, here)
            return FULL
        if not _is_dominated(labels, s, labels.masks[here], cost, here, status):
            if status.expanded >= status.max_expansions:
                put_back(waiting, here)
                return LIMIT
            labels.expanded[status.expanded] = here
            status.expanded += 1
            _expand(steps, h, status, here, labels)


@kernel
def _expand(steps: SearchGraph, h: Array, status: SearchStatus, here: int, labels: Labels) -> None:
    """Note what steps lead to from a label."""
    table, known, weights = steps
    limbs = table.points.shape[1]
    s, masks = int(labels.waiting.node[here]), labels.masks[here]
    for limb in range(limbs):
        row = row_of(table, s, limb)
        if row < 0 or mask_of(masks & table.released[s], limb) == NO_LIMB:
            continue
        support, held = table.supports[s, limb], held_beside(masks, limb, limbs)
        begin, end = int(table.start[support]), int(table.start[support + 1])
        for k in range(end - begin):
            if not has_bit(table.bits, row + k):
                continue
            other, moved = divmod(int(table.members[begin + k]), limbs)
            if h[other] == np.inf:
                continue
            kept = (
                held
                & held_beside(table.masks[other], moved, limbs)
                & ~branches_lost(table, row + k)
            )
            if known.at[s]:
                place = place_of(known, row + k)
                if known.keys[place] == row + k:
                    kept &= known.kept[place]
            if not all_keep_one(kept, limbs):
                continue
            cost = labels.cost[here] + least_cost(table, s, other, weights)
            if not cost + h[other] < status.incumbent_cost:
                continue
            after = beside(kept, mask_of(table.released[other], moved), moved, limbs)
            if status.equal_only or not _is_dominated(labels, other, after, cost, -1, status):
                _add_label(labels, other, after, cost, here, row + k)
                put(labels.waiting, status.cost_weight * cost + h[other], other)


@kernel
def _add_label(labels: Labels, s: int, masks: np.uint64, cost: float, link: int, bit: int) -> None:
    """Note a label as the last of its node; it is put into the queue next."""
    item = labels.waiting.filled.used
    labels.masks[item], labels.cost[item] = masks, cost
    labels.link[item], labels.bits[item] = link, bit
    labels.previous[item], labels.last[s] = labels.last[s], item
    labels.checked[item] = False


@kernel
def _is_dominated(
    labels: Labels, s: int, masks: np.uint64, g: float, item: int, status: SearchStatus
) -> bool:
    """Whether other labels of a node dominate a label: cost no more, and have all its branches.

    One does that alone, or several together whose branches of one limb make up that limb's, while
    each has all of the other limbs. Also whether the node has its most labels, if `item`, the
    number of the label, is -1 for a new one. Of two equal ones the earlier covers the other. Where
    edges are checked one by one a label counts once that to it was.
    """
    other, count, uncovered = labels.last[s], 0, masks
    while other >= 0:
        if not status.lazy or labels.checked[other]:
            cost = labels.cost[other]
            earlier = item < 0 or cost < g or other < item
            if other != item and cost <= g:
                missing = masks & ~labels.masks[other]
                if status.equal_only:
                    missing |= labels.masks[other] & ~masks
                if missing == NO_LIMB and (earlier or masks != labels.masks[other]):
                    return True
                if earlier and not status.equal_only:
                    for limb in range(MOST_LIMBS):
                        alone = every_branch(limb)
                        if missing & ~alone == NO_LIMB:
                            uncovered &= missing | ~alone
                            if uncovered & alone == NO_LIMB:
                                return True
            count += 1
        other = labels.previous[other]
    return item < 0 and count >= status.labels_per_node


@entry
def put_back_checked(labels: Labels, pending: IntArray, after: NDArray[np.uint64]) -> None:
    """Put labels back whose edges were checked, with the branches after them, if any are left."""
    for k in range(len(pending)):
        item = pending[k]
        labels.masks[item], labels.checked[item] = after[k], True
        if after[k] != NO_LIMB:
            put_back(labels.waiting, item)
