"""Label-setting A* over the nodes of a table, for any number of limbs (compiled).

A* (Hart, Nilsson and Raphael 1968) orders states by `f = g + h`. A state here is a node with a
label, a branch set for each limb, as in shortest paths with resource constraints (Desrochers and
Soumis 1988): an edge removes from the set of each support limb the branches that it cannot keep,
and a label is dropped if labels of the same node that cost no more have all its branches
(dominance). An edge that was not checked is assumed to keep its upper bound from the table, so the
cheapest path over unchecked edges bounds the cost of every plan from below.

With weight 1 of the cost and a consistent `h` the search sets labels: no label that is popped later
dominates it at less cost. With another weight, and where labels wait for a check, it corrects
labels: a node may be expanded again when a cheaper label reaches it. The result does not depend on
that order, since the search ends by the lower bound of the queue alone.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_branch_sets import (
    NO_BRANCHES,
    PACKED_LIMBS,
    after_move,
    branch_set_of,
    each_keeps_one,
    every_branch,
    has_bit,
    supports_of,
)
from mlivr_gym.compiled.records import Record
from mlivr_gym.planners.backward_search import degree, edge_cost
from mlivr_gym.planners.clock import UNLIMITED, Clock, OutOfTime
from mlivr_gym.planners.costs import CostWeights
from mlivr_gym.planners.labels import (
    CAPACITY,
    CHECK_BATCH,
    NO_LABEL,
    NODE_BATCH,
    Labels,
    NodeOrigins,
    NodePath,
    add_label,
    requeue_checked,
)
from mlivr_gym.planners.open_queue import (
    CLOCK_INTERVAL,
    NO_ENTRY,
    least_estimate,
    pop,
    push,
    requeue,
)
from mlivr_gym.stances.checked_edges import CheckedEdges, slot_of
from mlivr_gym.stances.node_edges import branches_lost, row_of
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.stances.present_table import NO_NODES

CHECK_SPAN = 0.01
"""How much larger the estimates of labels that are checked in one batch may be than the least one,
as a base displacement, where displacements are charged [m]. With the step cost many labels have
equal estimates, so batches fill without a span."""

EXPANSION = cast(int, np.int64(8))
"""Labels popped that count as much for the clock as the expansion of one."""

SEARCH_COMPLETE, ARRAYS_FULL, PAUSED, EXPANSION_LIMIT, CHECKS_PENDING = -1, -2, -3, -4, -5
"""Why a call of `_search` ends: no better path is left, because the open queue is exhausted or its
minimum proves the incumbent; the arrays are full; the clock is to be read; the limit of expansions
is reached; or edges or nodes are to be checked."""

Check = Callable[[IntArray, NDArray[np.uint64]], NDArray[np.uint64]]
"""Function that checks edges: from their numbers and the branch sets before them to the branch sets
after them, 0 for an edge that is no step."""

NodeCheck = Callable[[IntArray], None]
"""Function that checks nodes, given by their rows: it removes branches of the table."""


class SearchGraph(NamedTuple):
    """The graph of a search: nodes, edges checked so far, and the cost to minimise."""

    table: NodeTable
    """The nodes, with an upper bound of the branches kept on each edge."""
    checked_edges: CheckedEdges
    """Edges that were checked, with the branches that they keep."""
    weights: CostWeights
    """Weights of the cost."""
    unchecked: BoolArray = NO_NODES
    """Nodes to be checked when a label of them is popped, shape (n,), or (0,) if there are none."""
    unsure: BoolArray = NO_NODES
    """Nodes with edges that may not be known, see `PresentTable.unsure`, shape (n,), or (0,)."""


class SearchParameters(NamedTuple):
    """Parameters of a search."""

    cost_weight: float = 1.0
    """Weight of the cost so far in `f = cost_weight * g + h`: 1 for A*, `1 / w` for weighted A*
    (Pohl 1970), whose path costs at most w times the minimum, and 0 for greedy best-first
    search."""
    labels_per_node: int = CAPACITY
    """Maximum number of labels of a node."""
    max_labels: int = CAPACITY
    """Maximum number of labels, after which the search ends."""
    max_expansions: int = CAPACITY
    """Maximum number of labels expanded."""
    check_when_popped: bool = False
    """Whether the edge to a label is looked at when the label is popped from the queue, as in Lazy
    Weighted A* (Cohen, Phillips and Likhachev 2014); otherwise the caller checks the edges of the
    path that is returned, as in LazySP (Dellin and Srinivasa 2016)."""


class SearchStatus(Record):
    """Parameters and progress of a search, which a call of `_search` continues."""

    cost_weight: float
    labels_per_node: int
    max_labels: int
    max_expansions: int
    check_when_popped: bool
    incumbent_cost: float
    """Cost of the incumbent; before there is one, the cost that a path must stay below."""
    clock_interval: int
    """Number of labels popped before the clock is read, where expansions count `EXPANSION` more."""
    initialised: bool
    """Whether the origins are in the queue."""
    incumbent: int
    """Label at the goal of the cheapest path so far, or `NO_LABEL`."""
    expanded: int
    """Number of labels expanded."""
    pending: int
    """Number of labels whose edges or nodes are to be checked."""
    pending_estimate: float
    """Least estimate of these labels, infinite if there are none."""
    has_dropped: bool
    """Whether a label was dropped because its node had as many as it may have."""


class SearchOutcome(NamedTuple):
    """Result of a search."""

    path: NodePath | None
    """The cheapest path, or None."""
    lower_bound: float
    """Lower bound of the cost of every path, at most `cost_limit`; with another weight than 1 it is
    one only if the queue was exhausted without a path."""
    end: int
    """Why the search ended: `SEARCH_COMPLETE`, `ARRAYS_FULL`, `EXPANSION_LIMIT`, or `PAUSED` or
    `CHECKS_PENDING` at its deadline."""
    expanded: int
    """Number of labels expanded."""
    has_dropped: bool = False
    """Whether labels were dropped, `SearchParameters.labels_per_node`, that may lead elsewhere."""


def cheapest_path(
    search_graph: SearchGraph,
    h: Array,
    origins: NodeOrigins,
    labels: Labels,
    parameters: SearchParameters,
    *,
    cost_limit: float = np.inf,
    clock: Clock = UNLIMITED,
    check: Check | None = None,
    check_nodes: NodeCheck | None = None,
) -> SearchOutcome:
    """Find the cheapest path from an origin to a node at which `h` is 0.

    With weight 1 of the cost and no limit of labels its cost is the minimum over the edges of the
    graph; `docs/mathematics.md` has the proof.

    Parameters
    ----------
    search_graph
        The nodes, the edges checked so far, and the cost to minimise.
    h
        Lower bounds of the cost from each node to the goal, 0 there alone, shape (n,).
    origins
        Where the path may start.
    labels
        Arrays for the labels, reused.
    parameters
        Parameters of the search.
    cost_limit
        Cost that the path must stay below.
    clock
        When to end.
    check
        Function that checks edges; needed if `parameters.check_when_popped`.
    check_nodes
        Function that checks nodes; needed if edges are not checked and some nodes are unchecked.
    """
    status = SearchStatus.row()
    for name, value in parameters._asdict().items():
        status[name] = value
    status["incumbent_cost"], status["incumbent"] = cost_limit, NO_LABEL
    status["pending_estimate"] = np.inf
    labels.reset_nodes()
    labels.queue.reset()
    end = PAUSED
    with suppress(OutOfTime):
        while end in (PAUSED, CHECKS_PENDING):
            with clock.piece("labels", CLOCK_INTERVAL) as interval:
                status["clock_interval"] = interval
                end = int(_search(search_graph, h, status, origins, labels))
            if end == CHECKS_PENDING:
                _check_pending(status, h, labels, check, check_nodes)
    if not status["initialised"]:
        return SearchOutcome(None, 0.0, end, 0)
    lower_bound, found = float(status["incumbent_cost"]), int(status["incumbent"])
    if end != SEARCH_COMPLETE:
        lower_bound = min(lower_bound, labels.queue.lower_bound, float(status["pending_estimate"]))
    path = None if found == NO_LABEL else labels.path_to(found)
    dropped = bool(status["has_dropped"])
    return SearchOutcome(path, lower_bound, end, int(status["expanded"]), dropped)


def _check_pending(
    status: Any, h: Array, labels: Labels, check: Check | None, check_nodes: NodeCheck | None
) -> None:
    """Check the edges or nodes of pending labels, and push those that keep branches again."""
    pending = labels.pending[: int(status["pending"])]
    if status["check_when_popped"]:
        assert check is not None
        after = check(labels.edges[pending], labels.branch_sets[labels.parent[pending]])
    else:
        assert check_nodes is not None
        check_nodes(labels.queue.node[pending].astype(np.int64))
        after = labels.branch_sets[pending]
    estimates = status["cost_weight"] * labels.cost[pending] + h[labels.queue.node[pending]]
    requeue_checked(labels, pending, estimates, after)
    status["pending"], status["pending_estimate"] = 0, np.inf


@entry
def _search(
    search_graph: SearchGraph, h: Array, status: SearchStatus, origins: NodeOrigins, labels: Labels
) -> int:
    """Continue a search until it is complete or must stop; return `SEARCH_COMPLETE`, or why."""
    table = search_graph.table
    queue, count = labels.queue, 0
    if not status.initialised:
        status.initialised = True
        for k in range(len(origins.nodes)):
            s, cost = origins.nodes[k], origins.cost[k]
            if h[s] < np.inf:
                if queue.status.entry_count >= len(queue.node):
                    return ARRAYS_FULL
                add_label(labels, s, origins.branch_sets[k], cost, -1 - k, -1, True)
                push(queue, status.cost_weight * cost + h[s], s)
    while True:
        if count >= status.clock_interval:
            return PAUSED
        count += 1
        span = CHECK_SPAN * search_graph.weights.base
        if status.pending and least_estimate(queue) > status.pending_estimate + span:
            return CHECKS_PENDING
        label = pop(queue)
        if label == NO_ENTRY:
            return SEARCH_COMPLETE
        s, cost = int(queue.node[label]), labels.cost[label]
        f = status.cost_weight * cost + h[s]
        proved = min(f, status.pending_estimate) >= status.cost_weight * status.incumbent_cost
        if status.incumbent != NO_LABEL and proved:
            return SEARCH_COMPLETE
        if not cost + h[s] < status.incumbent_cost:
            continue
        branch_sets = labels.branch_sets[label]
        if _awaits_check(search_graph, status, labels, label):
            if not _is_dominated(labels, s, branch_sets, cost, label, status):
                labels.pending[status.pending] = label
                status.pending += 1
                status.pending_estimate = min(status.pending_estimate, f)
                if status.pending == (CHECK_BATCH if status.check_when_popped else NODE_BATCH):
                    return CHECKS_PENDING
            continue
        if len(search_graph.unchecked):
            branch_sets &= table.branch_sets[s]
            labels.branch_sets[label] = branch_sets
            if not each_keeps_one(branch_sets, table.points.shape[1]):
                continue
        if h[s] == 0.0:
            status.incumbent, status.incumbent_cost = label, cost
            continue
        if queue.status.entry_count + degree(table, s) > min(len(queue.node), status.max_labels):
            requeue(queue, f, label)
            return ARRAYS_FULL
        if not _is_dominated(labels, s, branch_sets, cost, label, status):
            if status.expanded >= status.max_expansions:
                requeue(queue, f, label)
                return EXPANSION_LIMIT
            labels.expanded[status.expanded] = label
            status.expanded += 1
            count += EXPANSION
            _expand(search_graph, h, status, label, labels)


@kernel
def _awaits_check(
    search_graph: SearchGraph, status: SearchStatus, labels: Labels, label: int
) -> bool:
    """Return whether the edge to a label, or its node, is to be checked before it is expanded."""
    if status.check_when_popped:
        return not labels.checked[label]
    unchecked = search_graph.unchecked
    return len(unchecked) > 0 and bool(unchecked[labels.queue.node[label]])


@kernel
def _expand(
    search_graph: SearchGraph, h: Array, status: SearchStatus, label: int, labels: Labels
) -> None:
    """Generate the successors of a label."""
    table, checked_edges, weights, _, unsure = search_graph
    limbs = table.points.shape[1]
    s, branch_sets = int(labels.queue.node[label]), labels.branch_sets[label]
    for limb in range(limbs):
        row = row_of(table, s, limb)
        if row < 0 or branch_set_of(branch_sets & table.releasable[s], limb) == NO_BRANCHES:
            continue
        support_set, of_supports = (
            table.support_sets[s, limb],
            supports_of(branch_sets, limb, limbs),
        )
        begin, end = int(table.start[support_set]), int(table.start[support_set + 1])
        for k in range(end - begin):
            if not has_bit(table.joined, row + k):
                continue
            other, moved = divmod(int(table.members[begin + k]), limbs)
            if h[other] == np.inf:
                continue
            kept = (
                of_supports
                & supports_of(table.branch_sets[other], moved, limbs)
                & ~branches_lost(table, row + k)
            )
            checked = len(unsure) == 0 or not (unsure[s] or unsure[other])
            if checked_edges.has_edges[s]:
                slot = slot_of(checked_edges, row + k)
                if checked_edges.keys[slot] == row + k:
                    kept &= checked_edges.kept[slot]
                    checked = True
            if not each_keeps_one(kept, limbs):
                continue
            cost = labels.cost[label] + edge_cost(table, s, other, moved, weights)
            if not cost + h[other] < status.incumbent_cost:
                continue
            after = after_move(kept, branch_set_of(table.releasable[other], moved), moved, limbs)
            if not _is_dominated(labels, other, after, cost, -1, status):
                add_label(labels, other, after, cost, label, row + k, checked)
                push(labels.queue, status.cost_weight * cost + h[other], other)


@kernel
def _is_dominated(
    labels: Labels, s: int, branch_sets: np.uint64, g: float, label: int, status: SearchStatus
) -> bool:
    """Return whether labels of a node that cost no more have all branches of a label.

    One label may dominate alone, or several jointly whose branches of one limb cover those of that
    limb while each has all branches of the other limbs. Of two equal labels the earlier dominates.
    Where edges are checked when popped, only labels whose edge was checked dominate. A new label,
    whose index `label` is -1, also counts as dominated if its node has the maximum number of
    labels.
    """
    other, count, uncovered = labels.last_of_node[s], 0, branch_sets
    while other >= 0:
        if not status.check_when_popped or labels.checked[other]:
            cost = labels.cost[other]
            earlier = label < 0 or cost < g or other < label
            if other != label and cost <= g:
                missing = branch_sets & ~labels.branch_sets[other]
                if missing == NO_BRANCHES and (earlier or branch_sets != labels.branch_sets[other]):
                    return True
                if earlier:
                    for limb in range(PACKED_LIMBS):
                        alone = every_branch(limb)
                        if missing & ~alone == NO_BRANCHES:
                            uncovered &= missing | ~alone
                            if uncovered & alone == NO_BRANCHES:
                                return True
            count += 1
        other = labels.previous_of_node[other]
    if label < 0 and count >= status.labels_per_node:
        status.has_dropped = True
        return True
    return False
