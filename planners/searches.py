"""The searches of a planner: over a table, by levels, over an implicit graph, and Algorithm 1.

`GraphSearcher` chooses by graph and query, see the table in `docs/how-a-plan-is-made.md`. The graph
of two limbs always has a node table, one of three or four limbs has it if one ships or was built;
any other graph is searched without.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.planners.algorithm1 import algorithm1
from mlivr_gym.planners.building import result_by_deadline
from mlivr_gym.planners.clock import OutOfTime
from mlivr_gym.planners.implicit_search import ImplicitSearch
from mlivr_gym.planners.level_search import LevelSearch
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
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_build import find_table
from mlivr_gym.stances.table_files import key_of
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.transitions.state import State

FEW_EXPANSIONS = 250
"""Expansions after which fewest steps of two limbs among obstacles are searched for by levels: if
the limbs are on other branches than those on which the way is short, the bounds of `table_search`,
which know no branches, leave most of the graph to be expanded."""


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
    return SearchResult(GOAL_REACHED, states, cost, 0, 0, np.zeros((0, 2, 3)))


class FollowedPath(NamedTuple):
    """A path of minimum cost, and the world in which it was found."""

    states: tuple[State, ...]
    """Its states."""
    goal: tuple[Any, ...]
    """Key of its goal."""
    version: int
    """Version of the world, see `ChangingWorld.version`."""

    def remainder(
        self, graph: StanceGraph, search: SearchQuery, start: State
    ) -> SearchResult | None:
        """Return what remains of the path from a state on it, None if it cannot be followed.

        It has minimum cost unless a limb that can no longer fold may be released on another branch
        instead, see `has_lost_only`; `TableSearch.proves` may rule that out, too.
        """
        place = next((k for k, state in enumerate(self.states) if _includes(state, start)), None)
        is_valid = search.goal.key == self.goal and graph.has_all_since(self.version)
        if place is None or not is_valid:
            return None
        stances = [after.stance for after in self.states[place + 1 :]]
        found = path_along(graph, start, stances, search.goal.cost.of_path)
        return found and replace(found, bound=1.0)

    def has_lost_only(self, graph: StanceGraph) -> bool:
        """Return whether the graph has lost steps since at most, of all that were known then."""
        is_next = graph.version == self.version + 1 and not graph.has_gained
        return graph.version == self.version or is_next


def _includes(state: State, other: State) -> bool:
    """Return whether a robot in the other state is in a state as well."""
    branch_sets = zip(state.branch_sets, other.branch_sets, strict=True)
    same = state.stance == other.stance and state.pose == other.pose
    return same and all(one & both == both for one, both in branch_sets)


class GraphSearcher:
    """The searches of one stance graph; see the module for which."""

    def __init__(self, graph: StanceGraph, *, build_sets: bool = True) -> None:
        """Prepare to search a graph; stance sets are built if not cached and `build_sets`."""
        self.graph, self.build_sets = graph, build_sets
        self._lower_bounds: LowerBounds | None = None
        self._followed: FollowedPath | None = None

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
        try:
            return self._find(search, start)
        except OutOfTime:
            return _nothing_found(start)

    def _find(self, search: SearchQuery, start: State) -> SearchResult | None:
        """Search as `find` does; raise `OutOfTime` if the time is over before a search begins."""
        graph = self.graph
        if search.method == "algorithm1":
            return _find_by_algorithm1(graph, search, start)
        if isinstance(graph, ImplicitGraph):
            self._prepare_tables(graph, search)
        if isinstance(graph, TwoLimbGraph) and LevelSearch.answers(graph, search):
            return run_search(LevelSearch(graph, search, start))
        lower_bounds = self.lower_bounds()
        if lower_bounds is not None:
            found, followed, first = None, self._followed, search
            if isinstance(graph, TwoLimbGraph) and LevelSearch.may_follow(graph, search):
                first = replace(search, limit=min(search.limit, FEW_EXPANSIONS))
            table_search = TableSearch(lower_bounds, first, start)
            if graph.obstacles and search.heuristic == "relaxed" and followed is not None:
                found = followed.remainder(graph, search, start)
            is_cheapest = (
                found is not None
                and followed is not None
                and (table_search.proves(found.cost) or followed.has_lost_only(graph))
            )
            if not is_cheapest:
                found = run_search(table_search)
                is_cut = found is not None and found.status == LIMIT_REACHED
                if is_cut and first.limit < search.limit and not table_search.is_late:
                    rest = replace(search, effort=search.effort - table_search.effort)
                    found = self._continued(lower_bounds, rest, start)
            if found is not None and found.bound == 1.0:
                self._followed = FollowedPath(found.states, search.goal.key, graph.version)
            return found
        assert isinstance(graph, ImplicitGraph)
        return run_search(ImplicitSearch(graph, search, start))

    def _continued(
        self, lower_bounds: LowerBounds, search: SearchQuery, start: State
    ) -> SearchResult | None:
        """Search for fewest steps by levels, unless the bounds show that the goal is cut off.

        They do if all stances are checked.
        """
        assert isinstance(self.graph, TwoLimbGraph)
        lower_bounds.lazy_table.check_nodes(np.arange(len(self.graph)), search.clock)
        table_search = TableSearch(lower_bounds, search, start)
        if table_search.proves(np.inf):
            return run_search(table_search)
        return run_search(LevelSearch(self.graph, search, start))

    def _prepare_tables(self, graph: ImplicitGraph, search: SearchQuery) -> None:
        """Build the tables that a search needs; raise `OutOfTime` if they take longer than it may.

        They are still being built then.
        """
        if graph.table is not None:
            return
        key, deadline = key_of(graph), search.clock.deadline
        result_by_deadline(("nodes", key), lambda: find_table(graph), deadline)
        needs_sets = self.build_sets and graph.searches_sets
        # An equal graph may have started the thread, which found the table for that one.
        if needs_sets and graph.table is None and find_table(graph) is None:
            result_by_deadline(("sets", key), graph.sets, deadline)


def _nothing_found(start: State) -> SearchResult:
    """Return the result of a search for which there was no time."""
    return SearchResult(LIMIT_REACHED, (start,), 0.0, 0, 0, np.zeros((0, 2, 3)))


def run_search(path_search: PathSearch) -> SearchResult | None:
    """Search until a path is proved good enough, a limit is reached, or no path is left.

    Each path becomes the incumbent. Returns None if no sequence of moves leads to the goal.
    """
    search, start = path_search.search, path_search.start
    if path_search.starts_at_goal:
        return SearchResult(GOAL_REACHED, (start,), 0.0, 1, 1, np.zeros((0, 2, 3)), bound=1.0)
    incumbent: StatePath | None = None
    improvements = []
    for path in path_search.paths():
        incumbent = path
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
    found = algorithm1(
        graph, start, search.goal, search.heuristic,
        inflation=search.inflation, limit=search.limit, progress=search.progress,
    )  # fmt: skip
    path = [len(found.states) - 1]
    while found.parents[path[-1]] >= 0:
        path.append(found.parents[path[-1]])
    states, positions = tuple(found.states[k] for k in path[::-1]), np.array(found.positions)
    tree = np.stack([positions[found.parents[1:]], positions[1:]], axis=1)
    counts = len(found.states), found.generated
    return SearchResult(
        found.status, states, found.costs[-1], *counts, tree, bound=search.guaranteed_bound
    )
