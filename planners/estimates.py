"""What a search for two limbs knows of the cost to a goal: lower bounds for all stances, kept."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.kinematics.batches import distances
from mlivr_gym.planners.cost_to_go import backward
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.pair_search import weights_of
from mlivr_gym.planners.query import Goal
from mlivr_gym.planners.unchecked import distance_to_goal, steps_to_goal
from mlivr_gym.stances.pair_graph import PairGraph

CACHED_TABLES = 16
"""Cost-to-go tables a planner keeps."""


class Region(NamedTuple):
    """A goal region on a graph of n stances."""

    distance: Array
    """Distance of each stance's base from the goal [m], shape (n,)."""
    goal: BoolArray
    """Which stances are goals, shape (n,)."""
    parts: frozenset[int]
    """Connected parts of the graph in which they lie."""


class Estimates:
    """Goal regions and lower bounds of the cost to them, the last `CACHED_TABLES` of each.

    Attributes:
        graph: The stance graph.
        expanded: Stances that searches backward have expanded so far.
    """

    def __init__(self, graph: PairGraph) -> None:
        """Know nothing yet of `graph`."""
        self.graph, self.expanded = graph, 0
        self._regions: OrderedDict[tuple[Any, ...], Region] = OrderedDict()
        self._relaxed: OrderedDict[tuple[Any, ...], Array] = OrderedDict()

    def region(self, goal: Goal) -> Region:
        """The region of a goal; kept."""
        graph, key = self.graph, goal.key[:-1]
        if key not in self._regions:
            distance = distances(graph.base_in_world, goal.target)
            reached = (distance <= goal.tolerance) & goal.held(graph.points)
            parts = frozenset(graph.components[1][reached].tolist())
            self._regions[key] = Region(distance, reached, parts)
            if len(self._regions) > CACHED_TABLES:
                self._regions.popitem(last=False)
        return self._regions[key]

    def table(self, goal: Goal, start: int) -> Array:
        """Lower bound of the cost to the goal, shape (n,).

        It is exact when steps are not checked, where the search backward got to. `start` is where
        plans begin, -1 for anywhere. The table is kept if it covers all stances: it stays a lower
        bound when obstacles come, since they only take steps away.
        """
        graph, key, cost = self.graph, goal.key, goal.cost
        if key in self._relaxed:
            self._relaxed.move_to_end(key)
            return self._relaxed[key]
        region = self.region(goal)
        if cost.base_weight == 0.0 or start < 0:
            return self.keep(goal, self._counted(unchecked(graph, region.goal, cost)))
        away = distances(graph.base_in_world, graph.base_in_world[start])
        toward = cost.heuristic("consistent", away, 0.0, graph.max_step)
        table = self._counted(unchecked(graph, region.goal, cost, start, toward))
        # Stances that the backward search did not reach cost at least what it had got to.
        rest = np.isinf(table)
        bound = cost.heuristic("consistent", region.distance, goal.tolerance, graph.max_step)
        table[rest] = np.maximum(bound, table[start] - toward)[rest]
        return table

    def _counted(self, table: Array) -> Array:
        """Costs that a search backward has found, which are counted."""
        self.expanded += int(np.isfinite(table).sum())
        return table

    def keep(self, goal: Goal, table: Array) -> Array:
        """Keep a table of all stances; not one made among obstacles, which would not hold later."""
        if not (self.graph.occupied or self.graph.obstacles):
            self._relaxed[goal.key] = table
            if len(self._relaxed) > CACHED_TABLES:
                self._relaxed.popitem(last=False)
        return table

    def learn(
        self, goal: Goal, start: int, origin: Array, h: Array, limit: int
    ) -> tuple[Array, Array]:
        """Two lower bounds closer than `h`, from a search backward that checks steps.

        The first holds for plans from stance `start`, whose base is at `origin` [m], the second
        from anywhere. For a robot that stands in a given pose, or may be on some of its branches
        only, `start` is -1. The search is led by the straight line to the start, which with a
        price on displacements takes less than to work the cost from there out.

        Args:
            goal: The goal.
            start: Index of the start stance, or -1.
            origin: Base position at the start [m], shape (3,).
            h: Lower bound so far, shape (n,).
            limit: Most entries that the search takes from its queue.
        """
        graph, n, cost = self.graph, len(self.graph), goal.cost
        away = distances(graph.base_in_world, origin)
        if start < 0:
            toward = cost.base_weight * away
        elif cost.base_weight:
            toward = cost.heuristic("consistent", away, 0.0, graph.max_step)
        else:
            toward = self._counted(unchecked(graph, np.arange(n) == start, cost))
        reached = self.region(goal).goal
        weights = weights_of(cost, limit=limit)
        value, bound, arrived = backward(graph, reached, weights, start, toward)
        exact = self._counted(np.where(reached, 0.0, value.min(axis=(1, 2))))
        with np.errstate(invalid="ignore"):
            closer = np.fmax(h, np.fmin(exact, bound - toward))
        # The search got to every stance of an optimal plan if it arrived.
        return np.fmax(h, exact) if arrived else closer, closer


def unchecked(
    graph: PairGraph,
    goal: BoolArray,
    cost: Cost,
    start: int = -1,
    toward: Array | None = None,
) -> Array:
    """Cost from each stance to the nearest goal stance when steps are not checked, shape (n,).

    With a start and lower bounds of the cost from there, `toward`, the search ends there and leaves
    the rest at infinity.
    """
    n, table = len(graph), np.full(len(graph), np.inf)
    if cost.base_weight == 0.0:
        opened = np.zeros(graph.degree.shape, dtype=np.bool_)
        steps_to_goal(goal, graph.steps, table, opened, np.empty(n, dtype=np.int64))
        return table * cost.step_weight
    return distance_to_goal(graph, goal, weights_of(cost), start, toward)
