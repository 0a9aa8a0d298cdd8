"""The searches of a planner: over a node table, over an implicit graph, and Algorithm 1.

`GraphSearcher` chooses by the graph, see the table in `docs/how-a-plan-is-made.md`. The graph of
two limbs always has a node table, one of three or four limbs has it if one ships or was built; any
other graph is searched without.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.planners.algorithm1 import algorithm1
from mlivr_gym.planners.building import complete_by_deadline
from mlivr_gym.planners.implicit_search import search_implicit_graph
from mlivr_gym.planners.lower_bounds import LowerBounds
from mlivr_gym.planners.outcome import LIMIT_REACHED, SearchResult, path_indices, search_tree
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.planners.table_search import search_table
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.stances.node_table_file import node_table
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_files import key_of
from mlivr_gym.transitions.state import State


class GraphSearcher:
    """The searches of one stance graph; see the module for which."""

    def __init__(self, graph: StanceGraph, *, build_sets: bool = True) -> None:
        """Prepare to search a graph; stance sets are built if not cached and `build_sets`."""
        self.graph, self.build_sets = graph, build_sets
        self._lower_bounds: LowerBounds | None = None

    def lower_bounds(self) -> LowerBounds | None:
        """Return the lower bounds over the table of the graph, or None if it has no table."""
        table = self.graph.table
        if table is not None and (
            self._lower_bounds is None or self._lower_bounds.table is not table
        ):
            self._lower_bounds = LowerBounds(self.graph)
        return self._lower_bounds

    def find(self, search: SearchQuery, start: State) -> SearchResult | None:
        """Search from a state; return None if no sequence of moves connects it with the goal.

        A move changes the point of one limb, whether or not a step can make it.
        """
        graph = self.graph
        if search.method == "algorithm1":
            return _find_by_algorithm1(graph, search, start)
        if isinstance(graph, ImplicitGraph) and not self._tables_are_ready(graph, search):
            return SearchResult(LIMIT_REACHED, (start,), 0.0, 0, 0, np.zeros((0, 2, 3)))
        lower_bounds = self.lower_bounds()
        if lower_bounds is not None:
            return search_table(lower_bounds, search, start)
        assert isinstance(graph, ImplicitGraph)
        return search_implicit_graph(graph, start, search)

    def _tables_are_ready(self, graph: ImplicitGraph, search: SearchQuery) -> bool:
        """Return whether the tables that a search needs are built before its deadline."""
        key = key_of(graph)
        if graph.table is None and not complete_by_deadline(
            ("nodes", key), lambda: node_table(graph), search.deadline
        ):
            return False
        if graph.table is not None or node_table(graph) is not None:
            return True
        build_sets = self.build_sets
        return complete_by_deadline(
            ("sets", key), lambda: graph.sets(build=build_sets), search.deadline
        )


def _find_by_algorithm1(graph: StanceGraph, search: SearchQuery, start: State) -> SearchResult:
    """Search from a state by Algorithm 1 of the paper in plain Python."""
    found = algorithm1(
        graph, start, search.goal, search.heuristic,
        inflation=search.inflation, limit=search.limit, progress=search.progress,
    )  # fmt: skip
    states = tuple(found.states[k] for k in path_indices(found.parents))
    tree = search_tree(np.array(found.positions), found.parents)
    counts = len(found.states), found.generated
    return SearchResult(
        found.status, states, found.costs[-1], *counts, tree, bound=search.guaranteed_bound
    )
