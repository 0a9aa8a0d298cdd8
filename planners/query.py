"""Queries: what a planner is asked, with every argument checked."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arguments import NOT_NEGATIVE, SEED, Kinds, Via
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.arguments import WALK
from mlivr_gym.motion.plan_parts import Query
from mlivr_gym.planners.costs import COST_KINDS, HEURISTICS, Cost
from mlivr_gym.schema import NAME, Anything, Choice, FieldPath, Maybe, Tuples, Whole
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.grasp_map import GOAL, STANCE

METHODS = ("astar", "dijkstra", "greedy", "algorithm1")
"""Names of the search methods."""

GOAL_TOLERANCE = 0.2
"""Radius of the goal region in the paper [m]."""


MOST_EXPANSIONS = 10**30
"""Most that may be asked for as a limit; no search is longer, and compiled ones take 64 bits."""

QUERY: Kinds = {
    **WALK,
    **COST_KINDS,
    "start": Via(lambda start, at: start if isinstance(start, State) else STANCE.read(start, at)),
    "goal": GOAL,
    "goal_tolerance": NOT_NEGATIVE,
    "goal_face": Maybe(NAME),
    "start_pose": Anything(),
    "start_joints": Anything(),
    "method": Choice(METHODS),
    "heuristic": Maybe(Choice(HEURISTICS)),
    "inflation": Maybe(Tuples((), 1.0)),
    "limit": Whole(1, MOST_EXPANSIONS),
    "time_limit": Maybe(NOT_NEGATIVE),
    "seed": SEED,
}
"""Kinds of the arguments of planners; a pose and joint angles are read by the stance graph."""


@dataclass(frozen=True)
class SearchOptions:
    """How to search; None where the default depends on method and robot, see `Planner.plan`.

    Attributes
    ----------
    method
        One of `METHODS`.
    heuristic
        One of `costs.HEURISTICS`.
    inflation
        Factor of the least cost that a plan may cost, at least 1.
    limit
        Most expansions.
    progress
        Called with the number of expansions now and then.
    time_limit
        Longest that a plan is looked for and improved [s].
    """

    method: str = "astar"
    heuristic: str | None = None
    inflation: float | None = None
    limit: int = 10_000_000
    progress: Callable[[int], None] | None = None
    time_limit: float | None = None


@dataclass(frozen=True)
class Goal:
    """Where to go and at what cost.

    Attributes
    ----------
    target
        Goal position of the base [m], shape (3,).
    tolerance
        Radius of the goal region [m].
    cost
        Cost of a step.
    face
        Face of the map whose points all limbs hold at the goal; None for any.
    on_face
        Which points lie on it, shape (m,); None with no face.
    """

    target: Array
    tolerance: float
    cost: Cost
    face: str | None = None
    on_face: BoolArray | None = None

    @classmethod
    def checked(
        cls,
        graph: StanceGraph,
        goal: Sequence[float] | Array,
        cost: str,
        regrasp_price: float | None,
        tolerance: float,
        face: str | None = None,
    ) -> Goal:
        """A goal from the arguments of a user.

        Raises
        ------
        MlivrError
            If one cannot be used; the message names it.
        """
        priced = Cost.named(cost, regrasp_price)
        target, on_face = graph.grasp_map.check_goal(goal), None
        if face is not None:
            faces = graph.grasp_map.faces
            Choice(tuple(sorted(set(faces)))).read(face, FieldPath("goal_face", SettingError))
            on_face = np.array([name == face for name in faces])
        return cls(target, tolerance, priced, face, on_face)

    @property
    def key(self) -> tuple[Any, ...]:
        """What tables of costs to this goal are kept under."""
        return (*self.target.tolist(), self.tolerance, self.face, self.cost)

    def distance(self, positions: Array) -> Array:
        """Distances of base positions from the goal, shape (..., 3) -> (...) [m]."""
        away: Array = np.linalg.norm(positions - self.target, axis=-1)
        return away

    def held(self, stances: Sequence[Any] | NDArray[np.integer[Any]]) -> BoolArray:
        """Whether all limbs hold points of the face, for stances (..., N) -> (...)."""
        points = np.asarray(stances)
        if self.on_face is None:
            return np.ones(points.shape[:-1], dtype=np.bool_)
        return np.asarray(self.on_face[points].all(axis=-1))

    def reached(self, positions: Array, stances: Sequence[Any] | IntArray) -> BoolArray:
        """Whether a robot is at the goal, base positions (..., 3) and stances (..., N) -> (...)."""
        inside = self.distance(positions) <= self.tolerance
        return np.asarray(inside & self.held(stances))


@dataclass(frozen=True)
class SearchQuery:
    """A query of a search: the goal, and how to look for it.

    Attributes
    ----------
    goal
        Where to go and at what cost.
    method
        One of `METHODS`.
    heuristic
        One of `costs.HEURISTICS`.
    inflation
        Factor of the least cost that a plan may cost, at least 1; infinite for any.
    limit
        Most expansions.
    progress
        Called with the number of expansions now and then.
    time_limit
        Longest that a plan is looked for and improved [s].
    began
        When it was asked, as `time.perf_counter` counts [s].
    guided
        Whether a first plan is looked for by promise, see `lazy_search`.
    """

    goal: Goal
    method: str
    heuristic: str
    inflation: float
    limit: int
    progress: Callable[[int], None] | None = None
    time_limit: float = math.inf
    guided: bool = False
    began: float = field(default_factory=time.perf_counter)

    @classmethod
    def checked(cls, graph: StanceGraph, goal: Goal, options: SearchOptions) -> SearchQuery:
        """A search from the options of a user, with the defaults of method and robot.

        Raises
        ------
        SettingError
            If one cannot be used; the message names it.
        """
        method = options.method
        plain, tables = method == "algorithm1", graph.has_tables
        heuristic = options.heuristic
        if heuristic is None:
            # Greedy search needs an estimate without plateaus, and loses nothing by overestimates.
            estimate = "cost_to_go" if tables and not plain else "consistent"
            heuristic = "paper" if method == "greedy" else estimate
        if method == "dijkstra":
            heuristic = "zero"
        if method == "greedy" and heuristic == "zero":
            raise SettingError("method 'greedy' needs a heuristic other than 'zero'")
        if heuristic == "cost_to_go" and not tables:
            name = graph.robot.name
            raise SettingError(f"heuristic 'cost_to_go' needs two limbs; robot {name!r} has more")
        if heuristic == "cost_to_go" and plain:
            raise SettingError("method 'algorithm1' needs a heuristic other than 'cost_to_go'")
        limit, inflation = min(options.limit, sys.maxsize), options.inflation
        seconds = options.time_limit
        if seconds is not None and plain:
            raise SettingError(f"time_limit is {seconds!r}; method 'algorithm1' takes none")
        seconds = math.inf if seconds is None else seconds
        optimal = tables or plain or method == "dijkstra" or seconds < math.inf
        if inflation is None:
            inflation = 1.0 if optimal else math.inf
        guided = not (tables or plain) and method == "astar" and heuristic == "consistent"
        guided &= inflation > 1.0 or seconds < math.inf
        if not (tables or plain) and (method == "greedy" or heuristic == "paper"):
            inflation = math.inf
        return cls(goal, method, heuristic, inflation, limit, options.progress, seconds, guided)

    @property
    def until(self) -> float:
        """When its time is over, as `time.perf_counter` counts [s]."""
        return self.began + self.time_limit

    @property
    def g_weight(self) -> float:
        """Weight of the cost so far in the order of the queue; that of the estimate is 1."""
        if self.method == "greedy":
            return 0.0
        return 1.0 / self.inflation if self.inflation < math.inf else 1.0

    @property
    def guarantee(self) -> float:
        """Factor of the least cost that plans of two limbs keep; infinite if none is proved."""
        proved = self.method != "greedy" and self.heuristic != "paper"
        return self.inflation if proved else math.inf

    def estimate(self, distance: Array, max_step: float) -> Array:
        """Estimate of the cost to the goal at distances from it [m], see `Cost.heuristic`."""
        goal = self.goal
        return goal.cost.heuristic(self.heuristic, distance, goal.tolerance, max_step)

    @property
    def record(self) -> Query:
        """The query as a plan tells it."""
        x, y, z = self.goal.target.tolist()
        cost = self.goal.cost
        price = cost.step_weight if cost.name == "weighted" else None
        goal = self.goal
        return Query(
            (x, y, z), goal.tolerance, cost.name, price, self.method, self.heuristic, goal.face
        )
