"""The state of the viewer without its page: a query with its plan, and what limbs can do."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError, StanceError
from mlivr_gym.motion import Plan
from mlivr_gym.planners import GOAL_TOLERANCE, Planner, SearchOptions
from mlivr_gym.stances import StanceGraph, State

NO_STEP = "no step: the support limbs cannot follow the base, or every swing is in collision"
"""Reason for a point whose stance can be held, but that no step reaches."""


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
    """A query on a stance graph with its plan.

    `query` holds the arguments of `Planner.plan`. Each change plans anew. If the query is invalid
    or no plan exists, `plan` is None and `message` says why.
    """

    def __init__(self, graph: StanceGraph, query: dict[str, Any], plan: Plan | None = None) -> None:
        """Start with a plan of the query, or without one until `replan` is called."""
        defaults: dict[str, Any] = {"cost": "base", "goal_tolerance": GOAL_TOLERANCE}
        self.graph, self.query, self.plan = graph, defaults | query, plan
        self.planner = Planner(graph)
        self.message = "" if plan is None else _plan_message(plan)

    @property
    def goal(self) -> Array:
        """The goal position, shape (3,) [m]."""
        return np.array(self.query["goal"])

    def replan(self, **changes: Any) -> None:
        """Plan anew in the current world, with some other arguments of the query."""
        self.query |= changes
        self.plan = None
        try:
            result = self.planner.plan(**self.query)
        except MlivrError as error:
            self.message = str(error)
        else:
            self.plan = result.plan
            self.message = result.message if result.plan is None else _plan_message(result.plan)

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

    def summary(self) -> str:
        """Summarise the plan in Markdown, or say why none exists."""
        goal = ", ".join(f"{part:.2f}" for part in self.goal)
        query = f"{' '.join(self.query['start'])} → ({goal}), {self.query['cost']} cost"
        if self.plan is None:
            return f"**No plan:** {self.message}\n\n{query}"
        spent = f"{self.plan.statistics.expanded} states expanded"
        w_m, w_b = self.plan.w_m_min, self.plan.w_b_min
        margins = f"minimum manipulability {w_m:.3f} (limbs), {w_b:.5f} (base)"
        return "  \n".join([f"**{self.message}**", margins, spent, query])


def _plan_message(plan: Plan) -> str:
    """Summarise a plan."""
    return f"{len(plan.steps)} steps, {plan.base_translation:.3f} m"


def explanations(graph: StanceGraph, state: State, point: int) -> list[str]:
    """Return a line for each limb: that it can step from a state to a point, or why not."""
    steps, name = graph.successors(state), graph.grasp_map.ids[point]
    lines = []
    for limb in range(graph.limbs):
        why = "can step to this point"
        if point in state.stance:
            why = f"point {name!r} is held by limb {state.stance.index(point)}"
        elif steps.find(limb, point) < 0:
            try:
                graph.state((*state.stance[:limb], point, *state.stance[limb + 1 :]))
                why = NO_STEP
            except StanceError as error:
                why = str(error)
        lines.append(f"limb {limb}: {why}")
    return lines


def states_of(graph: StanceGraph, plan: Plan) -> tuple[State | None, ...]:
    """Return the states along a plan in the current world, None after a step that is impossible."""
    motion, stances = plan.motion, plan.stances
    states: tuple[State, ...] = ()
    try:
        where = graph.given_pose_of(
            stances[0], motion.base_positions[0], motion.base_quaternions[0]
        )
        start = graph.state(stances[0], where)
        states = graph.states_along(start, [graph.indices(stance) for stance in stances[1:]])
    except StanceError:
        pass
    return *states, *[None] * (len(stances) - len(states))
