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
from mlivr_gym.planners.backward_search import LEAST, costs_to_goal
from mlivr_gym.planners.costs import Cost, weights_of
from mlivr_gym.planners.fewest_steps import fewest_steps
from mlivr_gym.planners.label_search import Labels
from mlivr_gym.planners.lazy_table import LazyTable, lazy_table_of
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.stances.node_table import ROUNDED, NodeTable
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.pair_rows import connected_parts
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

FARTHER_BY = (0.03, 2)
"""How much farther than to the start they are worked out with more than two limbs, for starts of
further plans: a share of the cost, and steps."""

FARTHEST = 1 << 14
"""More steps than any node is away."""

MOST_STARTS = 1000
"""With more starts than this the search backward is led to none of them."""

KEPT = 4, 16
"""Goals, or costs to one, that are kept at least and at most."""

KEPT_NODES = 2_000_000
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
        self.labels = Labels.of(len(table.points))
        """Room for searches."""
        self._world: LazyTable | None = None
        self._kept: OrderedDict[tuple[Any, ...], GoalBounds] = OrderedDict()
        least, most = KEPT
        self._most = max(least, min(most, KEPT_NODES // max(len(table.points), 1)))
        self._rounded = 0.0 if graph.has_tables else 2.0 * ROUNDED
        self._farther = (0.0, 0) if graph.has_tables else FARTHER_BY

    @property
    def world(self) -> LazyTable:
        """The nodes in the world as it is now, with what was found of them before."""
        if self._world is None or self._world.version != self.graph.version:
            self._world = lazy_table_of(self.graph)
        assert self._world is not None
        return self._world

    def known(self, goal: Goal, starts: IntArray) -> GoalBounds | None:
        """What is kept that serves from some nodes; None if nothing does."""
        kept, occupied = self._kept.get(goal.key), frozenset(self.graph.occupied)
        if kept is None or not (kept.occupied <= occupied and kept.exact[starts].all()):
            return None
        if kept.occupied == occupied:
            return kept
        return kept._replace(h=np.where(self._taken(), np.inf, kept.h))

    def to(self, goal: Goal, starts: IntArray) -> GoalBounds:
        """Bounds from some nodes with the points that are taken now; kept."""
        bounds = self._worked_out(self.table, goal, starts, self._taken())
        self._kept[goal.key] = bounds
        self._kept.move_to_end(goal.key)
        if len(self._kept) > self._most:
            self._kept.popitem(last=False)
        return bounds

    def _worked_out(
        self, table: NodeTable, goal: Goal, starts: IntArray, taken: BoolArray
    ) -> GoalBounds:
        """Bounds from some nodes where walks do not enter some that are taken."""
        cost, goals = goal.cost, self._goals(goal)
        if cost.base_weight:
            farther = self._farther[0], self._farther[1] * cost.step_weight
            toward = self._toward(cost, starts, taken)
            h, exact = costs_to_goal(table, goals, weights_of(cost), starts, toward, farther)
        else:
            steps, least = fewest_steps(table, goals, taken, starts, self._farther[1])
            exact = steps >= 0
            h = cost.step_weight * np.where(exact, steps, least)
            h[taken] = np.inf
        return GoalBounds(cost, h, exact, frozenset(self.graph.occupied))

    def by_distance(self, search: SearchQuery) -> GoalBounds:
        """Those that the name of a heuristic tells, from the distance to the goal alone."""
        distance = distances(self.table.base_position, search.goal.target)
        h = search.estimate(distance, self.graph.max_step)
        h = np.where(self._goals(search.goal), 0.0, np.maximum(h, LEAST))
        h[self._taken()] = np.inf
        none = np.zeros(len(h), dtype=np.bool_)
        return GoalBounds(search.goal.cost, h, none, frozenset(self.graph.occupied))

    def connected(self, goal: Goal, start: State) -> bool:
        """Whether a goal may be reached from a state, whatever steps and obstacles there are."""
        goals = self._goals(goal)
        if isinstance(self.graph, PairGraph) and start.pose is None:
            _, part = connected_parts(self.graph.points, len(self.graph.grasp_map))
            return bool((part[goals] == part[self.graph.find(start.stance)]).any())
        return bool(goals.any())

    def _taken(self) -> BoolArray:
        """Nodes that hold an occupied point, shape (n,)."""
        if not self.graph.occupied:
            return np.zeros(len(self.table.points), dtype=np.bool_)
        held = np.isin(self.table.points, list(self.graph.occupied))
        return np.asarray(held.any(axis=1))

    def _goals(self, goal: Goal) -> BoolArray:
        """Nodes that may be at the goal, shape (n,)."""
        reach, goals = goal.tolerance + self._rounded, np.zeros(len(self.table.points), np.bool_)
        rows = rows_close(self.table.base_position, goal.target, goal.target, reach)
        goals[rows] = goal.held(self.table.points[rows].astype(np.int64))
        return goals

    def _toward(self, cost: Cost, starts: IntArray, taken: BoolArray) -> Array:
        """Lower bounds of the cost from where walks begin, infinite for what is taken."""
        table, count = self.table, len(self.table.points)
        if len(starts) > MOST_STARTS:
            return np.where(taken, np.inf, 0.0)
        nearest: Array = np.full(count, np.inf)
        for place in table.base_position[starts]:
            away = table.base_position - place
            np.minimum(nearest, np.einsum("ij,ij->i", away, away), out=nearest)
        toward = cost.base_weight * np.sqrt(nearest)
        if cost.step_weight:
            # What joins two nodes leads there and back.
            begins, nowhere = np.zeros(count, dtype=np.bool_), np.zeros(0, dtype=np.int64)
            begins[starts] = True
            steps, _ = fewest_steps(table, begins, taken, nowhere, FARTHEST)
            toward += cost.step_weight * np.where(steps >= 0, steps, np.inf)
        toward[taken] = np.inf
        return toward
