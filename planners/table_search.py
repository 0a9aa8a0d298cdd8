"""Label-setting search over the table of a graph, with lazy edge evaluation.

The table has an upper bound of the branches kept on every edge, so the cheapest path over it bounds
the cost of all plans from below, and nearly all edges keep that bound. There are three cases:

* *Two limbs, complete table*: every edge is exact, so the first path is optimal without any check.
* *Two limbs, incomplete table* (obstacles, or settings whose table was not built): an edge is
  looked at when its label leaves the open queue, as in Lazy Weighted A* (Cohen, Phillips and
  Likhachev 2014), and checked when a path uses it. Searches from the start and from the goal take
  turns, each pair with twice as many labels as the one before; those from the goal raise the
  bounds. If this takes long, all nodes on the way are checked.
* *Three or four limbs*: a check takes long, so as in LazySP (Dellin and Srinivasa 2016) the edges
  of a path are checked after it is found, and the search is repeated while one of them keeps no
  branch. Nodes are checked when they are popped. It is an anytime search: a stage of weighted A*
  finds a path soon; it becomes the incumbent of the last stage, which has every label and starts
  anew (Richter, Thayer and Ruml 2010), so that its path, once all edges were checked, is optimal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.limb_branch_sets import packed, unpacked
from mlivr_gym.planners.backward_search import MIN_COST_OUTSIDE_GOAL
from mlivr_gym.planners.clock import OutOfTime
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.label_search import (
    SEARCH_COMPLETE,
    SearchGraph,
    SearchParameters,
    cheapest_path,
)
from mlivr_gym.planners.labels import NodeOrigins, NodePath
from mlivr_gym.planners.lower_bounds import GoalBounds, LowerBounds
from mlivr_gym.planners.path_search import COST_TOLERANCE, PathSearch, StatePath
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.postures.relabelling import relabelled
from mlivr_gym.stances.node_edges import edge_ends
from mlivr_gym.transitions.state import State

WITH_OLD_BOUNDS = 4000
"""Labels that a search of two limbs expands with bounds from before some points were occupied.
These mostly lead to the goal: new bounds are no tighter for a path that is dearer by less than they
extend, see `lower_bounds.SEARCH_EXTENSION`."""

FIRST_LIMIT, MANY = 500, 8000
"""Labels of two limbs that the first search expands where edges are to be checked, and the first
one from the goal, of each pair of searches twice as many as of the one before; and with how many of
them all nodes on the way are checked, so that the bounds tell of what obstacles cut off."""

FREE, AMONG_OBSTACLES = 1.5, 3.0
"""Weights of the first stage of more than two limbs; among obstacles many a path turns out to be
blocked, and with a larger weight each takes less time to find."""

WEIGHTED = SearchParameters(labels_per_node=8)
"""That stage, but for its weight."""

IN_GIVEN_ORDER = WEIGHTED._replace(max_expansions=200, check_when_popped=True)
"""The stage in the order of the queue that the user chose, which the others follow if it finds no
path, but for the weight of the cost, which is that of the query."""

EDGES_AT_ONCE = 4
"""Edges of a path among obstacles that are checked at once: after one that is blocked, the others
can wait. Without obstacles few are no steps; the more of them are known, the fewer searches."""


class TableSearch(PathSearch):
    """A search over the table of a graph, given by lower bounds over it."""

    def __init__(self, lower_bounds: LowerBounds, search: SearchQuery, start: State) -> None:
        """Prepare a search from a state."""
        super().__init__(lower_bounds.graph, search, start)
        self._lower_bounds, self._present = lower_bounds, lower_bounds.graph.present
        self._checks_before, self._last_expanded = self._present.check_effort, 0
        self._has_ended = False
        self._labels = lower_bounds.labels
        self._origin_paths: list[StatePath] = []
        self._set_origins(StatePath((start,), self.start_posture.base_position))

    def _check_nodes(self, rows: IntArray) -> None:
        """Check nodes against obstacles, shape (k,)."""
        present = self._present
        rows = rows[present.unchecked[rows]] if len(present.unchecked) else rows[:0]
        for piece in self.clock.pieces("nodes", len(rows)):
            present.check_nodes(rows[piece])

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy the query alone; a copy begins again."""
        return type(self), (self._lower_bounds, self.search, self.start)

    def _set_origins(self, start: StatePath) -> None:
        """Set the nodes at which paths may start, each with its path and limb relabelling."""
        state, base = start.states[0], start.positions[0]
        states, costs = [state], np.zeros(1)
        self._origin_paths = [start]
        if state.pose is not None:
            # Steps that leave a given base pose are no edges of the table.
            steps = self.graph.successors_by_pieces(state, self.clock.pieces)
            states = [steps.after(state, k) for k in range(len(steps.limb))]
            self._origin_paths = [
                StatePath((state, after), np.stack([base, position]))
                for after, position in zip(states, steps.base_position, strict=True)
            ]
            shift = np.linalg.norm(steps.base_position - base, axis=1)
            costs = self.goal.cost.of_steps(shift, steps.stances(state), steps.point)
        both = [(s.stance, s.branch_sets) for s in states]
        table = np.array(both, dtype=np.int64).reshape(-1, 2, self.graph.limbs)
        stances, branch_sets = table[:, 0], table[:, 1]
        rows, self._relabellings = self._present.table.find(stances, self.graph.robot)
        branch_sets = relabelled(branch_sets, self._relabellings)
        self._origins = NodeOrigins(rows, packed(branch_sets), costs)

    def _bounds_with_stages(self) -> Iterator[tuple[GoalBounds, tuple[SearchParameters, ...]]]:
        """Yield lower bounds in turn, each with the stages of the search that use it."""
        if not self.graph.lists_all:
            yield from self._bounds_for_many()
            return
        search, is_complete = self.search, self._present.is_complete
        by_cost = SearchParameters(search.cost_weight, check_when_popped=not is_complete)
        if search.heuristic != "relaxed":
            yield self._lower_bounds.from_distance(search), (by_cost,)
            return
        known = self._lower_bounds.cached(self.goal, self._origins.nodes)
        if known is not None and known.occupied != self.graph.occupied:
            if (known.h == 0.0).any():  # otherwise the goal is occupied
                yield known, (by_cost._replace(max_expansions=WITH_OLD_BOUNDS),)
            known = None
        bounds, limit = known or self._present_bounds(self.goal), FIRST_LIMIT
        if is_complete:
            yield bounds, (by_cost,)
            return
        while bounds.h[self._origins.nodes].min() < np.inf:
            yield bounds, (by_cost._replace(max_expansions=limit),)
            if self._has_ended or self.is_late or self.expanded >= search.limit:
                return
            if limit >= MANY:
                self._check_nodes(np.flatnonzero(bounds.h < np.inf))
            bounds, limit = self._improved_bounds(self._bounds_of_rest(bounds), limit), 2 * limit
        self.lower_bound = np.inf

    def _bounds_for_many(self) -> Iterator[tuple[GoalBounds, tuple[SearchParameters, ...]]]:
        """Yield bounds and stages of more than two limbs, whose checks take long.

        While there is no path, the fewest steps come first, which are computed sooner than a base
        displacement. Which bounds are known does not change the stages, nor so the plan.
        """
        search, goal = self.search, self.goal
        weight = AMONG_OBSTACLES if self.graph.obstacles else FREE
        weighted, last = WEIGHTED._replace(cost_weight=1.0 / weight), SearchParameters()
        if search.has_given_order:
            if search.method != "dijkstra":
                self._raise_lower_bound(self._present_bounds(goal))
            bounds = self._lower_bounds.from_distance(search)
            if search.heuristic == "zero":
                yield bounds, (last,)
                return
            yield bounds, (IN_GIVEN_ORDER._replace(cost_weight=search.cost_weight),)
        if not goal.cost.counts_steps and not self.has_path:
            yield self._present_bounds(replace(goal, cost=Cost.named("steps"))), (weighted,)
        if not self.is_late:
            yield self._present_bounds(goal), (weighted, last)

    def _present_bounds(self, goal: Goal) -> GoalBounds:
        """Return bounds from the origins with the points occupied now, cached or computed."""
        known = self._lower_bounds.cached(goal, self._origins.nodes)
        if known is not None and known.occupied == self.graph.occupied:
            return known
        new = self._lower_bounds.compute(goal, self._origins.nodes, self.clock)
        self.backward_expanded += int(new.is_tight.sum())
        return new

    def _improved_bounds(self, goal_bounds: GoalBounds, limit: int) -> GoalBounds:
        """Return bounds raised by a search from the goal that expands labels up to a limit.

        An edge of two limbs keeps the same branches in both directions, so the search backward is
        that forward with start and goal exchanged. A node that it expanded costs what it found. Any
        other node costs at least the lower bound of this search, less what the node is away from
        the start: obstacles near the goal so raise the bounds of all nodes. Prices of points may
        differ between a step and that back, so with them only a goal that is cut off is found.
        """
        present, goals = self._present, np.flatnonzero(goal_bounds.h == 0.0)
        is_origin = np.zeros(len(goal_bounds.h), dtype=np.bool_)
        is_origin[self._origins.nodes] = True
        away = self._lower_bounds.among_checked(goal_bounds.cost, is_origin, goals, self.clock).h
        origins = NodeOrigins(goals, present.table.branch_sets[goals], np.zeros(len(goals)))
        outcome = cheapest_path(
            self._search_graph(goal_bounds), away, origins, self._labels,
            SearchParameters(max_expansions=limit, check_when_popped=True),
            clock=self.clock, check=self._look_at,
        )  # fmt: skip
        self.backward_expanded, self._last_expanded = self.backward_expanded + outcome.expanded, 0
        if goal_bounds.cost.prices is not None and outcome.lower_bound < np.inf:
            return goal_bounds
        explored = self._labels.expanded[: outcome.expanded]
        cost = np.full(len(away), np.inf)
        np.minimum.at(cost, self._labels.queue.node[explored], self._labels.cost[explored])
        # No path from the start leads to nodes that are infinitely far away.
        others = outcome.lower_bound - np.where(away < np.inf, away, 0.0)
        h = np.maximum(goal_bounds.h, np.minimum(cost, others))
        h[goals] = 0.0
        return goal_bounds._replace(h=h)

    def _search_graph(self, goal_bounds: GoalBounds) -> SearchGraph:
        """Return the graph of a search with the cost of some bounds."""
        present, weights = self._present, self._lower_bounds.weights(goal_bounds.cost)
        known = present.table, present.checked_edges
        return SearchGraph(*known, weights, present.unchecked, present.unsure)

    def _bounds_of_rest(self, goal_bounds: GoalBounds) -> GoalBounds:
        """Return bounds that are no less than those over what is not known to be blocked."""
        is_goal, starts = goal_bounds.h == 0.0, self._origins.nodes
        rest = self._lower_bounds.among_checked(self.goal.cost, is_goal, starts, self.clock)
        return goal_bounds._replace(h=np.maximum(goal_bounds.h, rest.h))

    def _paths(self) -> Iterator[StatePath]:
        """Yield paths to the goal, each cheaper than the one before, see `PathSearch.paths`."""
        if not len(self._origins.nodes):
            self.lower_bound = np.inf
            return
        for goal_bounds, in_turn in self._bounds_with_stages():
            if self.search.heuristic != "paper":
                self._raise_lower_bound(goal_bounds)
            for stage in in_turn:
                path = self._next_path(goal_bounds, stage)
                if path is not None:
                    self.incumbent_cost = self.cost(path)
                    yield path
                if self.lower_bound >= self.incumbent_cost * (1.0 - COST_TOLERANCE):
                    return

    def _raise_lower_bound(self, goal_bounds: GoalBounds) -> None:
        """Raise the lower bound of all plans to the least bound at an origin."""
        origins = self._origins
        least = float((origins.cost + goal_bounds.h[origins.nodes]).min())
        if goal_bounds.cost == self.goal.cost or least == np.inf:
            self.lower_bound = max(self.lower_bound, least)

    def _next_path(self, goal_bounds: GoalBounds, stage: SearchParameters) -> StatePath | None:
        """Return a path cheaper than the incumbent, or None if the stage finds none."""
        cost_limit = self.incumbent_cost * (1.0 - COST_TOLERANCE)
        end = self.expanded + stage.max_expansions
        while not self.is_late and self.expanded < end and self.lower_bound < cost_limit:
            rest = stage._replace(max_expansions=end - self.expanded)
            path = self._search(goal_bounds, rest, cost_limit)
            if path is None:
                return None
            states = self._checked_walk(path)
            if states is None:
                self._has_ended = False  # what it found was blocked
                continue
            if self.goal.reached(states.positions[-1], states.states[-1].stance):
                return states if self.cost(states) < cost_limit else None
            # The node lies outside the goal by less than the rounding of positions.
            goal_bounds.h[path.nodes[-1]] = MIN_COST_OUTSIDE_GOAL
        return None

    def _search(
        self, goal_bounds: GoalBounds, stage: SearchParameters, cost_limit: float
    ) -> NodePath | None:
        """Run one search of a stage, and raise the lower bound of all plans by what it proves."""
        search = self.search
        limit = min(search.limit - self.expanded, search.effort - self.effort)
        limit = min(stage.max_expansions, limit)
        outcome = cheapest_path(
            self._search_graph(goal_bounds), goal_bounds.h, self._origins, self._labels,
            stage._replace(max_expansions=limit), cost_limit=cost_limit,
            clock=self.clock, check=self._look_at, check_nodes=self._check_nodes,
        )  # fmt: skip
        self._has_ended = outcome.end == SEARCH_COMPLETE and stage.cost_weight >= search.cost_weight
        is_exhausted = outcome.end == SEARCH_COMPLETE and outcome.path is None
        self.expanded, self._last_expanded = self.expanded + outcome.expanded, outcome.expanded
        self.generated += self._labels.label_count
        # A heuristic that overestimates proves nothing but that no path is left.
        admissible = search.heuristic != "paper" or outcome.lower_bound == np.inf
        # It holds for all plans with weight 1, and where nothing is left that may lead to another.
        proves = stage.cost_weight == 1.0 or (is_exhausted and not outcome.has_dropped)
        if proves and admissible:
            self.lower_bound = max(self.lower_bound, outcome.lower_bound)
        return outcome.path

    def _look_at(self, edges: IntArray, branch_sets: NDArray[np.uint64]) -> NDArray[np.uint64]:
        """Look at edges; return an upper bound of the branches after them, 0 for no step, (k,).

        Edges that are not known without obstacles are checked, than which nothing is quicker then.
        Raises `OutOfTime` once the effort is spent.
        """
        if self.effort >= self.search.effort:
            raise OutOfTime
        present = self._present
        if present.is_known:
            (before, _), (after, _), _ = edge_ends(present.table, edges)
            self._check_nodes(np.unique(np.concatenate([before, after])))
            for piece in self.clock.pieces("looks", len(edges)):
                present.look(edges[piece])
        else:
            self._check_edges(present.undecided(edges))
        kept = present.checked_edges.kept_on(edges)
        return present.branch_sets_after(edges, branch_sets, kept)

    def _checked_walk(self, path: NodePath) -> StatePath | None:
        """Check the edges of a path; return its states, None if a limb keeps no branch."""
        present, edges = self._present, path.edges
        sets = [self._origins.branch_sets[path.origin : path.origin + 1]]
        size = EDGES_AT_ONCE if self.graph.obstacles else max(len(edges), 1)
        for first in range(0, len(edges), size):
            piece = edges[first : first + size]
            if not present.is_complete:
                self._check_edges(present.undecided(piece))
            kept = present.kept(piece)
            for k in range(len(piece)):
                edge = slice(k, k + 1)
                sets.append(present.branch_sets_after(piece[edge], sets[-1], kept[edge]))
                if not sets[-1][0]:
                    return None
        # The swing limb is limb i of the node before an edge and limb j of that after it, so from
        # node to node the limbs of the robot turn by i - j among those of the table.
        (_, i), (_, j), _ = edge_ends(present.table, edges)
        relabelling = int(self._relabellings[path.origin])
        relabellings = -np.cumsum([relabelling, *(i - j).tolist()])
        points = relabelled(present.table.points[path.nodes].astype(np.int64), relabellings)
        branch_sets = relabelled(unpacked(np.concatenate(sets), points.shape[1]), relabellings)
        start = self._origin_paths[path.origin]
        both = zip(points[1:].tolist(), branch_sets[1:].tolist(), strict=True)
        states = [State(tuple(stance), tuple(after)) for stance, after in both]
        positions = self.graph.postures(points[1:]).base_position if states else np.zeros((0, 3))
        return StatePath((*start.states, *states), np.concatenate([start.positions, positions]))

    def _check_edges(self, edges: IntArray) -> None:
        """Check edges in pieces of the clock, shape (k,)."""
        for piece in self.clock.pieces("edges", len(edges)):
            self._present.kept(edges[piece])

    @property
    def effort(self) -> int:
        """The effort so far, see `PathSearch.effort`."""
        return self.expanded + self._present.check_effort - self._checks_before

    def bound(self) -> float:
        """Return the factor of the minimum within which the incumbent is proved."""
        proved = super().bound()
        if self._has_ended and self.graph.lists_all:
            return min(proved, self.search.guaranteed_bound)
        return proved

    def is_connected(self) -> bool:
        """Return whether moves may connect the start with the goal, whatever the obstacles are."""
        return self._lower_bounds.is_connected(self.goal, self.start)

    def tree(self) -> Array:
        """Return base positions at both ends of the edges explored last, (e, 2, 3) [m]."""
        origins = np.array([path.positions[0] for path in self._origin_paths]).reshape(-1, 3)
        nodes = self._present.table
        return self._labels.explored_edges(self._last_expanded, nodes.base_position, origins)
