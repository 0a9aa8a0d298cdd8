"""What a search for two limbs knows of the cost to a goal: lower bounds for all stances, kept and brought nearer to the truth."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.planners.cost_to_go import backward
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.pair_search import distance_to_goal, steps_to_goal
from mlivr_gym.stances.pair_graph import PairGraph

Array = NDArray[np.float64]
_Region = tuple[Array, NDArray[np.bool_], frozenset[int]]

CACHED_TABLES = 16
"""Cost-to-go tables a planner keeps."""


class Estimates:
    """Goal regions and lower bounds of the cost to them on one stance graph, the last `CACHED_TABLES` of each.

    Attributes:
        graph: The stance graph.
    """

    def __init__(self, graph: PairGraph) -> None:
        """Know nothing yet of `graph`."""
        self.graph = graph
        self._regions: OrderedDict[tuple[Any, ...], _Region] = OrderedDict()
        self._relaxed: OrderedDict[tuple[Any, ...], Array] = OrderedDict()

    def has(self, key: tuple[Any, ...]) -> bool:
        """Whether bounds are kept for goal, tolerance and cost."""
        return key in self._relaxed

    def region(self, target: Array, tolerance: float) -> _Region:
        """Distance of each stance to the goal [m], which are goals, and the connected parts they lie in; kept."""
        graph, key = self.graph, (*target.tolist(), tolerance)
        if key not in self._regions:
            distance = _distances(graph.position, target)
            goal = distance <= tolerance
            self._regions[key] = distance, goal, frozenset(graph.components[1][goal].tolist())
            if len(self._regions) > CACHED_TABLES:
                self._regions.popitem(last=False)
        return self._regions[key]

    def table(self, target: Array, tolerance: float, cost: Cost, start: int) -> Array:
        """Lower bound of the cost to the goal, exact when steps are not checked where it was settled, shape (n,).

        `start` is where plans begin, -1 for anywhere. The table is kept if it covers all stances:
        it stays a lower bound when obstacles come, since they only take steps away.
        """
        graph, key = self.graph, (*target.tolist(), tolerance, cost)
        if key in self._relaxed:
            self._relaxed.move_to_end(key)
            return self._relaxed[key]
        distance, goal, _ = self.region(target, tolerance)
        if cost.base_weight == 0.0 or start < 0:
            return self.keep(key, unchecked(graph, goal, cost))
        toward = cost.heuristic(
            "consistent", _distances(graph.position, graph.position[start]), 0.0, graph.max_step
        )
        table = unchecked(graph, goal, cost, start, toward)
        # Stances that the backward search left out cost at least what it had reached.
        rest = np.isinf(table)
        bound = cost.heuristic("consistent", distance, tolerance, graph.max_step)
        table[rest] = np.maximum(bound, table[start] - toward)[rest]
        return table

    def keep(self, key: tuple[Any, ...], table: Array) -> Array:
        """Keep a table of all stances, but for one made among obstacles: once they are gone it would not hold."""
        if not (self.graph.occupied or self.graph.obstacles):
            self._relaxed[key] = table
            if len(self._relaxed) > CACHED_TABLES:
                self._relaxed.popitem(last=False)
        return table

    def learn(
        self,
        goal: NDArray[np.bool_],
        cost: Cost,
        start: int,
        origin: Array,
        h: Array,
        limit: int,
        learnt: bool,
    ) -> tuple[Array, Array]:
        """Two lower bounds closer than `h`, from a search backward from the goal that checks steps, of at most `limit` entries.

        The first holds for plans from stance `start`, whose base is at `origin` [m], the second
        from anywhere. A robot that stands in a pose of its own is at no stance, `start` is -1.
        Where `h` was `learnt` before and obstacles came, little is to be mended, and the straight
        way to the start is estimate enough; else the cost from there is worked out.
        """
        graph, n = self.graph, len(self.graph)
        value = np.full((n, 2, 16), np.inf)
        if start < 0:
            away = cost.base_weight * _distances(graph.position, origin)
        elif learnt and cost.base_weight:
            away = cost.heuristic(
                "consistent", _distances(graph.position, origin), 0.0, graph.max_step
            )
        else:
            away = unchecked(graph, np.arange(n) == start, cost)
        bound, arrived = backward(
            goal, start, away, cost.base_weight, cost.step_weight, limit, True, graph.rows,
            graph.row_start,
            graph.row_position, graph.edges, value, np.zeros((n, 2, 2), dtype=np.int64),
            np.full((n, 2, 16), np.inf),
        )  # fmt: skip
        exact = np.where(goal, 0.0, value.min(axis=(1, 2)))
        with np.errstate(invalid="ignore"):
            closer = np.fmax(h, np.fmin(exact, bound - away))
        # Every stance of an optimal plan was settled if the search arrived.
        return np.fmax(h, exact) if arrived else closer, closer


def unchecked(
    graph: PairGraph,
    goal: NDArray[np.bool_],
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
        steps_to_goal(goal, graph.rows, graph.row_start, graph.points, graph.mask, table, opened)
        return table * cost.step_weight
    distance_to_goal(
        goal, start, np.zeros(n) if toward is None else toward, cost.base_weight, cost.step_weight,
        graph.rows,
        graph.row_start, graph.points, graph.position, graph.row_position, graph.mask,
        np.full(n, np.inf), table,
        np.full(n, -1),
    )  # fmt: skip
    return table


def _distances(positions: Array, point: Array) -> Array:
    """Distances of positions, shape (n, 3), from a point [m]; quicker than `np.linalg.norm` over an axis."""
    away = positions - point
    return np.sqrt(np.einsum("ij,ij->i", away, away))
