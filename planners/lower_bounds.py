"""Admissible and consistent lower bounds of the cost from every node to a goal, cached by goal.

They are the relaxed cost-to-go: the minimum cost over the edges of the table if limbs could change
their branches at any time. Obstacles and points occupied later only make plans dearer, so the
bounds of a goal stay valid when the robot stands elsewhere on its path or finds a point occupied,
and replanning is fast.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.kinematics.batches import distances, rows_close
from mlivr_gym.planners.backward_search import MIN_COST_OUTSIDE_GOAL, costs_to_goal
from mlivr_gym.planners.building import result_by_deadline
from mlivr_gym.planners.clock import UNLIMITED, Clock
from mlivr_gym.planners.costs import Cost, CostWeights, cost_weights
from mlivr_gym.planners.fewest_steps import fewest_steps
from mlivr_gym.planners.labels import Labels
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.stances.node_table import ROUNDED, NodeTable, connected_parts
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

SEARCH_EXTENSION = (0.03, 2)
"""How far the bounds extend beyond the start: a fraction of the cost, and a number of steps. They
serve the starts of further plans; and where branches or occupied points make the cheapest path
dearer than its bound, without them all nodes in between would be expanded. Two limbs, whose paths
of fewest steps mostly cost as much as their bound, save the time of further steps."""

MAX_STEPS = 1 << 14
"""Upper bound of the steps between any two nodes."""

MAX_STARTS = 1000
"""Maximum number of starts that guide the backward search; with more it is not guided."""

CACHED_GOALS = 4, 16
"""Minimum and maximum number of goals and costs whose bounds are cached."""

CACHED_NODES = 2_000_000
"""Maximum number of nodes in all cached bounds, above the minimum number of goals."""


class GoalBounds(NamedTuple):
    """Lower bounds of the cost from n nodes to a goal."""

    cost: Cost
    """The cost."""
    h: Array
    """The bounds, 0 at the goal alone, shape (n,); infinite where no path leads to the goal, and
    possibly where no path leads from the start. Those computed here are consistent."""
    is_tight: BoolArray
    """Whether each bound is the relaxed cost-to-go, and not only below it, shape (n,)."""
    occupied: frozenset[int]
    """Points that were occupied."""


class LowerBounds:
    """Lower bounds over the table of a graph, cached for the goals used last."""

    def __init__(self, graph: StanceGraph) -> None:
        """Prepare the bounds of a graph that has a table."""
        table = graph.table
        assert table is not None
        self.graph, self.table = graph, table
        # A number of this object might be that of another one later, while work goes on for it.
        self._mark = object()
        self.labels = Labels.allocate(len(table.points))
        """Arrays for the labels of searches."""
        self._weights: tuple[Cost, CostWeights] | None = None
        self._occupied = frozenset[int](), np.zeros(len(table.points), dtype=np.bool_)
        self._cached_bounds: OrderedDict[tuple[Any, ...], GoalBounds] = OrderedDict()
        smallest, largest = CACHED_GOALS
        self._cache_size = max(smallest, min(largest, CACHED_NODES // max(len(table.points), 1)))
        self._position_error = 0.0 if graph.lists_all else 2.0 * ROUNDED
        share, steps = SEARCH_EXTENSION
        self._extension = share, 0 if graph.lists_all else steps

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy the graph alone, and none of the bounds."""
        return type(self), (self.graph,)

    def weights(self, cost: Cost) -> CostWeights:
        """Return a cost for compiled searches over the table."""
        if self._weights is None or self._weights[0] != cost:
            self._weights = cost, cost_weights(cost, self.table.points)
        return self._weights[1]

    def cached(self, goal: Goal, starts: IntArray) -> GoalBounds | None:
        """Return cached bounds that are exact from some nodes, or None."""
        stored, occupied = self._cached_bounds.get(goal.key), frozenset(self.graph.occupied)
        if stored is None or not (stored.occupied <= occupied and stored.is_tight[starts].all()):
            return None
        if stored.occupied == occupied:
            return stored
        return stored._replace(h=np.where(self._occupied_nodes(), np.inf, stored.h))

    def compute(self, goal: Goal, starts: IntArray, clock: Clock = UNLIMITED) -> GoalBounds:
        """Compute and cache bounds from some nodes with the points occupied now.

        They take seconds for a large table; at the deadline they are still being computed.
        """
        goals, forbidden = self._goal_nodes(goal), self._occupied_nodes()
        occupied = frozenset(self.graph.occupied)
        bounds = result_by_deadline(
            ("bounds", self._mark, goal.key, occupied, starts.tobytes()),
            lambda: self._compute(self.table, goal.cost, goals, starts, forbidden, UNLIMITED),
            clock.deadline,
        )._replace(occupied=occupied)
        self._cached_bounds[goal.key] = bounds
        self._cached_bounds.move_to_end(goal.key)
        if len(self._cached_bounds) > self._cache_size:
            self._cached_bounds.popitem(last=False)
        return bounds

    def among_checked(
        self, cost: Cost, goals: BoolArray, starts: IntArray, clock: Clock
    ) -> GoalBounds:
        """Compute bounds of the cost from some nodes to others, of which `goals` tells, (n,).

        They hold for paths over the nodes that keep branches so far and the edges between them.
        """
        table = self.graph.present.table
        forbidden = self._occupied_nodes() | (table.branch_sets == 0)
        return self._compute(table, cost, goals, starts, forbidden, clock)

    def _compute(
        self,
        table: NodeTable,
        cost: Cost,
        goals: BoolArray,
        starts: IntArray,
        forbidden: BoolArray,
        clock: Clock,
    ) -> GoalBounds:
        """Compute bounds from some nodes for paths that do not enter forbidden nodes."""
        if not cost.counts_steps:
            extension = self._extension[0], self._extension[1] * cost.step_weight
            start_bounds = self._start_bounds(cost, starts, forbidden, clock)
            h, exact = costs_to_goal(
                table, goals, self.weights(cost), starts, start_bounds, extension, clock=clock
            )
        else:
            steps, smallest = fewest_steps(
                table, goals, forbidden, starts, self._extension[1], clock
            )
            exact = steps >= 0
            h = cost.step_weight * np.where(exact, steps, smallest)
            h[forbidden] = np.inf
        return GoalBounds(cost, h, exact, frozenset(self.graph.occupied))

    def from_distance(self, search: SearchQuery) -> GoalBounds:
        """Return the bounds of a heuristic that is given by the distance to the goal alone."""
        distance = distances(self.table.base_position, search.goal.target)
        h = search.estimate(distance, self.graph.max_displacement)
        h = np.where(self._goal_nodes(search.goal), 0.0, np.maximum(h, MIN_COST_OUTSIDE_GOAL))
        h[self._occupied_nodes()] = np.inf
        none = np.zeros(len(h), dtype=np.bool_)
        return GoalBounds(search.goal.cost, h, none, frozenset(self.graph.occupied))

    def is_connected(self, goal: Goal, start: State) -> bool:
        """Return whether moves may connect a state with a goal, whatever the obstacles are."""
        goals = self._goal_nodes(goal)
        if self.graph.lists_all and start.pose is None:
            part = connected_parts(self.table)
            return bool((part[goals] == part[self.graph.find(start.stance)]).any())
        return bool(goals.any())

    def _occupied_nodes(self) -> BoolArray:
        """Return whether each node holds an occupied point, shape (n,)."""
        occupied = frozenset(self.graph.occupied)
        if self._occupied[0] != occupied:
            is_occupied = np.zeros(len(self.graph.grasp_map), dtype=np.bool_)
            is_occupied[list(occupied)] = True
            self._occupied = occupied, np.asarray(is_occupied[self.table.points].any(axis=1))
        return self._occupied[1]

    def _goal_nodes(self, goal: Goal) -> BoolArray:
        """Return whether each node may be at the goal, by its rounded position, shape (n,)."""
        reach, goals = (
            goal.tolerance + self._position_error,
            np.zeros(len(self.table.points), np.bool_),
        )
        rows = rows_close(self.table.base_position, goal.target, goal.target, reach)
        goals[rows] = goal.on_goal_face(self.table.points[rows].astype(np.int64))
        return goals

    def _start_bounds(
        self, cost: Cost, starts: IntArray, forbidden: BoolArray, clock: Clock
    ) -> Array:
        """Return lower bounds of the cost from the starts, infinite if forbidden, (n,)."""
        table, count = self.table, len(self.table.points)
        if len(starts) > MAX_STARTS:
            return np.where(forbidden, np.inf, 0.0)
        start_bounds: Array = np.full(count, np.inf)
        for start in table.base_position[starts]:
            clock.check()
            np.minimum(start_bounds, distances(table.base_position, start), out=start_bounds)
        start_bounds *= cost.base_weight
        if cost.step_weight:
            # Pairs of nodes are symmetric, so this is also the number of steps from the starts.
            is_start, no_starts = np.zeros(count, dtype=np.bool_), np.zeros(0, dtype=np.int64)
            is_start[starts] = True
            steps, _ = fewest_steps(table, is_start, forbidden, no_starts, MAX_STEPS, clock)
            start_bounds += cost.step_weight * np.where(steps >= 0, steps, np.inf)
        start_bounds[forbidden] = np.inf
        return start_bounds
