"""The searches of a planner: over a table, from state to state where there is none, Algorithm 1."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from mlivr_gym.planners.algorithm1 import algorithm1
from mlivr_gym.planners.building import finished
from mlivr_gym.planners.lazy_search import lazy_search
from mlivr_gym.planners.lower_bounds import LowerBounds
from mlivr_gym.planners.outcome import LIMIT, Path, chain_to, tree_of
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.planners.table_search import search_table
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_table_file import node_table
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_files import key_of
from mlivr_gym.transitions.state import State


class Searcher(Protocol):
    """A search over one stance graph."""

    def find(self, search: SearchQuery, first: State) -> Path | None:
        """Search from a state; None if the goal is not connected with it by any moves."""


class GraphSearcher:
    """The search of any number of limbs."""

    def __init__(self, graph: StanceGraph, *, work_out: bool = True) -> None:
        """Search `graph`.

        Parameters
        ----------
        graph
            The stance graph.
        work_out
            Whether its sets of points are worked out first where they are not known.
        """
        self.graph, self.work_out = graph, work_out
        self._bounds: LowerBounds | None = None

    def bounds(self) -> LowerBounds | None:
        """Lower bounds over the table of the graph; None where it has none."""
        table = self.graph.table
        if table is not None and (self._bounds is None or self._bounds.table is not table):
            self._bounds = LowerBounds(self.graph)
        return self._bounds

    def find(self, search: SearchQuery, first: State) -> Path | None:
        """See `Searcher.find`."""
        graph = self.graph
        if isinstance(graph, LazyGraph) and not self._ready(graph, search):
            return Path(LIMIT, (first,), 0.0, 0, 0, np.zeros((0, 2, 3)))
        bounds = self.bounds()
        if bounds is not None and (search.guided or not isinstance(graph, LazyGraph)):
            return search_table(bounds, search, first)
        assert isinstance(graph, LazyGraph)
        return lazy_search(graph, first, search)

    def _ready(self, graph: LazyGraph, search: SearchQuery) -> bool:
        """Whether what is worked out once for the graph is there before the time is over."""
        key = key_of(graph)
        if search.guided:
            if not finished(("nodes", key), lambda: node_table(graph), search.until):
                return False
            node_table(graph)
        if graph.table is not None:
            return True
        work_out = self.work_out
        return finished(("sets", key), lambda: graph.sets(work_out=work_out), search.until)


class Algorithm1Searcher:
    """Algorithm 1 in plain Python."""

    def __init__(self, graph: StanceGraph) -> None:
        """Search `graph`."""
        self.graph = graph

    def find(self, search: SearchQuery, first: State) -> Path | None:
        """See `Searcher.find`."""
        found = algorithm1(
            self.graph,
            first,
            search.goal,
            search.heuristic,
            inflation=search.inflation,
            limit=search.limit,
            progress=search.progress,
        )
        states = tuple(found.states[k] for k in chain_to(found.parents))
        tree = tree_of(np.array(found.positions), found.parents)
        counts = len(found.states), found.generated
        return Path(found.status, states, found.costs[-1], *counts, tree, bound=search.guarantee)
