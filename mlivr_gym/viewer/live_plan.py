"""The state of the viewer without its page: a query that can be changed, and its plan."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.planners.query import GOAL_TOLERANCE
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.boxes import Box

BOX_EDGE = 0.3
"""Edge of a box that is added [m]."""

PRICE = 0.1
"""Initial regrasp price of the weighted cost [m]."""


def query_of(graph: StanceGraph, plan: Plan) -> dict[str, Any]:
    """Return the arguments of `Planner.plan` whose result a plan is."""
    query = plan.query
    position, quaternion, _ = plan.configuration(0)
    return {
        "start": plan.stances[0],
        "goal": query.goal,
        "cost": query.cost_name,
        "regrasp_price": query.regrasp_price,
        "goal_tolerance": query.goal_tolerance,
        "goal_face": query.goal_face,
        "start_pose": graph.given_pose_of(plan.stances[0], position, quaternion),
        "options": SearchOptions(method=query.method),
    }


class LivePlan:
    """A query on a stance graph with its plan and the previous plan.

    `query` holds the arguments of `Planner.plan`. Each change plans anew. If the query is invalid
    or no plan exists, `plan` is None and `message` says why. `expanded` is the number of states of
    the search, and `seconds` its time [s].
    """

    def __init__(self, graph: StanceGraph, query: dict[str, Any], plan: Plan | None = None) -> None:
        """Start with a plan of the query, or without one until `replan` is called."""
        defaults: dict[str, Any] = {"cost": "base", "goal_tolerance": GOAL_TOLERANCE}
        self.graph, self.query, self.plan = graph, defaults | query, plan
        self.planner = Planner(graph)
        self.previous: Plan | None = None
        self.message = "" if plan is None else _plan_message(plan)
        self.expanded, self.seconds = 0, 0.0
        if plan is not None:
            self.expanded = plan.statistics.expanded
            self.seconds = plan.statistics.feasibility_time + plan.statistics.search_time

    @property
    def goal(self) -> Array:
        """The goal position, shape (3,) [m]."""
        return np.array(self.query["goal"])

    def replan(self, **changes: Any) -> None:
        """Plan anew in the current world, with some other arguments of the query."""
        self.query |= changes
        began = time.perf_counter()
        self.previous = self.plan or self.previous
        self.plan, self.expanded = None, 0
        try:
            result = self.planner.plan(**self.query)
        except MlivrError as error:
            self.message = str(error)
        else:
            self.plan, self.expanded = result.plan, result.expanded
            self.message = result.message if result.plan is None else _plan_message(result.plan)
        self.seconds = time.perf_counter() - began

    def set_start_point(self, limb: int, point: str) -> None:
        """Start with a limb at another point, in the posture of the resulting stance."""
        start = list(self.query["start"])
        start[limb] = point
        self.replan(start=tuple(start), start_pose=None, start_joints=None)

    def toggle_occupied(self, point: str) -> None:
        """Mark a point as occupied, or as free if it is occupied."""
        if self.graph.grasp_map.index(point) in self.graph.occupied:
            self.graph.vacate([point])
        else:
            self.graph.occupy([point])
        self.replan()

    def set_goal(self, goal: Array) -> None:
        """Set another goal position [m], which is moved into the cabin if it lies outside."""
        self.replan(goal=tuple(np.clip(goal, *self.graph.grasp_map.cabin).tolist()))

    def set_cost(self, cost: str, price: float) -> None:
        """Set another cost; the regrasp price [m] applies to the weighted cost alone."""
        self.replan(cost=cost, regrasp_price=price if cost == "weighted" else None)

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

    def summary(self) -> str:
        """Summarise the plan in Markdown, or say why none exists."""
        goal = ", ".join(f"{part:.2f}" for part in self.goal)
        query = f"{' '.join(self.query['start'])} → ({goal}), {self.query['cost']} cost"
        spent = f"{self.expanded} states expanded, {self.seconds:.2f} s"
        if self.plan is None:
            return f"**No plan:** {self.message}\n\n{query}  \n{spent}"
        w_m, w_b = self.plan.w_m_min, self.plan.w_b_min
        margins = f"minimum manipulability {w_m:.3f} (limbs), {w_b:.5f} (base)"
        lines = [f"**{self.message}**", margins, spent, query]
        if self.previous is not None:
            lines.append(f"previous plan: {_plan_message(self.previous)} (pale)")
        return "  \n".join(lines)


def _plan_message(plan: Plan) -> str:
    """Summarise a plan."""
    return f"{len(plan.steps)} steps, {plan.base_translation:.3f} m"
