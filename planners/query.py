"""Queries of a planner: goal, cost and search options, with every argument checked."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arguments import NOT_NEGATIVE, SEED, Function, Reader, Validators
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.plan_parts import Query
from mlivr_gym.planners.clock import UNLIMITED, Clock
from mlivr_gym.planners.costs import COST_KINDS, HEURISTICS, Cost
from mlivr_gym.schema import NAME, Anything, Choice, FieldPath, Integer, OrNone, Struct, Tuples
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.given_points import GOAL, STANCE

METHODS = ("astar", "dijkstra", "greedy", "algorithm1")
"""Names of the search methods."""

GOAL_TOLERANCE = 0.2
"""Radius of the goal region in the paper [m]."""

EXPANSIONS = 10_000_000
"""Number of states that a search expands at most by default."""

MAX_EXPANSIONS = 10**30
"""Largest limit of expansions that can be requested; compiled searches count in 64 bits."""


def _heuristic_name(name: object, at: FieldPath) -> str:
    """Return the name of a heuristic; the error of its former name has the new one."""
    if isinstance(name, str) and name == "cost_to_go":
        raise at.fault("is 'cost_to_go', which is now called 'relaxed'")
    return Choice(HEURISTICS).read(name, at)


QUERY: Validators = {
    **ARGUMENTS,
    **COST_KINDS,
    "start": Reader(
        lambda start, at: start if isinstance(start, State) else STANCE.read(start, at)
    ),
    "goal": GOAL,
    "goal_tolerance": NOT_NEGATIVE,
    "goal_face": OrNone(NAME),
    "start_pose": Anything(),
    "start_joints": Anything(),
    "limit": Integer(1, MAX_EXPANSIONS),
    "time_limit": OrNone(NOT_NEGATIVE),
    "seed": SEED,
}
"""Validators of the arguments of a planner; base poses and joint angles are checked by the stance
graph."""


@dataclass(frozen=True)
class Goal:
    """A goal region of the base, and the cost with which it is reached."""

    target: Array
    """Goal position of the base [m], shape (3,)."""
    tolerance: float
    """Radius of the goal region [m]."""
    cost: Cost
    """Cost of a step."""
    face: str | None = None
    """Face of the map on which all limbs hold points at the goal; None for any."""
    on_face: BoolArray | None = None
    """Whether each point lies on that face, shape (m,); None if no face is requested."""

    @classmethod
    def from_arguments(
        cls,
        graph: StanceGraph,
        goal: Sequence[float] | Array,
        cost: str | Cost,
        regrasp_price: float | None,
        tolerance: float,
        face: str | None = None,
    ) -> Goal:
        """Return a goal from the arguments of a user; an `MlivrError` names one not to be used."""
        priced = Cost.named(cost, regrasp_price)
        priced.check_fits(len(graph.grasp_map))
        target, on_face = graph.grasp_map.check_goal(goal), None
        if face is not None:
            faces = graph.grasp_map.faces
            Choice(tuple(sorted(set(faces)))).read(face, FieldPath("goal_face", SettingError))
            on_face = np.array([name == face for name in faces])
        return cls(target, tolerance, priced, face, on_face)

    @property
    def key(self) -> tuple[Any, ...]:
        """Return the key under which tables of this goal are cached."""
        return (*self.target.tolist(), self.tolerance, self.face, self.cost)

    def distance(self, positions: Array) -> Array:
        """Return the distances of base positions from the goal, shape (..., 3) -> (...) [m]."""
        distances: Array = np.linalg.norm(positions - self.target, axis=-1)
        return distances

    def on_goal_face(self, stances: Sequence[Any] | NDArray[np.integer[Any]]) -> BoolArray:
        """Return whether all limbs hold points of the face, for stances (..., N) -> (...)."""
        points = np.asarray(stances)
        if self.on_face is None:
            return np.ones(points.shape[:-1], dtype=np.bool_)
        return np.asarray(self.on_face[points].all(axis=-1))

    def reached(self, positions: Array, stances: Sequence[Any] | IntArray) -> BoolArray:
        """Return whether robots are at the goal, base (..., 3), stances (..., N) -> (...)."""
        inside = self.distance(positions) <= self.tolerance
        return np.asarray(inside & self.on_goal_face(stances))


@dataclass(frozen=True)
class SearchOptions:
    """How a plan is searched for.

    Raises a `SettingError` that names a field that cannot be used.

    Examples
    --------
    >>> from mlivr_gym.planners import SearchOptions
    >>> SearchOptions(inflation=1.5).method
    'astar'
    """

    method: Annotated[str, Choice(METHODS)] = "astar"
    """`"astar"` (A*: Hart, Nilsson and Raphael 1968), `"dijkstra"` (the same with heuristic 0),
    `"greedy"` (greedy best-first search) or `"algorithm1"` (A* in plain Python, which is slow, to
    read and to compare with)."""
    heuristic: Annotated[str | None, OrNone(Reader(_heuristic_name))] = None
    """`"relaxed"` (relaxed cost-to-go: the minimum cost if limbs could change their branches at any
    time; default for two limbs), `"consistent"` (by the distance to the goal; default for more
    limbs and for `"algorithm1"`), `"paper"` (the same without the tolerance, which may
    overestimate; default of `"greedy"`) or `"zero"`. Over the node table of more limbs, A* uses the
    relaxed cost-to-go in place of `"consistent"`."""
    inflation: Annotated[float | None, OrNone(Tuples((), 1.0))] = None
    """Suboptimality bound w, at least 1: the plan is proved to cost at most w times the minimum.
    With two limbs and for `"algorithm1"` the search is weighted A*, which orders its queue by
    `g + w h`; with more limbs it is an anytime search that ends once the bound is proved, in
    whatever order it expands states (see `searches`). Of no effect for `"greedy"`, and without
    proof for the heuristic `"paper"`. The default is 1 for two limbs, for `"dijkstra"` and
    `"algorithm1"`, and with a time limit or an effort; otherwise any plan will do, and the first
    one is returned. `plan.statistics.bound` is the bound proved."""
    limit: Annotated[int, Integer(1, MAX_EXPANSIONS)] = EXPANSIONS
    """Maximum number of expansions."""
    effort: Annotated[int | None, OrNone(Integer(1, MAX_EXPANSIONS))] = None
    """Limit that does not depend on the speed of the machine: maximum number of expansions, where
    each check of an edge or a node counts as several, see `PathSearch.effort`."""
    progress: Annotated[Callable[[int], None] | None, OrNone(Function())] = None
    """Called from time to time with the number of expansions, by `"algorithm1"` and by searches
    that use no node table, see `searches`."""

    def __post_init__(self) -> None:
        """Check and convert all fields."""
        OPTIONS.check(self, FieldPath("", SettingError))


OPTIONS = Struct.of(SearchOptions)
"""Validator of each field of `SearchOptions`."""

DEFAULT_OPTIONS = SearchOptions()
"""The options that a query has by default."""


@dataclass(frozen=True)
class SearchQuery:
    """A query of a search: the goal and the search parameters, all defaults resolved."""

    goal: Goal
    """Goal region and cost."""
    method: str
    """One of `METHODS`."""
    heuristic: str
    """One of `costs.HEURISTICS`."""
    inflation: float
    """Suboptimality bound w >= 1; infinite if any plan will do."""
    limit: int
    """Maximum number of expansions."""
    progress: Callable[[int], None] | None = None
    """Called from time to time with the number of expansions."""
    time_limit: float = math.inf
    """Maximum time in which a plan is sought and improved [s]."""
    effort: int = sys.maxsize
    """Maximum effort with which a plan is sought and improved, see `PathSearch.effort`."""
    anytime: bool = False
    """Whether the search is an anytime search of more than two limbs: it finds some plan soon and
    better ones later, until one is proved within `inflation` or the time is over, see
    `implicit_search`. Over a node table every search of an optimal plan is one, see
    `table_search`."""
    start_time: float = 0.0
    """Time at which the query was made, on the clock of `time.perf_counter` [s]."""
    clock: Clock = UNLIMITED
    """When the search must end, and in which pieces it works."""

    @classmethod
    def from_options(
        cls,
        graph: StanceGraph,
        goal: Goal,
        options: SearchOptions = DEFAULT_OPTIONS,
        time_limit: float | None = None,
    ) -> SearchQuery:
        """Return a query from the options of a user, with a time limit [s].

        None stands for the default of method and robot. The `SettingError` names an option that
        cannot be used.
        """
        method, heuristic, inflation = options.method, options.heuristic, options.inflation
        effort = options.effort
        is_algorithm1, two_limbs = method == "algorithm1", graph.lists_all
        if method == "dijkstra":
            if heuristic not in (None, "zero"):
                raise SettingError(
                    f"heuristic is {heuristic!r}; method 'dijkstra' takes none but 'zero'"
                )
            heuristic = "zero"
        if heuristic is None:
            # Greedy search needs an estimate without plateaus, and loses nothing by overestimates.
            estimate = "relaxed" if two_limbs and not is_algorithm1 else "consistent"
            heuristic = "paper" if method == "greedy" else estimate
        if method == "greedy" and heuristic == "zero":
            raise SettingError("method 'greedy' needs a heuristic other than 'zero'")
        if heuristic == "relaxed" and not two_limbs:
            name = graph.robot.name
            raise SettingError(f"heuristic 'relaxed' needs two limbs; robot {name!r} has more")
        if heuristic == "relaxed" and is_algorithm1:
            raise SettingError("method 'algorithm1' needs a heuristic other than 'relaxed'")
        if time_limit is not None and is_algorithm1:
            raise SettingError(f"time_limit is {time_limit!r}; method 'algorithm1' takes none")
        if effort is not None and is_algorithm1:
            raise SettingError(f"effort is {effort!r}; method 'algorithm1' takes none")
        limit, seconds = (
            min(options.limit, sys.maxsize),
            math.inf if time_limit is None else time_limit,
        )
        is_limited = time_limit is not None or effort is not None
        optimal = two_limbs or is_algorithm1 or method == "dijkstra" or is_limited
        if inflation is None:
            inflation = 1.0 if optimal else math.inf
        anytime = (
            not (two_limbs or is_algorithm1) and method == "astar" and heuristic == "consistent"
        )
        anytime &= inflation > 1.0 or is_limited
        if not (two_limbs or is_algorithm1) and (method == "greedy" or heuristic == "paper"):
            inflation = math.inf
        effort = sys.maxsize if effort is None else min(effort, sys.maxsize)
        start_time = time.perf_counter()
        return cls(
            goal, method, heuristic, inflation, limit, options.progress, seconds, effort, anytime,
            start_time, Clock(start_time + seconds),
        )  # fmt: skip

    @property
    def cost_weight(self) -> float:
        """Return the weight of the cost so far in `f = cost_weight * g + h`.

        For weighted A* it is 1 / w, which orders the open queue as `g + w h` does.
        """
        if self.method == "greedy":
            return 0.0
        return 1.0 / self.inflation if self.inflation < math.inf else 1.0

    @property
    def has_given_order(self) -> bool:
        """Return whether the user chose the order of the queue, by method or heuristic."""
        return self.method != "astar" or self.heuristic in ("paper", "zero")

    @property
    def guaranteed_bound(self) -> float:
        """Return the bound w that the order of the queue proves; infinite if it proves none.

        It serves two limbs and Algorithm 1, whose searches end at the first such plan.
        """
        proved = self.method != "greedy" and self.heuristic != "paper"
        return self.inflation if proved else math.inf

    def estimate(self, distance: Array, max_displacement: float) -> Array:
        """Estimate the cost to the goal from distances to it [m], see `Cost.heuristic`."""
        goal = self.goal
        return goal.cost.heuristic(self.heuristic, distance, goal.tolerance, max_displacement)

    @property
    def record(self) -> Query:
        """Return the query as a plan stores it."""
        x, y, z = self.goal.target.tolist()
        cost = self.goal.cost
        price = cost.step_weight if cost.name == "weighted" else None
        goal = self.goal
        return Query(
            (x, y, z), goal.tolerance, cost.name, price, self.method, self.heuristic, goal.face
        )
