"""Relaxed cost-to-go from the nodes of a table, by backward A* (compiled).

It is the minimum cost if limbs could change their branches. Every step joins a pair of nodes of the
table, so the minimum over these pairs is a lower bound of the cost of a plan. The search runs
backward from the goal until the starts are reached, and somewhat farther. A node that it did not
reach costs at least the final estimate of the search minus the lower bound from the start to that
node.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.limb_branch_sets import has_bit
from mlivr_gym.compiled.records import Record, Rows
from mlivr_gym.planners.clock import UNLIMITED, Clock
from mlivr_gym.planners.costs import CostWeights
from mlivr_gym.planners.open_queue import CLOCK_INTERVAL, NO_ENTRY, NodeQueue, pop, push
from mlivr_gym.stances.node_edges import row_of
from mlivr_gym.stances.node_table import NodeTable

INITIAL_CAPACITY = 1 << 21
"""Initial capacity of the queue, in addition to the goals."""

COMPLETE, QUEUE_FULL, PAUSED = 0, 1, 2
"""Why a call of `_search` ends."""

MIN_COST_OUTSIDE_GOAL = 1e-12
"""Lower bound of the cost from every node outside the goal, so that only goals have cost 0."""


class BackwardProgress(Record):
    """Progress of a backward search."""

    initialised: bool
    """Whether the goals are in the queue."""
    unreached_starts: int
    """Number of starts that the search has not reached."""
    limit: float
    """Estimate at which the search ends; infinite until all starts are reached."""
    extension_fraction: float
    """How far the search goes beyond the starts, as a fraction of their cost."""
    extension_amount: float
    """How far it goes in addition to that."""
    final_estimate: float
    """Estimate at which the search ended; infinite if its queue was exhausted."""
    clock_interval: int
    """Number of entries taken from the queue before the clock is read."""


class NodeCosts(Record):
    """Costs of a node to the goal and from the start, in one record as they are read together."""

    cost: float
    """Minimum cost to the goal so far."""
    start_bound: float
    """Lower bound of the cost from the start, infinite for a node that is not to be visited."""
    closed: bool
    """Whether the node was expanded with this cost."""


def costs_to_goal(
    table: NodeTable,
    goals: BoolArray,
    weights: CostWeights,
    starts: IntArray,
    start_bounds: Array,
    extension: tuple[float, float],
    *,
    clock: Clock = UNLIMITED,
) -> tuple[Array, BoolArray]:
    """Compute lower bounds of the cost from each of n nodes to the goal.

    `start_bounds` are consistent lower bounds of the cost from the starts, infinite for nodes that
    are not to be visited. The search goes beyond the starts by a fraction of their cost, and an
    amount. Returns consistent bounds, 0 only at goals, infinite where no path leads to the goal or
    `start_bounds` are; and whether each of them is the minimum cost.
    """
    count, is_start = len(goals), np.zeros(len(goals), dtype=np.bool_)
    is_start[starts] = True
    estimates = NodeCosts.rows(count)
    estimates["cost"], estimates["start_bound"] = np.inf, start_bounds
    queue = NodeQueue.allocate(INITIAL_CAPACITY + int(goals.sum()))
    progress = BackwardProgress.row()
    progress["unreached_starts"], progress["limit"] = int(is_start.sum()), np.inf
    progress["extension_fraction"], progress["extension_amount"] = extension
    nodes = table, goals, is_start
    end = PAUSED
    while end != COMPLETE:
        if end == QUEUE_FULL:
            queue = queue.doubled()
        with clock.piece("nodes settled", CLOCK_INTERVAL) as interval:
            progress["clock_interval"] = interval
            end = int(_search(nodes, weights, estimates, queue, progress))
    outside, finite = np.full(count, np.inf), np.isfinite(start_bounds)
    outside[finite] = np.maximum(
        progress["final_estimate"] - start_bounds[finite], MIN_COST_OUTSIDE_GOAL
    )
    # A cost found beyond the final estimate need not be the minimum.
    bounds: Array = np.minimum(estimates["cost"], outside)
    bounds[(bounds < MIN_COST_OUTSIDE_GOAL) & ~goals] = MIN_COST_OUTSIDE_GOAL
    exact: BoolArray = np.isfinite(estimates["cost"])
    exact[exact] = (estimates["cost"] + start_bounds)[exact] < progress["final_estimate"]
    return bounds, exact


@entry
def _search(
    nodes: tuple[NodeTable, BoolArray, BoolArray],
    weights: CostWeights,
    estimates: Rows[NodeCosts],
    queue: NodeQueue,
    progress: BackwardProgress,
) -> int:
    """Continue a search; return `COMPLETE`, or why it must stop before."""
    table, goals, is_start = nodes
    count = 0
    if not progress.initialised:
        progress.initialised = True
        for s in range(len(goals)):
            if goals[s] and estimates[s].start_bound < np.inf:
                estimates[s].cost = 0.0
                push(queue, estimates[s].start_bound, s)
    while True:
        if count == progress.clock_interval:
            return PAUSED
        count += 1
        entry = pop(queue)
        if entry == NO_ENTRY:
            progress.final_estimate = np.inf
            return COMPLETE
        s = int(queue.node[entry])
        if estimates[s].closed:
            continue
        f = estimates[s].cost + estimates[s].start_bound
        if f > progress.limit:
            progress.final_estimate = f
            return COMPLETE
        if queue.status.entry_count + degree(table, s) + 1 > len(queue.node):
            push(queue, f, s)
            return QUEUE_FULL
        estimates[s].closed = True
        if is_start[s]:
            is_start[s] = False
            progress.unreached_starts -= 1
            if progress.unreached_starts == 0:
                progress.limit = f * (1.0 + progress.extension_fraction) + progress.extension_amount
        _improve_predecessors(table, s, weights, estimates, queue)


@kernel
def degree(table: NodeTable, s: int) -> int:
    """Return an upper bound of the number of neighbours of a node."""
    count = 0
    for limb in range(table.points.shape[1]):
        support_set = table.support_sets[s, limb]
        count += int(table.start[support_set + 1]) - int(table.start[support_set])
    return count


@kernel
def _improve_predecessors(
    table: NodeTable,
    s: int,
    weights: CostWeights,
    estimates: Rows[NodeCosts],
    queue: NodeQueue,
) -> None:
    """Lower the costs of the nodes from which an edge leads to an expanded node."""
    limbs, g = table.points.shape[1], estimates[s].cost
    for limb in range(limbs):
        row = row_of(table, s, limb)
        if row < 0:
            continue
        support_set = table.support_sets[s, limb]
        begin, end = int(table.start[support_set]), int(table.start[support_set + 1])
        for k in range(end - begin):
            if not has_bit(table.joined, row + k):
                continue
            other = int(table.members[begin + k]) // limbs
            estimate = estimates[other]
            cost = g + edge_cost(table, other, s, limb, weights)
            if cost < estimate.cost and estimate.start_bound < np.inf:
                estimate.cost, estimate.closed = cost, False
                push(queue, cost + estimate.start_bound, other)


@kernel
def edge_cost(table: NodeTable, a: int, b: int, moved: int, weights: CostWeights) -> float:
    """Return the cost of a step between two nodes, after which a limb of the second has moved."""
    charge = weights.step + weights.prices[b, moved] if len(weights.prices) else weights.step
    if weights.base == 0.0:
        return float(charge)
    shift = 0.0
    for axis in range(3):
        offset = table.base_position[a, axis] - table.base_position[b, axis]
        shift += offset * offset
    return float(weights.base * np.sqrt(shift) + charge)
