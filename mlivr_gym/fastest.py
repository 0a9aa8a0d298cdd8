"""The fastest of several plans for one query.

The duration of a step depends on the branches, joint angles and swing to which a plan commits, not
on the edge of the stance graph alone. Time is therefore not an edge cost, and A* does not apply.
Instead, plans that are optimal for several costs, from the base displacement over several prices of
a regrasp to the number of steps, are given time scalings (`simulation.timing`), and the fastest one
is returned first. It is the best of these candidates; no bound on other plans is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.regrasp import RegraspPath, planned_regrasp
from mlivr_gym.motion.time_scaling import Durations, duration_of
from mlivr_gym.planners import Planner
from mlivr_gym.planners.query import GOAL_TOLERANCE, QUERY
from mlivr_gym.schema import OrNone
from mlivr_gym.simulation.limits import Limits
from mlivr_gym.simulation.timing import TIMING, timed_path
from mlivr_gym.stances.stance_graph import StanceGraph

COSTS = (
    ("base", None), *(("weighted", price) for price in (0.01, 0.03, 0.1, 0.3, 1.0, 10.0)),
    ("steps", None),
)  # fmt: skip
"""Costs of the candidate plans, each with the price of a regrasp [m]."""


class Candidate(NamedTuple):
    """One candidate plan."""

    plan: Plan
    """The plan."""
    cost: str
    """The cost for which the plan is optimal, one of `motion.plan_parts.COSTS`."""
    price: float | None
    """The price of a regrasp if the cost is `"weighted"` [m], otherwise None."""
    seconds: float
    """Duration of all steps [s]."""


@checked({**QUERY, "timing": TIMING})
def step_durations(
    graph: StanceGraph, plan: Plan, timing: Limits | Durations | None = None
) -> list[float]:
    """Return the duration of each step of a plan [s].

    Parameters
    ----------
    graph
        The stance graph of the plan's robot and map.
    plan
        The plan.
    timing
        `Limits`, by default `Limits()`, or `Durations`.

    Raises
    ------
    TimingError
        If durations violate a limit.
    """
    durations = []
    for index in range(len(plan.steps)):
        path = RegraspPath(graph, planned_regrasp(graph, plan, index))
        durations.append(sum(map(duration_of, timed_path(path, timing).time_scalings)))
    return durations


@checked({**QUERY, "planner": InstanceOf(Planner), "limits": OrNone(InstanceOf(Limits))})
def fastest_plan(
    planner: Planner,
    start: Sequence[str | int],
    goal: Sequence[float] | Array,
    limits: Limits | None = None,
    *,
    goal_tolerance: float = GOAL_TOLERANCE,
    goal_face: str | None = None,
) -> list[Candidate]:
    """Plan a query for several costs; return the candidates, the fastest first.

    Of equally fast candidates the one with less base translation comes first.

    Parameters
    ----------
    planner
        The planner, with its stance graph.
    start
        Id or index of the point that each limb holds at the start.
    goal
        Goal position of the base in the module frame, shape (3,) [m].
    limits
        Limits of the steps; by default `Limits()`.
    goal_tolerance
        Radius of the goal region [m].
    goal_face
        Face of the map on which all limbs must hold points at the goal; None for any face.

    Returns
    -------
    list[Candidate]
        Candidates with different stances, at least one.

    Raises
    ------
    NoPlanError
        If no plan exists.
    MlivrError
        If an argument is invalid; the message names it.

    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> from mlivr_gym.planners import Planner
    >>> candidates = fastest_plan(Planner(stance_graph()), ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42))
    >>> candidates[0].seconds <= candidates[-1].seconds
    True
    """
    candidates: dict[tuple[object, ...], Candidate] = {}
    for cost, price in COSTS:
        plan = planner.plan(
            start, goal, cost, regrasp_price=price, goal_tolerance=goal_tolerance,
            goal_face=goal_face,
        ).unwrap()  # fmt: skip
        if plan.stances not in candidates:
            seconds = sum(step_durations(planner.graph, plan, limits))
            candidates[plan.stances] = Candidate(plan, cost, price, seconds)
    return sorted(candidates.values(), key=lambda one: (one.seconds, one.plan.base_translation))
