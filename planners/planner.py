"""The planner: from a start stance and a goal position to a plan."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import NoPlanError, SettingError, StanceError
from mlivr_gym.motion.commitment import CommittedMotion, CommittedSteps, committed_motion
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.plan_parts import Statistics, World
from mlivr_gym.planners.cost_to_go import CostToGo
from mlivr_gym.planners.outcome import FOUND, LIMIT, Improvement, Path
from mlivr_gym.planners.query import (
    GOAL_TOLERANCE,
    MOST_EXPANSIONS,
    QUERY,
    Goal,
    SearchOptions,
    SearchQuery,
)
from mlivr_gym.planners.refinement import refined
from mlivr_gym.planners.searches import Algorithm1Searcher, GraphSearcher, Searcher
from mlivr_gym.planners.why_not import Cause, cause_of
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

CACHED_TABLES = 16
"""Exact costs-to-go that a planner keeps."""


@dataclass(frozen=True, repr=False)
class PlanningResult:
    """Outcome of a query.

    Attributes
    ----------
    plan
        The plan, or None.
    reason
        `""`, or why there is none: `"start infeasible"`, `"goal outside the reachable
        set"`, `"search exhausted"`, `"limit reached"`, `"no swing"`.
    message
        One sentence for people.
    expanded
        States expanded.
    generated
        States generated.
    feasibility_time
        Time spent on postures and stances for this query [s].
    search_time
        Time spent on search and step checks [s].
    tree
        Base positions at both ends of each explored step, shape (e, 2, 3) [m].
    improvements
        When each better plan was found, at what cost.
    """

    plan: Plan | None
    reason: str
    message: str
    expanded: int
    generated: int
    feasibility_time: float
    search_time: float
    tree: Array
    improvements: tuple[Improvement, ...] = ()

    def __repr__(self) -> str:
        """The message, in one line."""
        return f"<PlanningResult: {self.message}>"

    def __bool__(self) -> bool:
        """Whether there is a plan."""
        return self.plan is not None

    def unwrap(self) -> Plan:
        """The plan.

        Raises
        ------
        NoPlanError
            If there is none; the message says why.
        """
        if self.plan is None:
            raise NoPlanError(self.message)
        return self.plan


class _Clock:
    """Time spent on feasibility, and on search without commitment."""

    def __init__(self) -> None:
        self.began, self.feasibility, self.search = time.perf_counter(), 0.0, 0.0

    def lap(self) -> float:
        """Time since the last lap [s]."""
        before, self.began = self.began, time.perf_counter()
        return self.began - before


class Planner:
    """Plans on one stance graph.

    Example:
        >>> from mlivr_gym import stance_graph
        >>> from mlivr_gym.planners import Planner
        >>> planner = Planner(stance_graph())
        >>> plan = planner.plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), cost="steps").unwrap()
        >>> len(plan.steps)
        4
    """

    @checked(QUERY)
    def __init__(self, graph: StanceGraph) -> None:
        """Plan on `graph`, as `stance_graph` makes it."""
        self.graph, self._searcher = graph, GraphSearcher(graph)
        self._committed = CommittedSteps(graph)
        self._exact: OrderedDict[tuple[Any, ...], CostToGo] = OrderedDict()

    @checked(QUERY)
    def plan(
        self,
        start: Sequence[str | int] | State,
        goal: Sequence[float] | Array,
        cost: str = "base",
        *,
        regrasp_price: float | None = None,
        method: str = "astar",
        heuristic: str | None = None,
        inflation: float | None = None,
        goal_tolerance: float = GOAL_TOLERANCE,
        goal_face: str | None = None,
        start_pose: Sequence[Any] | None = None,
        start_joints: Sequence[Any] | Array | None = None,
        limit: int = 10_000_000,
        time_limit: float | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> PlanningResult:
        """Plan from a stance to a goal position of the base.

        Parameters
        ----------
        start
            Point id (or index) of each limb, or a state of the graph.
        goal
            x, y, z in the JEM frame [m].
        cost
            `"base"` (displacement), `"steps"` or `"weighted"` (displacement plus a price a
            step).
        regrasp_price
            Metres charged for a regrasp, with `cost="weighted"`.
        method
            `"astar"` (optimal), `"dijkstra"` (optimal, no heuristic), `"greedy"`
            (best-first by heuristic) or `"algorithm1"` (as `"astar"`, in plain Python: slow, to
            read and to compare with).
        heuristic
            `"cost_to_go"` (exact cost when steps are not checked; default for two
            limbs), `"consistent"` (default for more and of `"algorithm1"`), `"paper"` (may lose
            optimality; default of `"greedy"`) or `"zero"`.
        inflation
            The plan costs at most this many times the least. By default 1 for two
            limbs and `"algorithm1"`; with more limbs the first plan found is taken, and
            `plan.statistics.bound` tells within what factor it is proved.
        goal_tolerance
            Radius of the goal region [m].
        goal_face
            Face of the map whose points all limbs hold at the goal, for example
            `"overhead"`; by default they may hold any.
        start_pose
            Base pose at the start, where the robot stands in another than that of the
            start stance: x, y, z [m] and quaternion w, x, y, z. The thresholds do not apply to
            it.
        start_joints
            Joint angles at the start, shape (N, 6) [rad], within 0.02 rad of those
            that hold the points at that pose, on their windings (`Limb.windows`): the plan
            then keeps their branches for as long as each limb holds.
        limit
            Most expansions.
        time_limit
            How long a plan is looked for and improved [s], unless one is proved within
            `inflation` (by default 1) before. What is found then depends on the machine.
        progress
            Called with the number of expansions now and then (`"algorithm1"`, or where
            there is no table of the graph).

        Returns
        -------
        PlanningResult
            The plan, or why there is none. A start that cannot be held is such a reason; ids that
            do not exist, points too close or too far apart and goals outside the cabin raise.

        Raises
        ------
        MlivrError
            If an argument cannot be used; the message names it.
        """
        target = Goal.checked(self.graph, goal, cost, regrasp_price, goal_tolerance, goal_face)
        options = SearchOptions(method, heuristic, inflation, limit, progress, time_limit)
        search, clock = SearchQuery.checked(self.graph, target, options), _Clock()
        self.graph.indices(start.stance if isinstance(start, State) else start)
        try:
            first = self._first(start, start_pose, start_joints)
        except StanceError as error:
            clock.feasibility = clock.lap()
            return _no_plan("start infeasible", str(error), clock)
        clock.feasibility = clock.lap()
        plain = search.method == "algorithm1"
        searcher: Searcher = Algorithm1Searcher(self.graph) if plain else self._searcher
        path = searcher.find(search, first)
        clock.search = clock.lap()
        if path is None:
            return _no_plan("goal outside the reachable set", _not_connected(target), clock)
        if path.status != FOUND:
            return self._not_found(path, search, first, clock)
        committed = committed_motion(self.graph, path.states, None, self._committed)
        if committed.motion is None:
            return _no_plan("no swing", self._no_swing(path, committed), clock, path)
        times = clock.feasibility, clock.search
        bound = path.bound if path.bound < math.inf else None
        statistics = Statistics(
            path.cost, path.expanded, path.generated, *times, path.backward, bound
        )
        plan = Plan(search.record, World.of(self.graph), committed.motion, statistics)
        return PlanningResult(
            plan, "", f"{len(plan.steps)} steps, {plan.base_translation:.3f} m",
            path.expanded, path.generated, *times, path.tree, path.improvements,
        )  # fmt: skip

    @checked(QUERY)
    def why_not(
        self,
        start: Sequence[str | int] | State,
        goal: Sequence[float] | Array,
        *,
        goal_tolerance: float = GOAL_TOLERANCE,
        goal_face: str | None = None,
        start_pose: Sequence[Any] | None = None,
        start_joints: Sequence[Any] | Array | None = None,
        limit: int = 2000,
    ) -> Cause:
        """What cuts a goal off to which `plan` has found no plan, and what would help.

        The query is asked again on graphs without obstacles, collisions, thresholds or checks of
        steps, which takes some seconds.

        Parameters
        ----------
        start
            As in `plan`, as are the next four.
        goal
            x, y, z in the JEM frame [m].
        goal_tolerance
            Radius of the goal region [m].
        goal_face
            As in `plan`.
        start_pose
            Base pose at the start.
        start_joints
            Joint angles at the start.
        limit
            Most expansions of each search with more than two limbs.

        Raises
        ------
        MlivrError
            If an argument cannot be used, or the start cannot be held.
        """
        target = Goal.checked(self.graph, goal, "steps", None, goal_tolerance, goal_face)
        first = self._first(start, start_pose, start_joints)
        return cause_of(
            self.graph, first, target, MOST_EXPANSIONS if self.graph.has_tables else limit
        )

    def _first(
        self,
        start: Sequence[str | int] | State,
        pose: Sequence[Any] | None,
        joints: Sequence[Any] | Array | None,
    ) -> State:
        """The state at the start.

        Raises
        ------
        StanceError
            If it cannot be held.
        """
        if isinstance(start, State):
            if not (pose is None and joints is None):
                raise SettingError("start is a state: start_pose and start_joints are told by it")
            return self.graph.checked_state(start)
        return self.graph.state(start, pose, joints)

    def _no_swing(self, path: Path, committed: CommittedMotion) -> str:
        """The sentence on a step of the graph for which no swing was found."""
        before, after = path.states[committed.failed or 0 :][:2]
        return (
            f"no swing was found from {self.graph.ids(before.stance)} to "
            f"{self.graph.ids(after.stance)}, although its parts were shown to be free"
        )

    def _not_found(
        self, path: Path, search: SearchQuery, first: State, clock: _Clock
    ) -> PlanningResult:
        """The result of a search that ended without reaching the goal."""
        reason = "limit reached" if path.status == LIMIT else "search exhausted"
        start, goal = self.graph.ids(first.stance), search.goal.target.tolist()
        told = f" after {path.expanded} expansions, no path from {start} to {goal}"
        if reason == "limit reached" and not path.expanded:
            told = (
                f": {search.time_limit:g} s were over before all was worked out that is worked out "
                "once for a robot on a map; that goes on, so ask again"
            )
        elif path.generated <= 1:
            told = f": no step leaves the start {start} on the branches that the limbs may be on"
        return _no_plan(reason, f"{reason}{told}", clock, path)

    @checked(QUERY)
    def refined(self, plan: Plan, seed: int = 0) -> Plan:
        """A plan on the same footholds with other base poses and less translation.

        See `refinement.refined`: `plan` stays what the graph's optimum is measured by.

        Raises
        ------
        PlanError
            If the plan belongs to another map or robot, or is not possible here now.
        """
        return refined(self.graph, plan, seed)

    @checked(QUERY)
    def prepare(
        self,
        goal: Sequence[float] | Array,
        cost: str = "base",
        *,
        regrasp_price: float | None = None,
        goal_tolerance: float = GOAL_TOLERANCE,
        goal_face: str | None = None,
    ) -> None:
        """Work the `"cost_to_go"` heuristic out for all stances: further plans there are fast.

        It is the exact cost if limbs may change their branches, and stays a lower bound when points
        are occupied or obstacles come.

        Raises
        ------
        SettingError
            If the robot has more than two limbs.
        """
        graph, bounds = self._two_limbs(), self._searcher.bounds()
        assert bounds is not None
        target = Goal.checked(graph, goal, cost, regrasp_price, goal_tolerance, goal_face)
        bounds.to(target, np.arange(len(graph)))

    @checked(QUERY)
    def cost_to_go(
        self,
        goal: Sequence[float] | Array,
        cost: str = "base",
        *,
        regrasp_price: float | None = None,
        goal_tolerance: float = GOAL_TOLERANCE,
        goal_face: str | None = None,
    ) -> CostToGo:
        """Exact cost from every state to a goal, steps checked: the oracle and expert.

        Raises
        ------
        SettingError
            If the robot has more than two limbs.
        """
        graph = self._two_limbs()
        target = Goal.checked(graph, goal, cost, regrasp_price, goal_tolerance, goal_face)
        key = (*target.key, graph.version)
        if key not in self._exact:
            self._exact[key] = CostToGo(graph, target)
            if len(self._exact) > CACHED_TABLES:
                self._exact.popitem(last=False)
        return self._exact[key]

    def _two_limbs(self) -> PairGraph:
        if not isinstance(self.graph, PairGraph):
            name = self.graph.robot.name
            raise SettingError(f"cost-to-go tables need two limbs; robot {name!r} has more")
        return self.graph


def _not_connected(goal: Goal) -> str:
    return (
        f"no stance that can be reached from the start has its base within {goal.tolerance:g} m of "
        f"goal {goal.target.tolist()}"
    )


def _no_plan(reason: str, message: str, clock: _Clock, path: Path | None = None) -> PlanningResult:
    """A result without a plan."""
    counts = (0, 0) if path is None else (path.expanded, path.generated)
    tree = np.zeros((0, 2, 3)) if path is None else path.tree
    return PlanningResult(None, reason, message, *counts, clock.feasibility, clock.search, tree)
