"""The planner: from a start stance and a goal position of the base to a plan."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import PlanError, SettingError, StanceError
from mlivr_gym.motion.commitment import CommittedSteps, committed_motion
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.plan_parts import Query, Statistics, World
from mlivr_gym.planners.cost_to_go import CostToGo
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.outcome import GOAL_REACHED, LIMIT_REACHED, SearchResult
from mlivr_gym.planners.planning_result import (
    GOAL_UNREACHABLE,
    NO_SWING,
    START_INFEASIBLE,
    PlanningResult,
    Timer,
    no_swing,
    not_connected,
    why_no_path,
    without_plan,
)
from mlivr_gym.planners.query import (
    DEFAULT_OPTIONS,
    EXPANSIONS,
    GOAL_TOLERANCE,
    MAX_EXPANSIONS,
    QUERY,
    Goal,
    SearchOptions,
    SearchQuery,
)
from mlivr_gym.planners.refinement import check_fits, refined
from mlivr_gym.planners.searches import GraphSearcher, path_along
from mlivr_gym.planners.why_not import Cause, find_cause
from mlivr_gym.schema import Integer
from mlivr_gym.sharing import OnGraph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

CACHED_TABLES = 16
"""Maximum number of exact cost-to-go tables that a planner caches."""


class Planner(OnGraph):
    """Planner of hand-over-hand walks on one stance graph.

    States are stances with the branches that each limb may be on; plans are found by label-setting
    A* with lazy evaluation of edges, see `table_search` and `label_search`.

    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> from mlivr_gym.planners import Planner
    >>> planner = Planner(stance_graph())
    >>> plan = planner.plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), cost="steps").unwrap()
    >>> len(plan.steps)
    4
    """

    @checked(QUERY)
    def __init__(self, graph: StanceGraph) -> None:
        """Plan on a stance graph."""
        self.graph, self._searcher = graph, GraphSearcher(graph)
        self._committed_steps = CommittedSteps(graph)
        self._cost_tables: OrderedDict[tuple[Any, ...], CostToGo] = OrderedDict()

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy the graph alone, and none of the results."""
        return type(self), (self.graph,)

    @checked(QUERY)
    def plan(
        self,
        start: Sequence[str | int] | State,
        goal: Sequence[float] | Array,
        cost: str | Cost = "base",
        *,
        regrasp_price: float | None = None,
        goal_tolerance: float = GOAL_TOLERANCE,
        goal_face: str | None = None,
        start_pose: Sequence[Any] | None = None,
        start_joints: Sequence[Any] | Array | None = None,
        time_limit: float | None = None,
        options: SearchOptions = DEFAULT_OPTIONS,
    ) -> PlanningResult:
        """Plan from a start stance to a goal position of the base.

        Parameters
        ----------
        start
            Point id (or index) of each limb, or a state of the graph.
        goal
            Goal position x, y, z in the module frame [m].
        cost
            `"base"` (base displacement), `"steps"`, `"weighted"` (displacement plus a price for
            each regrasp), or a `Cost`.
        regrasp_price
            Price of a regrasp [m], with `cost="weighted"`.
        goal_tolerance
            Radius of the goal region [m].
        goal_face
            Face of the map on which all limbs hold points at the goal, for example `"overhead"`;
            any by default.
        start_pose
            Base pose at the start if it is not that of the start stance: x, y, z [m] and quaternion
            w, x, y, z. The manipulability thresholds do not apply to it.
        start_joints
            Joint angles at the start, shape (N, 6) [rad], within 0.02 rad of angles that hold the
            points at that pose, in their joint windows (`Limb.windows`). Each limb then keeps its
            branch until its first regrasp.
        time_limit
            Maximum time in which a plan is sought and improved [s]; the search ends earlier once a
            plan is proved within `options.inflation` (by default 1). The plan then depends on the
            speed of the machine. Its swings are chosen afterwards, for which the search leaves as
            much time as those of earlier plans took, up to half of the limit.
        options
            How the plan is searched for.

        Returns
        -------
        PlanningResult
            The plan, or the reason why there is none, such as a start that cannot be held.

        Raises
        ------
        MlivrError
            If an argument cannot be used, for example a point id that does not exist, start points
            too close together or too far apart, or a goal outside the cabin; the message names it.
        """
        target = Goal.from_arguments(
            self.graph, goal, cost, regrasp_price, goal_tolerance, goal_face
        )
        search = SearchQuery.from_options(self.graph, target, options, time_limit)
        timer = Timer()
        self.graph.indices(start.stance if isinstance(start, State) else start)
        try:
            start_state = self._start_state(start, start_pose, start_joints)
        except StanceError as error:
            timer.start_state = timer.lap()
            return without_plan(START_INFEASIBLE, str(error), timer)
        timer.start_state = timer.lap()
        return self._searched(search, start_state, timer)

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
        """Return the rule that cuts a goal off from the start, and what would help.

        If there is a plan, or the limit does not tell, the message says so. Otherwise the query is
        repeated on graphs without obstacles, collisions, thresholds or step checks, which takes
        some seconds.

        The arguments are those of `plan`; with more than two limbs each search expands at most
        `limit` states. Raises an `MlivrError` if an argument cannot be used, or the start cannot be
        held.
        """
        target = Goal.from_arguments(self.graph, goal, "steps", None, goal_tolerance, goal_face)
        start_state = self._start_state(start, start_pose, start_joints)
        limit = MAX_EXPANSIONS if self.graph.lists_all else limit
        search = SearchQuery.from_options(self.graph, target, SearchOptions(limit=limit))
        result = self._searched(search, start_state, Timer())
        if result:
            return Cause((), f"nothing cuts the goal off: there is a plan of {result.message}")
        if result.reason == LIMIT_REACHED:
            return Cause((), f"{result.message}: a larger limit may tell whether there is one")
        if result.reason == NO_SWING:
            return Cause((), result.message)
        return find_cause(self.graph, start_state, target, limit)

    def _start_state(
        self,
        start: Sequence[str | int] | State,
        pose: Sequence[Any] | None,
        joints: Sequence[Any] | Array | None,
    ) -> State:
        """Return the state at the start; a `StanceError` if it cannot be held."""
        if isinstance(start, State):
            if not (pose is None and joints is None):
                raise SettingError(
                    "start is a state with base pose and branches; omit start_pose and start_joints"
                )
            return self.graph.validated_state(start)
        return self.graph.state(start, pose, joints)

    def _searched(self, search: SearchQuery, start_state: State, timer: Timer) -> PlanningResult:
        """Return the result of the search from a state."""
        result = self._searcher.find(search, start_state, self._committed_steps.step_time)
        timer.search = timer.lap()
        if result is None:
            return without_plan(GOAL_UNREACHABLE, not_connected(self.graph, search.goal), timer)
        if result.status != GOAL_REACHED:
            message = why_no_path(self.graph, result, search, start_state)
            return without_plan(result.status, message, timer, result)
        return self._committed(search.record, result, timer)

    def _committed(self, query: Query, result: SearchResult, timer: Timer) -> PlanningResult:
        """Return the plan of a path that was found, or that one of its steps has no swing."""
        committed = committed_motion(self.graph, result.states, None, self._committed_steps)
        if committed.motion is None:
            message = no_swing(self.graph, *result.states[committed.failed or 0 :][:2])
            return without_plan(NO_SWING, message, timer, result)
        times = timer.start_state, timer.search
        bound = result.bound if result.bound < math.inf else None
        statistics = Statistics(
            result.cost, result.expanded, result.generated, *times, result.backward_expanded, bound
        )
        plan = Plan(query, World.of(self.graph), committed.motion, statistics)
        return PlanningResult(
            plan, "", f"{len(plan.steps)} steps, {plan.base_translation:.3f} m",
            result.expanded, result.generated, *times, result.tree, result.improvements,
        )  # fmt: skip

    @checked({**QUERY, "taken": Integer(0, EXPANSIONS), "state": InstanceOf(State)})
    def remainder(self, plan: Plan, taken: int, state: State) -> PlanningResult | None:
        """Return what remains of a plan in the present world, without a search.

        Its steps are checked among the obstacles and occupied points of now, with the postures of
        the graph, and committed to branches and swings that are clear of them.

        Parameters
        ----------
        plan
            A plan for the map and the robot of the graph.
        taken
            Number of its steps that were taken.
        state
            The present state, in the stance to which these lead.

        Returns
        -------
        PlanningResult | None
            The rest of the plan; None if a step of it is not possible any more.

        Raises
        ------
        PlanError
            If the plan was made for another map or robot, or has fewer steps than were taken.
        """
        check_fits(self.graph, plan)
        if taken > len(plan.steps):
            raise PlanError(f"taken is {taken}; the plan has {len(plan.steps)} steps")
        timer, graph = Timer(), self.graph
        here, *stances = (graph.indices(stance) for stance in plan.stances[taken:])
        if here != state.stance:
            return None
        path = path_along(graph, state, stances, plan.query.cost_of)
        if path is None:
            return None
        timer.search = timer.lap()
        result = self._committed(plan.query, path, timer)
        return result if result.plan is not None else None

    @checked(QUERY)
    def refined(self, plan: Plan, seed: int = 0) -> Plan:
        """Return a plan on the same footholds with other base poses and no more base translation.

        The method is that of `refinement.refined`, which returns the given plan if it finds no
        better one; the given plan is not changed.

        The base poses are sampled with a seed. Raises a `PlanError` if the plan belongs to another
        map or robot, or is not possible in the present world.
        """
        return refined(self.graph, plan, seed)

    @checked(QUERY)
    def cost_to_go(
        self,
        goal: Sequence[float] | Array,
        cost: str | Cost = "base",
        *,
        regrasp_price: float | None = None,
        goal_tolerance: float = GOAL_TOLERANCE,
        goal_face: str | None = None,
    ) -> CostToGo:
        """Return the exact cost-to-go from every state to a goal, with all steps checked.

        The parameters are those of `plan`. The table is cached until the world changes. Raises a
        `SettingError` if the robot has more than two limbs.
        """
        graph = self.graph
        if not graph.lists_all:
            name = graph.robot.name
            raise SettingError(f"cost-to-go tables need two limbs; robot {name!r} has more")
        target = Goal.from_arguments(graph, goal, cost, regrasp_price, goal_tolerance, goal_face)
        key = (*target.key, graph.version)
        if key not in self._cost_tables:
            self._cost_tables[key] = CostToGo(graph, target)
            if len(self._cost_tables) > CACHED_TABLES:
                self._cost_tables.popitem(last=False)
        return self._cost_tables[key]
