"""The searches of a planner: over a table, over an implicit graph, and Algorithm 1.

`GraphSearcher` chooses by graph and query, see the table in `docs/how-a-plan-is-made.md`. The graph
of two limbs always has a node table, one of three or four limbs has it if one ships or was built;
any other graph is searched without.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.planners.algorithm1 import algorithm1
from mlivr_gym.planners.building import result_by_deadline
from mlivr_gym.planners.clock import OutOfTime
from mlivr_gym.planners.implicit_search import ImplicitSearch
from mlivr_gym.planners.lower_bounds import LowerBounds
from mlivr_gym.planners.outcome import (
    GOAL_REACHED,
    LIMIT_REACHED,
    SEARCH_EXHAUSTED,
    Improvement,
    SearchResult,
)
from mlivr_gym.planners.path_search import PathSearch, StatePath
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.planners.table_search import TableSearch
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_build import stored_table
from mlivr_gym.stances.table_files import key_of
from mlivr_gym.transitions.state import State

FEW_STEPS = 4
"""Number of steps for which time is left until a path is found."""


def path_along(
    graph: StanceGraph,
    start: State,
    stances: Sequence[tuple[int, ...]],
    cost_of: Callable[[Array], float],
) -> SearchResult | None:
    """Return the path from a state over stances to a goal; None if a step of it is not possible.

    `cost_of` tells the cost of base positions, shape (k + 1, 3) [m].
    """
    states = graph.states_along(start, stances)
    if len(states) <= len(stances):
        return None
    cost = cost_of(graph.postures_of(states).base_position)
    return SearchResult(GOAL_REACHED, states, cost)


class GraphSearcher:
    """The searches of one stance graph; see the module for which."""

    def __init__(self, graph: StanceGraph) -> None:
        """Prepare to search a graph."""
        self.graph = graph
        self._lower_bounds: LowerBounds | None = None

    def lower_bounds(self) -> LowerBounds | None:
        """Return the lower bounds over the table of the graph, or None if it has no table."""
        table = self.graph.table
        if table is not None and (
            self._lower_bounds is None or self._lower_bounds.table is not table
        ):
            self._lower_bounds = LowerBounds(self.graph)
        return self._lower_bounds

    def find(
        self, search: SearchQuery, start: State, step_time: float = 0.0
    ) -> SearchResult | None:
        """Search from a state; return None if no sequence of moves connects it with the goal.

        A move changes the point of one limb, whether or not a step can make it. Of a time limit,
        `step_time` is left for each step of the plan [s].
        """
        search.clock.leave(FEW_STEPS * step_time)
        try:
            return self._find(search, start, step_time)
        except OutOfTime:
            return SearchResult(LIMIT_REACHED, (start,))

    def _find(self, search: SearchQuery, start: State, step_time: float) -> SearchResult | None:
        """Search as `find` does; raise `OutOfTime` if the time is over before a search begins."""
        graph = self.graph
        if search.method == "algorithm1":
            return _find_by_algorithm1(graph, search, start)
        if graph.table is None:
            # A thread finds it, which would wait for the lock of the graph.
            deadline = search.clock.deadline
            stored = result_by_deadline(
                ("nodes", key_of(graph)), lambda: stored_table(graph), deadline
            )
            if stored is not None:
                graph.graph_table = stored[1]
        lower_bounds = self.lower_bounds()
        if lower_bounds is not None:
            return run_search(TableSearch(lower_bounds, search, start), step_time)
        return run_search(ImplicitSearch(graph, search, start), step_time)


def run_search(path_search: PathSearch, step_time: float = 0.0) -> SearchResult | None:
    """Search until a path is proved good enough, a limit is reached, or no path is left.

    Each path becomes the incumbent; of a time limit, `step_time` is left for each of its steps [s].
    Returns None if no sequence of moves leads to the goal.
    """
    search, start = path_search.search, path_search.start
    if path_search.starts_at_goal:
        return SearchResult(GOAL_REACHED, (start,), 0.0, 1, 1, bound=1.0)
    incumbent: StatePath | None = None
    improvements = []
    for path in path_search.paths():
        incumbent = path
        search.clock.leave((len(path.states) - 1) * step_time)
        elapsed, bound = time.perf_counter() - search.start_time, path_search.bound()
        improvements.append(Improvement(elapsed, path_search.incumbent_cost, bound))
        if bound <= search.inflation:
            break
    tree, backward_expanded = path_search.tree(), path_search.backward_expanded
    counts = path_search.expanded, path_search.generated, tree, backward_expanded
    if incumbent is None:
        none_exists = path_search.lower_bound == np.inf
        if none_exists and not path_search.is_connected():
            return None
        status = SEARCH_EXHAUSTED if none_exists else LIMIT_REACHED
        return SearchResult(status, (start,), 0.0, *counts)
    cost, bound = path_search.incumbent_cost, path_search.bound()
    return SearchResult(GOAL_REACHED, incumbent.states, cost, *counts, bound, tuple(improvements))


def _find_by_algorithm1(graph: StanceGraph, search: SearchQuery, start: State) -> SearchResult:
    """Search from a state by Algorithm 1 of the paper in plain Python."""
    outcome = algorithm1(
        graph, start, search.goal, search.heuristic,
        inflation=search.inflation, limit=search.limit, progress=search.progress,
    )  # fmt: skip
    path = [len(outcome.states) - 1]
    while outcome.parents[path[-1]] >= 0:
        path.append(outcome.parents[path[-1]])
    states, positions = tuple(outcome.states[k] for k in path[::-1]), np.array(outcome.positions)
    tree = np.stack([positions[outcome.parents[1:]], positions[1:]], axis=1)
    counts = len(outcome.states), outcome.generated
    return SearchResult(
        outcome.status, states, outcome.costs[-1], *counts, tree, bound=search.guaranteed_bound
    )
