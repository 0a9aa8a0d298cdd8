"""Admissible lower bounds of the cost from every node to a goal, kept for further plans there.

They are the exact cost-to-go if limbs may change their branches. Obstacles and points that are
occupied later only make plans dearer. So what was worked out for a goal serves when the robot
stands elsewhere on its way, or finds a point occupied, and a plan is there at once.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.kinematics.batches import distances, rows_close
from mlivr_gym.planners.backward_search import MIN_COST_OUTSIDE_GOAL, costs_to_goal
from mlivr_gym.planners.costs import Cost, cost_weights
from mlivr_gym.planners.fewest_steps import fewest_steps
from mlivr_gym.planners.labels import Labels
from mlivr_gym.planners.lazy_table import LazyTable, make_lazy_table
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.stances.node_table import ROUNDED, NodeTable
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.pair_rows import connected_parts
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

SEARCH_MARGIN = (0.03, 2)
"""How much farther than to the start they are worked out with more than two limbs, for starts of
further plans: a share of the cost, and steps."""

MAX_STEPS = 1 << 14
"""More steps than any node is away."""

MAX_STARTS = 1000
"""With more starts than this the search backward is led to none of them."""

CACHED_GOALS = 4, 16
"""Goals, or costs to one, that are kept at least and at most."""

CACHED_NODES = 2_000_000
"""Nodes of all that are kept, if there are more than the least."""


class GoalBounds(NamedTuple):
    """Lower bounds of the cost from n nodes to a goal."""

    cost: Cost
    """What is charged."""
    h: Array
    """The bounds, 0 at the goal alone and consistent; infinite where nothing leads there, and they
    may be where nothing leads to from the start; shape (n,)."""
    exact: BoolArray
    """Where they are the least cost if limbs may change their branches, shape (n,)."""
    occupied: frozenset[int]
    """Points that were taken."""


class LowerBounds:
    """Lower bounds to the goals that were asked last."""

    def __init__(self, graph: StanceGraph) -> None:
        """Of a graph that has a table."""
        table = graph.table
        assert table is not None
        self.graph, self.table = graph, table
        self.labels = Labels.allocate(len(table.points))
        """Room for searches."""
        self._lazy_table: LazyTable | None = None
        self._cache: OrderedDict[tuple[Any, ...], GoalBounds] = OrderedDict()
        smallest, largest = CACHED_GOALS
        self._cache_size = max(smallest, min(largest, CACHED_NODES // max(len(table.points), 1)))
        self._position_error = 0.0 if graph.has_tables else 2.0 * ROUNDED
        self._margin = (0.0, 0) if graph.has_tables else SEARCH_MARGIN

    @property
    def lazy_table(self) -> LazyTable:
        """The nodes in the world as it is now, with what was found of them before."""
        if self._lazy_table is None or self._lazy_table.version != self.graph.version:
            self._lazy_table = make_lazy_table(self.graph)
        assert self._lazy_table is not None
        return self._lazy_table

    def cached(self, goal: Goal, starts: IntArray) -> GoalBounds | None:
        """What is kept that serves from some nodes; None if nothing does."""
        stored, occupied = self._cache.get(goal.key), frozenset(self.graph.occupied)
        if stored is None or not (stored.occupied <= occupied and stored.exact[starts].all()):
            return None
        if stored.occupied == occupied:
            return stored
        return stored._replace(h=np.where(self._occupied_nodes(), np.inf, stored.h))

    def compute(self, goal: Goal, starts: IntArray) -> GoalBounds:
        """Bounds from some nodes with the points that are taken now; kept."""
        bounds = self._compute(self.table, goal, starts, self._occupied_nodes())
        self._cache[goal.key] = bounds
        self._cache.move_to_end(goal.key)
        if len(self._cache) > self._cache_size:
            self._cache.popitem(last=False)
        return bounds

    def _compute(
        self, table: NodeTable, goal: Goal, starts: IntArray, forbidden: BoolArray
    ) -> GoalBounds:
        """Bounds from some nodes where walks do not enter some that are taken."""
        cost, goals = goal.cost, self._goal_nodes(goal)
        if cost.base_weight:
            margin = self._margin[0], self._margin[1] * cost.step_weight
            start_bounds = self._start_bounds(cost, starts, forbidden)
            h, exact = costs_to_goal(table, goals, cost_weights(cost), starts, start_bounds, margin)
        else:
            steps, smallest = fewest_steps(table, goals, forbidden, starts, self._margin[1])
            exact = steps >= 0
            h = cost.step_weight * np.where(exact, steps, smallest)
            h[forbidden] = np.inf
        return GoalBounds(cost, h, exact, frozenset(self.graph.occupied))

    def from_distance(self, search: SearchQuery) -> GoalBounds:
        """Those that the name of a heuristic tells, from the distance to the goal alone."""
        distance = distances(self.table.base_position, search.goal.target)
        h = search.estimate(distance, self.graph.max_step)
        h = np.where(self._goal_nodes(search.goal), 0.0, np.maximum(h, MIN_COST_OUTSIDE_GOAL))
        h[self._occupied_nodes()] = np.inf
        none = np.zeros(len(h), dtype=np.bool_)
        return GoalBounds(search.goal.cost, h, none, frozenset(self.graph.occupied))

    def is_connected(self, goal: Goal, start: State) -> bool:
        """Whether a goal may be reached from a state, whatever steps and obstacles there are."""
        goals = self._goal_nodes(goal)
        if isinstance(self.graph, PairGraph) and start.pose is None:
            _, part = connected_parts(self.graph.points, len(self.graph.grasp_map))
            return bool((part[goals] == part[self.graph.find(start.stance)]).any())
        return bool(goals.any())

    def _occupied_nodes(self) -> BoolArray:
        """Nodes that hold an occupied point, shape (n,)."""
        if not self.graph.occupied:
            return np.zeros(len(self.table.points), dtype=np.bool_)
        held = np.isin(self.table.points, list(self.graph.occupied))
        return np.asarray(held.any(axis=1))

    def _goal_nodes(self, goal: Goal) -> BoolArray:
        """Nodes that may be at the goal, shape (n,)."""
        reach, goals = (
            goal.tolerance + self._position_error,
            np.zeros(len(self.table.points), np.bool_),
        )
        rows = rows_close(self.table.base_position, goal.target, goal.target, reach)
        goals[rows] = goal.on_goal_face(self.table.points[rows].astype(np.int64))
        return goals

    def _start_bounds(self, cost: Cost, starts: IntArray, forbidden: BoolArray) -> Array:
        """Lower bounds of the cost from where walks begin, infinite for what is taken."""
        table, count = self.table, len(self.table.points)
        if len(starts) > MAX_STARTS:
            return np.where(forbidden, np.inf, 0.0)
        squared_distance: Array = np.full(count, np.inf)
        for place in table.base_position[starts]:
            offset = table.base_position - place
            np.minimum(
                squared_distance, np.einsum("ij,ij->i", offset, offset), out=squared_distance
            )
        start_bounds = cost.base_weight * np.sqrt(squared_distance)
        if cost.step_weight:
            # What joins two nodes leads there and back.
            is_start, no_starts = np.zeros(count, dtype=np.bool_), np.zeros(0, dtype=np.int64)
            is_start[starts] = True
            steps, _ = fewest_steps(table, is_start, forbidden, no_starts, MAX_STEPS)
            start_bounds += cost.step_weight * np.where(steps >= 0, steps, np.inf)
        start_bounds[forbidden] = np.inf
        return start_bounds
