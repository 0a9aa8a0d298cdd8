"""The fastest of several plans for one query: time as a cost.

How long a step takes depends on the branches, joint angles and swing that a plan commits its steps
to, not on the edge of the stance graph alone. So time is no cost of an edge, and A* does not apply.
Here the plans that are optimal for several costs, from the least translation over prices of a
regrasp to the fewest steps, get clocks (`simulation.timing`), and the fastest is taken: the best of
those considered, with no bound on what others might take.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mlivr_gym.arguments import Of, checked
from mlivr_gym.arrays import Array
from mlivr_gym.motion.clocks import Durations, duration_of
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.regrasp import RegraspPath, planned_regrasp
from mlivr_gym.planners import Planner
from mlivr_gym.planners.query import GOAL_TOLERANCE, QUERY
from mlivr_gym.schema import Maybe
from mlivr_gym.simulation.limits import Limits
from mlivr_gym.simulation.timing import TIMING, timed_path
from mlivr_gym.stances.stance_graph import StanceGraph

COSTS = (
    ("base", None), *(("weighted", price) for price in (0.01, 0.03, 0.1, 0.3, 1.0, 10.0)),
    ("steps", None),
)  # fmt: skip
"""Costs that are tried, with the price of a regrasp [m]."""


class Candidate(NamedTuple):
    """One plan that was considered."""

    plan: Plan
    """The plan."""
    cost: str
    """The cost for which it is optimal, one of `motion.plan_parts.COSTS`."""
    price: float | None
    """The price of a regrasp, with `"weighted"` [m]."""
    seconds: float
    """How long its steps take [s]."""


@checked({**QUERY, "timing": TIMING})
def step_durations(
    graph: StanceGraph, plan: Plan, timing: Limits | Durations | None = None
) -> list[float]:
    """How long each step of a plan takes [s].

    Parameters
    ----------
    graph
        The stance graph of the plan's robot and map.
    plan
        The plan.
    timing
        `Limits`, by default the default ones, or `Durations`.
    """
    found = []
    for index in range(len(plan.steps)):
        path = RegraspPath(graph, planned_regrasp(graph, plan, index))
        found.append(sum(map(duration_of, timed_path(path, timing).clocks)))
    return found


@checked({**QUERY, "planner": Of(Planner), "limits": Maybe(Of(Limits))})
def fastest_plan(
    planner: Planner,
    start: Sequence[str | int],
    goal: Sequence[float] | Array,
    limits: Limits | None = None,
    *,
    goal_tolerance: float = GOAL_TOLERANCE,
    goal_face: str | None = None,
) -> list[Candidate]:
    """Plans for one query, the fastest first; equally fast ones with less translation first.

    Parameters
    ----------
    planner
        Plans on the graph.
    start
        Point id (or index) of each limb.
    goal
        x, y, z in the JEM frame [m].
    limits
        What the steps may ask for; by default the default ones.
    goal_tolerance
        Radius of the goal region [m].
    goal_face
        Face of the map whose points all limbs hold at the goal.

    Raises
    ------
    NoPlanError
        If there is no plan.
    MlivrError
        If an argument cannot be used; the message names it.

    Example:
        >>> best = fastest_plan(planner, ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42))[0]
        >>> best.seconds, best.plan.base_translation
    """
    found: dict[tuple[object, ...], Candidate] = {}
    for cost, price in COSTS:
        plan = planner.plan(
            start, goal, cost, regrasp_price=price, goal_tolerance=goal_tolerance,
            goal_face=goal_face,
        ).unwrap()  # fmt: skip
        if plan.stances not in found:
            seconds = sum(step_durations(planner.graph, plan, limits))
            found[plan.stances] = Candidate(plan, cost, price, seconds)
    return sorted(found.values(), key=lambda one: (one.seconds, one.plan.base_translation))
