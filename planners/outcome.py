"""Results of searches over stances."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.transitions.state import State

GOAL_REACHED, SEARCH_EXHAUSTED, LIMIT_REACHED = "", "search exhausted", "limit reached"
"""How a search ends: at a goal, with an empty open queue, or at its limit of expansions or time.

The last two are reasons of a `PlanningResult` without a plan.
"""


@dataclass(frozen=True)
class Improvement:
    """A path that a search found before it ended, with the quality proved at that time."""

    time: float
    """Time from the start of the search [s]."""
    cost: float
    """Cost of the path."""
    bound: float
    """Optimality bound: the path was proved to cost at most this factor times the minimum; infinite
    if nothing was proved."""


@dataclass(frozen=True)
class SearchResult:
    """The path that a search found, with its statistics."""

    status: str
    """`GOAL_REACHED`, `SEARCH_EXHAUSTED` or `LIMIT_REACHED`."""
    states: tuple[State, ...]
    """States from the start to the goal, or the start alone if the goal was not reached; with
    Algorithm 1 those to the last expanded state."""
    cost: float = 0.0
    """Cost of the path."""
    expanded: int = 0
    """Number of states expanded."""
    generated: int = 0
    """Number of states put into the open queue."""
    tree: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    """Base positions at both ends of the steps that the last search explored, (e, 2, 3) [m]."""
    backward_expanded: int = 0
    """Number of nodes and labels from which backward searches computed the lower bounds."""
    bound: float = math.inf
    """Optimality bound: the path costs at most this factor times the minimum; infinite if nothing
    is proved."""
    improvements: tuple[Improvement, ...] = ()
    """The paths found in turn, each cheaper than the one before."""
