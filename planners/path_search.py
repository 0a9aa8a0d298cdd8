"""The interface of searches of a stance graph: paths, a lower bound, and the optimality bound.

`table_search` and `implicit_search` have it, and `searches` runs them.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.planners.clock import OutOfTime
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

COST_TOLERANCE = 1e-9
"""Relative tolerance of costs: a path must be cheaper by more than this to replace another."""


class StatePath(NamedTuple):
    """A path over states of the present world."""

    states: tuple[State, ...]
    """k + 1 states."""
    positions: Array
    """Base position of each state [m], shape (k + 1, 3)."""


class PathSearch(ABC):
    """A search in progress.

    Attributes
    ----------
    lower_bound
        Lower bound of the cost of every plan that is not found yet; infinite if it is proved that
        there is none.
    incumbent_cost
        Cost of the cheapest path so far, infinite if there is none.
    expanded, generated
        Number of states expanded and generated.
    backward_expanded
        Number of nodes that backward searches settled, and labels that they expanded, to compute
        the lower bounds; they count for no limit.
    starts_at_goal
        Whether the start is at the goal.
    """

    def __init__(self, graph: StanceGraph, search: SearchQuery, start: State) -> None:
        """Prepare a search from a state."""
        self.graph, self.search, self.goal, self.start = graph, search, search.goal, start
        self.clock = search.clock
        self.lower_bound, self.incumbent_cost = 0.0, np.inf
        self.expanded = self.generated = self.backward_expanded = 0
        self.start_posture = graph.posture_of(start)
        position = self.start_posture.base_position[0]
        self.starts_at_goal = bool(self.goal.reached(position, start.stance))

    def paths(self) -> Iterator[StatePath]:
        """Yield paths to the goal, each cheaper than the one before, until the search ends."""
        with suppress(OutOfTime):
            yield from self._paths()

    @abstractmethod
    def _paths(self) -> Iterator[StatePath]:
        """Yield these paths; raise `OutOfTime` at the deadline."""

    @abstractmethod
    def is_connected(self) -> bool:
        """Return whether moves may connect the start with the goal, whatever the obstacles are."""

    @abstractmethod
    def tree(self) -> Array:
        """Return base positions at both ends of explored edges, shape (e, 2, 3) [m]."""

    @property
    def is_late(self) -> bool:
        """Whether the time or the effort of the query is spent."""
        return self.effort >= self.search.effort or self.clock.is_over

    @property
    @abstractmethod
    def effort(self) -> int:
        """The effort so far: expansions, and `EDGE_EFFORT` and `NODE_EFFORT` for each check."""

    @property
    def has_path(self) -> bool:
        """Whether a path was found."""
        return self.incumbent_cost < np.inf

    def cost(self, path: StatePath) -> float:
        """Return the cost of a path."""
        return self.goal.cost.of_path(path.positions, [state.stance for state in path.states])

    def bound(self) -> float:
        """Return the factor of the minimum within which the incumbent is proved."""
        if self.incumbent_cost <= self.lower_bound * (1.0 + COST_TOLERANCE):
            return 1.0
        return self.incumbent_cost / self.lower_bound if self.lower_bound > 0.0 else math.inf
