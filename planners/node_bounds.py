"""What is left at least from every node of many limbs to a goal, kept for further plans there.

Points that are taken later only make plans dearer. So what was worked out for a goal serves when
the robot stands elsewhere on its way, or finds a point occupied, and a plan is there at once.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.node_costs import costs_to_goal
from mlivr_gym.planners.node_levels import fewest_steps
from mlivr_gym.planners.node_obstacles import NodesAmongObstacles
from mlivr_gym.planners.pair_search import weights_of
from mlivr_gym.planners.query import Goal
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_table import ROUNDED, NodeTable

FARTHER_BY = (0.03, 2)
"""How much farther than to the start they are worked out: a share of the cost, and steps."""

FARTHEST = 1 << 14
"""More steps than any node is away."""

KEPT = 4
"""Goals, or costs to one, that are kept."""


class Bounds(NamedTuple):
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


class NodeBounds:
    """Lower bounds to the goals that were asked last."""

    def __init__(self, graph: LazyGraph, table: NodeTable) -> None:
        """Of a graph and all its nodes."""
        self.graph, self.table = graph, table
        self._world: NodesAmongObstacles | None = None
        self._kept: OrderedDict[tuple[Any, ...], Bounds] = OrderedDict()

    def world(self) -> NodesAmongObstacles:
        """The nodes among the present obstacles, with what was looked at before."""
        if self._world is None or self._world.version != self.graph.version:
            self._world = NodesAmongObstacles(self.graph, self.table)
        return self._world

    def known(self, goal: Goal, starts: IntArray) -> Bounds | None:
        """What is kept that serves from some nodes; None if nothing does."""
        kept, occupied = self._kept.get(goal.key), frozenset(self.graph.occupied)
        if kept is None or not (kept.occupied <= occupied and kept.exact[starts].all()):
            return None
        if kept.occupied == occupied:
            return kept
        return kept._replace(h=np.where(self._taken(), np.inf, kept.h))

    def to(self, goal: Goal, starts: IntArray) -> Bounds:
        """Bounds from some nodes with the points that are taken now."""
        table, cost, goals, taken = self.table, goal.cost, self._goals(goal), self._taken()
        if cost.base_weight:
            farther = FARTHER_BY[0], FARTHER_BY[1] * cost.step_weight
            toward = self._toward(cost, starts, taken)
            h, exact = costs_to_goal(table, goals, weights_of(cost), starts, toward, farther)
        else:
            steps, least = fewest_steps(table, goals, taken, starts, FARTHER_BY[1])
            exact = steps >= 0
            h = cost.step_weight * np.where(exact, steps, least)
            h[taken] = np.inf
        bounds = Bounds(cost, h, exact, frozenset(self.graph.occupied))
        self._kept[goal.key] = bounds
        self._kept.move_to_end(goal.key)
        if len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return bounds

    def _taken(self) -> BoolArray:
        """Nodes that hold an occupied point, shape (n,)."""
        if not self.graph.occupied:
            return np.zeros(len(self.table.points), dtype=np.bool_)
        held = np.isin(self.table.points, list(self.graph.occupied))
        return np.asarray(held.any(axis=1))

    def _goals(self, goal: Goal) -> BoolArray:
        """Nodes that may be at the goal, shape (n,)."""
        away = self.table.base_position - goal.target
        close = np.einsum("ij,ij->i", away, away) <= (goal.tolerance + 2.0 * ROUNDED) ** 2
        close[close] = goal.held(self.table.points[close])
        return np.asarray(close)

    def _toward(self, cost: Cost, starts: IntArray, taken: BoolArray) -> Array:
        """Lower bounds of the cost from where walks begin, infinite for what is taken."""
        table, count = self.table, len(self.table.points)
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
