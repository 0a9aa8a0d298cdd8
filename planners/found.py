"""What a search of many limbs finds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mlivr_gym.planners.pair_search import EXHAUSTED
from mlivr_gym.postures.postures import Postures
from mlivr_gym.transitions.state import State


@dataclass(frozen=True)
class Improvement:
    """A plan that a search found before it ended.

    Attributes:
        time: When [s], from the start of the search.
        cost: Cost of the plan.
        bound: Factor of the least cost within which it was proved then; infinite if within none.
    """

    time: float
    cost: float
    bound: float


@dataclass
class Found:
    """Outcome of a search: expanded states with their parents, costs and postures.

    Attributes:
        status: `FOUND`, `EXHAUSTED` or `LIMIT`.
        goal: Index of the state that ends the best plan, or of the last expanded one.
        bound: Factor of the least cost within which the plan is proved.
    """

    status: int = EXHAUSTED
    states: list[State] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    postures: list[Postures] = field(default_factory=list)
    generated: int = 1
    goal: int = -1
    bound: float = np.inf
    improvements: list[Improvement] = field(default_factory=list)
