"""The state of the viewer without its page: a query that can be changed, and its plan."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.errors import MlivrError, StanceError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.planners.planning_result import PROVED_IMPOSSIBLE
from mlivr_gym.planners.query import DEFAULT_OPTIONS, GOAL_TOLERANCE
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.boxes import Box

CAUSE_LIMIT = 300
"""Maximum number of expansions in each search for a cause, which is slow for three limbs."""

BOX_EDGE = 0.3
"""Edge of a box that is added [m]."""

PRICE = 0.1
"""Initial regrasp price of the weighted cost [m]."""


@dataclass(frozen=True)
class LiveQuery:
    """A query of the viewer; its fields are the arguments of `Planner.plan`."""

    start: tuple[str, ...]
    goal: tuple[float, float, float]
    cost: str = "base"
    regrasp_price: float | None = None
    goal_tolerance: float = GOAL_TOLERANCE
    goal_face: str | None = None
    start_pose: tuple[float, ...] | None = None
    start_joints: Any = None
    time_limit: float | None = None
    options: SearchOptions = DEFAULT_OPTIONS

    @classmethod
    def of_plan(cls, graph: StanceGraph, plan: Plan) -> LiveQuery:
        """Return the query whose result a plan is."""
        query = plan.query
        position, quaternion, _ = plan.configuration(0)
        return cls(
            plan.stances[0], query.goal, query.cost_name, query.regrasp_price,
            query.goal_tolerance, query.goal_face,
            graph.given_pose_of(plan.stances[0], position, quaternion),
            options=SearchOptions(method=query.method),
        )  # fmt: skip


class LivePlan:
    """A query on a stance graph with its plan and the previous plan.

    Each change plans anew. If the query is invalid or no plan exists, `plan` is None, `message`
    says why, and `reason` is one of `PlanningResult` or `"invalid query"`. Of the search, `tree`
    has the base positions at both ends of each explored step, shape (e, 2, 3) [m], `expanded` the
    number of states, and `seconds` its time [s].
    """

    def __init__(self, graph: StanceGraph, query: LiveQuery, plan: Plan | None = None) -> None:
        """Start with a plan of the query, or without one until `replan` is called."""
        self.graph, self.query, self.plan = graph, query, plan
        self.planner = Planner(graph)
        self.previous: Plan | None = None
        self.message = self.reason = ""
        self.tree: Array = np.zeros((0, 2, 3))
        self.expanded, self.seconds = 0, 0.0
        if plan is not None:
            self.message = _plan_message(plan)
            self.expanded = plan.statistics.expanded
            self.seconds = plan.statistics.feasibility_time + plan.statistics.search_time

    @property
    def shown(self) -> Plan | None:
        """The plan to show: that of the query, otherwise the previous one."""
        return self.plan or self.previous

    def replan(self) -> None:
        """Plan anew with the current obstacles and occupied points."""
        query, began = self.query, time.perf_counter()
        self.previous = self.shown
        self.plan, self.tree, self.expanded = None, np.zeros((0, 2, 3)), 0
        try:
            result = self.planner.plan(**vars(query))
        except MlivrError as error:
            self.message, self.reason = str(error), "invalid query"
        else:
            self.plan, self.reason, self.tree = result.plan, result.reason, result.tree
            self.expanded = result.expanded
            self.message = result.message if result.plan is None else _plan_message(result.plan)
        self.seconds = time.perf_counter() - began

    def cause(self) -> str:
        """Return which rule makes the goal unreachable, `""` if `message` already says so.

        The query is planned again without each rule in turn, which takes seconds.
        """
        if self.reason not in PROVED_IMPOSSIBLE:
            return ""
        names = ("start", "goal", "goal_tolerance", "goal_face", "start_pose", "start_joints")
        query = {name: getattr(self.query, name) for name in names}
        cause = self.planner.why_not(**query, limit=CAUSE_LIMIT).message
        return "" if cause == self.message else cause

    def set_start_point(self, limb: int, point: str) -> None:
        """Start with a limb at another point, in the posture of the resulting stance."""
        start = (*self.query.start[:limb], point, *self.query.start[limb + 1 :])
        self.query = replace(self.query, start=start, start_pose=None, start_joints=None)
        self.replan()

    def toggle_occupied(self, point: str) -> None:
        """Mark a point as occupied, or as free if it is occupied."""
        if self.graph.grasp_map.index(point) in self.graph.occupied:
            self.graph.vacate([point])
        else:
            self.graph.occupy([point])
        self.replan()

    def set_goal(self, goal: Array) -> None:
        """Set another goal position [m], which is moved into the cabin if it lies outside."""
        low, high = self.graph.grasp_map.cabin
        x, y, z = np.clip(goal, low, high).tolist()
        self.query = replace(self.query, goal=(x, y, z))
        self.replan()

    def set_cost(self, cost: str, price: float) -> None:
        """Set another cost; the regrasp price [m] applies to the weighted cost alone."""
        regrasp_price = price if cost == "weighted" else None
        self.query = replace(self.query, cost=cost, regrasp_price=regrasp_price)
        self.replan()

    def put_box(self, name: str, centre: Array) -> None:
        """Add the obstacle of this id, or move it if it exists, to a centre [m].

        Raises a `MlivrError` if collisions are not checked, or the map has a box of that id.
        """
        existing = [box for box in self.graph.obstacles if box.id == name]
        half = np.array(existing[0].half) if existing else np.full(3, 0.5 * BOX_EDGE)
        box = Box.between(name, "obstacle", (centre - half).tolist(), (centre + half).tolist())
        if existing:
            self.graph.remove_obstacles([name])
        self.graph.add_obstacles([box])
        self.replan()

    def clear(self) -> None:
        """Remove all obstacles and free all points."""
        self.graph.remove_obstacles()
        self.graph.vacate()
        self.replan()

    def start_configuration(self) -> Configuration | None:
        """Return the configuration at the start, None if the start cannot be held."""
        if self.plan is not None:
            return self.plan.configuration(0)
        query = self.query
        try:
            state = self.graph.state(query.start, query.start_pose, query.start_joints)
        except StanceError:
            return None
        return self.graph.configuration(state)


def _plan_message(plan: Plan) -> str:
    """Summarise a plan."""
    return f"{len(plan.steps)} steps, {plan.base_translation:.3f} m"
