"""Label-setting search over the table of a graph, with lazy evaluation of edges.

The table has an upper bound of the branches kept on every edge, so the cheapest walk over it bounds
the cost of all plans from below, and nearly all edges keep that bound. As in LazySP (Dellin and
Srinivasa 2016) the edges of a walk are checked after it is found, and the search is repeated while
one of them keeps no branch. With two limbs the first walk whose edges are all checked is optimal.
With more limbs several stages follow each other, see `search_stages`; each walk becomes the
incumbent, with an optimality bound.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.limb_masks import packed, unpacked
from mlivr_gym.kinematics.batches import distances
from mlivr_gym.planners.backward_search import MIN_COST_OUTSIDE_GOAL
from mlivr_gym.planners.checked_edges import CheckedEdges
from mlivr_gym.planners.costs import Cost, cost_weights
from mlivr_gym.planners.label_search import (
    PAUSED,
    QUEUE_EMPTY,
    SearchGraph,
    SearchParameters,
    cheapest_walk,
)
from mlivr_gym.planners.labels import CAPACITY, NodeOrigins, NodeWalk
from mlivr_gym.planners.lazy_table import StatePath
from mlivr_gym.planners.lower_bounds import GoalBounds, LowerBounds
from mlivr_gym.planners.outcome import (
    GOAL_REACHED,
    LIMIT_REACHED,
    SEARCH_EXHAUSTED,
    Improvement,
    SearchResult,
)
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.planners.search_stages import (
    FIRST_WALK,
    OBSTACLE_STAGES,
    QUICK_FIRST_WALK,
    STAGES,
    SearchStage,
)
from mlivr_gym.postures.turns import permuted_limbs
from mlivr_gym.stances.node_pairs import edge_ends
from mlivr_gym.transitions.state import State

NODES_CHECKED_AROUND = 200
"""Number of nodes that are checked around a node of a walk that touches an obstacle."""

FIRST_EXPANSION_LIMIT = 50
"""Labels that a search expands before one from the other end improves the lower bounds."""

LIMIT_GROWTH = 4
"""Factor by which this limit grows after a search from either end."""

COST_TOLERANCE = 1e-9
"""Relative tolerance of costs: a walk must be cheaper by more than this share to replace
another."""


def search_table(bounds: LowerBounds, search: SearchQuery, start: State) -> SearchResult | None:
    """Search from a state to the goal over the table of a graph.

    Parameters
    ----------
    bounds
        Lower bounds over the table of the graph.
    search
        The query.
    start
        The start state.

    Returns
    -------
    SearchResult | None
        The path; None if no sequence of moves connects the start with the goal.
    """
    table_search = _TableSearch(bounds, search, start)
    if table_search.starts_at_goal:
        return SearchResult(GOAL_REACHED, (start,), 0.0, 1, 1, np.zeros((0, 2, 3)), bound=1.0)
    best, improvements = None, []
    for walk in table_search.walks():
        cost = table_search.cost(walk)
        best, bound = walk, table_search.bound(cost)
        elapsed = time.perf_counter() - search.start_time
        improvements.append(Improvement(elapsed, cost, bound))
        if bound <= search.inflation:
            break
    counts = table_search.expanded, table_search.generated, table_search.tree()
    if best is None:
        if table_search.lower_bound == np.inf and not bounds.is_connected(search.goal, start):
            return None
        status = SEARCH_EXHAUSTED if table_search.lower_bound == np.inf else LIMIT_REACHED
        return SearchResult(status, (start,), 0.0, *counts, table_search.backward_expanded)
    cost = table_search.cost(best)
    return SearchResult(
        GOAL_REACHED, best.states, cost, *counts, table_search.backward_expanded,
        table_search.bound(cost), tuple(improvements),
    )  # fmt: skip


class _TableSearch:
    """A search over a table in progress.

    Attributes
    ----------
    lower_bound
        Lower bound of the cost of every plan; infinite if it is proved that there is none.
    has_walk
        Whether a walk was found.
    starts_at_goal
        Whether the start is at the goal.
    expanded
        Number of labels expanded, in all searches.
    generated
        Number of labels generated, in all searches.
    backward_expanded
        Number of nodes expanded by backward searches for the lower bounds.
    """

    def __init__(self, bounds: LowerBounds, search: SearchQuery, start: State) -> None:
        self.graph, self.goal, self.search = bounds.graph, search.goal, search
        self._bounds, self._lazy_table = bounds, bounds.lazy_table
        self.lower_bound, self.has_walk = 0.0, False
        self.expanded = self.generated = self.backward_expanded = self._last_expanded = 0
        self._end = PAUSED
        self._labels = bounds.labels
        self._no_edges = CheckedEdges.empty(len(bounds.table.points))
        position = self.graph.posture_of(start).base_position
        self.starts_at_goal = bool(self.goal.reached(position[0], start.stance))
        self._origin_paths: list[StatePath] = []
        self._set_origins(StatePath((start,), position))

    def _set_origins(self, start: StatePath) -> None:
        """Set the nodes at which walks may start, each with its path and limb relabelling."""
        state, here = start.states[0], start.positions[0]
        states, costs = [state], np.zeros(1)
        self._origin_paths = [start]
        if state.pose is not None:
            # Steps that leave a given base pose are no edges of the table.
            steps = self.graph.successors(state)
            states = [steps.after(state, k) for k in range(len(steps.limb))]
            places = steps.base_in_world
            self._origin_paths = [
                StatePath((state, after), np.stack([here, place]))
                for after, place in zip(states, places, strict=True)
            ]
            shift = np.linalg.norm(places - here, axis=1)
            costs = self.goal.cost.base_weight * shift + self.goal.cost.step_weight
        stances = np.array([s.stance for s in states], dtype=np.int64)
        masks = np.array([s.masks for s in states], dtype=np.int64)
        rows, self._turns = self._lazy_table.table.find(stances.reshape(-1, self.graph.limbs))
        masks = masks.reshape(-1, self.graph.limbs)
        self._origins = NodeOrigins(rows, packed(permuted_limbs(masks, self._turns)), costs)

    def _bound_stages(self) -> Iterator[tuple[GoalBounds, tuple[SearchStage, ...]]]:
        """Yield lower bounds in turn, each with the stages of the search that use it.

        Bounds cached by earlier queries come first. While there is no walk, the fewest steps
        follow, which are computed sooner than a base displacement.
        """
        search, goal, starts = self.search, self.goal, self._origins.nodes
        lazy_table = self._lazy_table
        stages: tuple[SearchStage, ...] = STAGES
        first: tuple[SearchStage, ...] = (FIRST_WALK,)
        if lazy_table.label_independent:
            stages = (
                SearchStage(
                    SearchParameters(search.cost_weight, lazy=not lazy_table.is_complete),
                    proves_bound=True,
                ),
            )
            if search.heuristic != "cost_to_go":
                yield self._bounds.from_distance(search), stages
                return
        elif self.graph.obstacles:
            stages, first = OBSTACLE_STAGES, OBSTACLE_STAGES[:3]
        known = self._bounds.cached(goal, starts)
        if lazy_table.label_independent and not lazy_table.is_complete:
            yield from self._improved_bounds(known or self._bounds.compute(goal, starts))
            return
        if known is not None and (
            lazy_table.label_independent or known.occupied == self.graph.occupied
        ):
            yield known, stages
            return
        if known is not None:
            quick = first == (FIRST_WALK,) and goal.cost.base_weight
            yield known, (QUICK_FIRST_WALK,) if quick else first
        if goal.cost.base_weight and not lazy_table.label_independent and not self.has_walk:
            steps = replace(goal, cost=Cost.named("steps"))
            yield self._bounds.cached(steps, starts) or self._bounds.compute(steps, starts), first
        if time.perf_counter() < search.deadline:
            new = self._bounds.compute(goal, starts)
            self.backward_expanded += int(new.exact.sum())
            yield new, stages

    def _improved_bounds(
        self, goal_bounds: GoalBounds
    ) -> Iterator[tuple[GoalBounds, tuple[SearchStage, ...]]]:
        """Yield lower bounds that rise to the cost-to-go as checked edges turn out impossible."""
        search, expansion_limit = self.search, FIRST_EXPANSION_LIMIT
        while True:
            parameters = SearchParameters(
                search.cost_weight, max_expansions=expansion_limit, lazy=True
            )
            yield goal_bounds, (SearchStage(parameters, proves_bound=True),)
            late = time.perf_counter() >= search.deadline
            if late or self.lower_bound == np.inf or self.expanded >= search.limit:
                return
            if self._origin_paths[0].states[0].pose is None:
                goal_bounds = self._backward_bounds(goal_bounds, expansion_limit)
            expansion_limit *= LIMIT_GROWTH

    def _backward_bounds(self, goal_bounds: GoalBounds, limit: int) -> GoalBounds:
        """Return lower bounds improved by a backward search from the goal that checks its edges.

        An edge of two limbs keeps the same branches in both directions, so the backward search is
        the forward search with start and goal exchanged. The cost of an expanded node is exact;
        every other node costs at least the final lower bound of the backward search minus its bound
        from the start.
        """
        lazy_table, goal, start = self._lazy_table, self.goal, self._origins.nodes[0]
        base, nodes = lazy_table.table.base_position, np.flatnonzero(goal_bounds.h == 0.0)
        distances_to_start = distances(base, base[start])
        start_bounds = goal.cost.heuristic(
            "consistent", distances_to_start, 0.0, self.graph.max_step
        )
        start_bounds = np.maximum(start_bounds, MIN_COST_OUTSIDE_GOAL)
        start_bounds[start] = 0.0
        origins = NodeOrigins(nodes, lazy_table.table.masks[nodes], np.zeros(len(nodes)))
        search_graph = SearchGraph(
            lazy_table.table, lazy_table.checked_edges, cost_weights(goal.cost)
        )
        found = cheapest_walk(
            search_graph, start_bounds, origins, self._labels,
            SearchParameters(max_expansions=limit, lazy=True),
            deadline=self.search.deadline, check=lazy_table.masks_after,
        )  # fmt: skip
        self.backward_expanded, self._last_expanded = self.backward_expanded + found.expanded, 0
        explored = self._labels.expanded[: found.expanded]
        exact = np.full(len(base), np.inf)
        np.minimum.at(exact, self._labels.queue.node[explored], self._labels.cost[explored])
        improved = np.maximum(goal_bounds.h, np.minimum(exact, found.lower_bound - start_bounds))
        improved[nodes] = 0.0
        return goal_bounds._replace(h=improved)

    def walks(self) -> Iterator[StatePath]:
        """Yield walks to the goal, each cheaper than the one before, until the search ends."""
        if not len(self._origins.nodes):
            self.lower_bound = np.inf
            return
        incumbent_cost = np.inf
        for goal_bounds, stages in self._bound_stages():
            self._raise_lower_bound(goal_bounds)
            for stage in stages:
                walk = self._next_walk(goal_bounds, stage, incumbent_cost)
                if walk is not None:
                    self.has_walk, incumbent_cost = True, self.cost(walk)
                    yield walk
                if self.lower_bound >= incumbent_cost * (1.0 - COST_TOLERANCE):
                    return

    def _raise_lower_bound(self, goal_bounds: GoalBounds) -> None:
        """Raise the lower bound of all plans to the least bound at an origin."""
        if self.search.heuristic == "paper":
            return
        origins = self._origins
        least = float((origins.cost + goal_bounds.h[origins.nodes]).min())
        if goal_bounds.cost == self.goal.cost or least == np.inf:
            self.lower_bound = max(self.lower_bound, least)

    def _next_walk(
        self, goal_bounds: GoalBounds, stage: SearchStage, incumbent_cost: float
    ) -> StatePath | None:
        """Return a walk cheaper than the incumbent, or None if the stage finds none."""
        cost_limit = incumbent_cost * (1.0 - COST_TOLERANCE)
        lazy_table, search, parameters = self._lazy_table, self.search, stage.parameters
        relaxed = stage.proves_bound and not lazy_table.label_independent
        if stage.only_after_exhaustion and self._end != QUEUE_EMPTY:
            return None
        while time.perf_counter() < search.deadline and self.lower_bound < cost_limit:
            limit = min(parameters.max_expansions, search.limit - self.expanded)
            known = self._no_edges if relaxed else lazy_table.checked_edges
            found = cheapest_walk(
                SearchGraph(lazy_table.table, known, cost_weights(goal_bounds.cost)),
                goal_bounds.h, self._origins, self._labels,
                parameters._replace(max_expansions=limit), cost_limit=cost_limit,
                deadline=search.deadline, check=lazy_table.masks_after,
            )  # fmt: skip
            walk = found.walk
            self._end = found.end if walk is None else PAUSED
            self.expanded, self._last_expanded = self.expanded + found.expanded, found.expanded
            self.generated += self._labels.label_count
            exhausted = walk is None and found.end == QUEUE_EMPTY
            exhausted &= parameters.labels_per_node == CAPACITY
            exhausted &= (
                lazy_table.label_independent or parameters.equal_only or not parameters.lazy
            )
            proves = stage.proves_bound and (exhausted or parameters.cost_weight == 1.0)
            if proves and search.heuristic != "paper":
                self.lower_bound = max(self.lower_bound, found.lower_bound)
            if walk is None:
                return None
            states: StatePath | None = None
            masks: NDArray[np.uint64] | None = walk.masks
            if not (lazy_table.is_complete or parameters.lazy):
                if lazy_table.check_nodes(walk.nodes):
                    self._check_nodes_around(walk.nodes)
                    continue
                lazy_table.check_edges(walk.edges)
                masks = self._masks_along(walk)
            if masks is not None:
                start_path, turn = self._origin_paths[walk.origin], int(self._turns[walk.origin])
                states = lazy_table.state_path(start_path, turn, walk._replace(masks=masks))
            if states is not None:
                if not self.goal.reached(states.positions[-1], states.states[-1].stance):
                    # The node lies outside the goal by less than the rounding of positions.
                    goal_bounds.h[walk.nodes[-1]] = MIN_COST_OUTSIDE_GOAL
                    continue
                return states if self.cost(states) < cost_limit else None
            if relaxed:
                return None
        return None

    def _check_nodes_around(self, nodes: IntArray) -> None:
        """Check the reached nodes closest to the nodes of a walk that touch something."""
        table, free = self._lazy_table.table, self._bounds.table
        reached = self._labels.queue.node[: self._labels.label_count].astype(np.int64)
        for node in nodes[table.masks[nodes] != free.masks[nodes]].tolist():
            self._lazy_table.check_nodes(reached, NODES_CHECKED_AROUND, table.base_position[node])

    def cost(self, walk: StatePath) -> float:
        """Return the cost of a walk."""
        cost, spent = self.goal.cost, 0.0
        for shift in np.linalg.norm(np.diff(walk.positions, axis=0), axis=1).tolist():
            spent += cost.base_weight * shift + cost.step_weight
        return spent

    def bound(self, cost: float) -> float:
        """Return the factor of the minimum within which a walk of some cost is proved."""
        if cost <= self.lower_bound * (1.0 + COST_TOLERANCE):
            return 1.0
        proved = cost / self.lower_bound if self.lower_bound > 0.0 else math.inf
        return (
            min(proved, self.search.guaranteed_factor)
            if self._lazy_table.label_independent
            else proved
        )

    def _masks_along(self, walk: NodeWalk) -> NDArray[np.uint64] | None:
        """Return the branches that limbs may be on along a walk, by its checked edges.

        Returns
        -------
        NDArray[np.uint64] | None
            The masks, see `limb_masks`, shape (k + 1,); None if a limb keeps no branch.
        """
        table, limbs = self._lazy_table.table, self.graph.limbs
        (before, i), (after, j), _ = edge_ends(table, walk.edges)
        kept = unpacked(self._lazy_table.checked_edges.kept_on(walk.edges), limbs - 1)
        leaves, grasps = (unpacked(table.released[rows], limbs) for rows in (before, after))
        masks = [unpacked(walk.masks[:1], limbs)[0]]
        for k in range(len(walk.edges)):
            held = np.roll(masks[-1], -i[k] - 1)[:-1] & kept[k]
            if not held.all() or not masks[-1][i[k]] & leaves[k, i[k]]:
                return None
            masks.append(np.roll(np.append(held, grasps[k, j[k]]), j[k] + 1))
        return packed(np.array(masks)) if masks[-1].all() else None

    def tree(self) -> Array:
        """Return base positions at both ends of the edges explored last, (e, 2, 3) [m]."""
        labels, base = self._labels, self._lazy_table.table.base_position
        explored = labels.expanded[: self._last_expanded]
        parent = labels.parent[explored]
        after = base[labels.queue.node[explored]]
        before = after.copy()
        before[parent >= 0] = base[labels.queue.node[parent[parent >= 0]]]
        for k in np.flatnonzero(parent < 0).tolist():
            before[k] = self._origin_paths[-1 - int(parent[k])].positions[0]
        ends: Array = np.stack([before, after], axis=1)
        return np.asarray(ends[(parent >= 0) | np.any(before != after, axis=1)])
