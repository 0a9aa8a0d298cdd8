"""The fastest of several plans for one query, and the one with the least reaction on the station.

The duration of a step and its reaction depend on the branches, joint angles and swing to which a
plan commits, not on the edge of the stance graph alone. They are therefore no edge costs, and A*
does not apply. Instead, plans that are optimal for several costs, from the base displacement over
several prices of a regrasp to the number of steps, are given time scalings (`simulation.timing`),
and compared. The first one is the best of these candidates; no bound on other plans is known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from typing import NamedTuple

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import TimingError
from mlivr_gym.extensions.reaction.reaction import Reaction, reaction_of
from mlivr_gym.motion import Durations, JointPath, Plan, Step, StepEnds
from mlivr_gym.motion.commitment import commitments
from mlivr_gym.motion.plan_parts import step_along
from mlivr_gym.planners import GOAL_TOLERANCE, QUERY, Planner
from mlivr_gym.planners.refinement import varied
from mlivr_gym.schema import Choice, OrNone
from mlivr_gym.simulation import Limits
from mlivr_gym.simulation.timing import TIMING, timed_path
from mlivr_gym.stances import StanceGraph

COSTS = (
    ("base", None), *(("weighted", price) for price in (0.01, 0.03, 0.1, 0.3, 1.0, 10.0)),
    ("steps", None),
)  # fmt: skip
"""Costs of the candidate plans, each with the price of a regrasp [m]."""


RANKS = ("time", "reaction")
"""What makes a candidate the best: its duration, or its total impulse on the station."""


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
    impulse: float
    """Total impulse of all steps on the station, see `reaction` [N s]."""
    peak_force: float
    """Largest force on the station that the planned motion needs [N]."""


@checked({**QUERY, "timing": TIMING})
def step_reactions(
    graph: StanceGraph, plan: Plan, timing: Limits | Durations | None = None
) -> list[Reaction]:
    """Return duration, total impulse and peak force of each step of a plan.

    The graph is that of the plan's robot and map; the timing is by default `Limits()`. Raises a
    `TimingError` if durations violate a limit.
    """
    paths = (plan.joint_path(k) for k in range(len(plan.steps)))
    return [reaction_of(timed_path(path, timing)) for path in paths]


@checked({**QUERY, "timing": TIMING})
def with_least_reaction(
    graph: StanceGraph, plan: Plan, timing: Limits | Durations | None = None
) -> Plan:
    """Return a plan on the same footholds with little total impulse on the station.

    Base poses, and with them the base paths, are varied at random with a fixed seed, which finds no
    proven minimum. Then each step takes the clear swing of least total impulse: the given one or
    one of those of `motion.swings`, without `"changed"` ones. A plan whose base poses stay is
    returned if it is no worse.

    The graph is that of the plan's robot and map, with its obstacles; the timing is by default
    `Limits()`. Raises a `TimingError` if durations violate a limit with the given plan, and a
    `PlanError` if the plan belongs to another map or robot, or is not possible in the present
    world.
    """
    step_reactions(graph, plan, timing)  # refuses durations that violate a limit

    def impulse(path: JointPath) -> float:
        try:
            return reaction_of(timed_path(path, timing)).impulse
        except TimingError:
            return inf

    def total(plan: Plan) -> float:
        return sum(impulse(plan.joint_path(k)) for k in range(len(plan.steps)))

    both = plan, varied(graph, plan, impulse)
    return min((_with_best_swings(graph, one, impulse) for one in both), key=total)


def _with_best_swings(
    graph: StanceGraph, plan: Plan, impulse: Callable[[JointPath], float]
) -> Plan:
    """Return a plan with the swing of least total impulse for each step, see above.

    Stances, base poses and branches stay, so that the choice is independent for each step.
    """
    motion, steps = plan.motion, list[Step]()
    for k, step in enumerate(plan.steps):
        best, least = step, impulse(plan.joint_path(k))
        for path, swing in commitments(graph, StepEnds.of(graph, motion, k)):
            if path is not None and impulse(path) < least:
                best, least = step_along(step, path, swing), impulse(path)
        steps.append(best)
    return replace(plan, motion=replace(motion, steps=tuple(steps)))


@checked({
    **QUERY, "planner": InstanceOf(Planner), "limits": OrNone(InstanceOf(Limits)),
    "best": Choice(RANKS),
})  # fmt: skip
def ranked_plans(
    planner: Planner,
    start: Sequence[str | int],
    goal: Sequence[float] | Array,
    limits: Limits | None = None,
    best: str = "time",
    *,
    goal_tolerance: float = GOAL_TOLERANCE,
    goal_face: str | None = None,
) -> list[Candidate]:
    """Plan a query for several costs; return the candidates, the best first.

    The arguments are those of `Planner.plan`, with limits of the steps, by default `Limits()`.
    `best` says which candidate is best: `"time"`, the fastest, or `"reaction"`, that with the least
    total impulse on the station, with the base poses and swings of `with_least_reaction`. The
    candidates, at least one, have different stances; of equally good ones that with less base
    translation comes first.

    Raises a `NoPlanError` if no plan exists, and a `MlivrError` that names the argument if one is
    invalid.

    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> from mlivr_gym.planners import Planner
    >>> candidates = ranked_plans(Planner(stance_graph()), ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42))
    >>> candidates[0].seconds <= candidates[-1].seconds
    True
    """
    candidates: dict[tuple[object, ...], Candidate] = {}
    for cost, price in COSTS:
        plan = planner.plan(
            start, goal, cost, regrasp_price=price,
            goal_tolerance=goal_tolerance, goal_face=goal_face,
        ).unwrap()  # fmt: skip
        if plan.stances not in candidates:
            if best == "reaction":
                plan = with_least_reaction(planner.graph, plan, limits)
            reactions = step_reactions(planner.graph, plan, limits)
            candidates[plan.stances] = Candidate(
                plan, cost, price,
                sum(one.seconds for one in reactions),
                sum(one.impulse for one in reactions),
                max((one.peak_force for one in reactions), default=0.0),
            )  # fmt: skip

    def rank(one: Candidate) -> tuple[float, float]:
        return (one.seconds if best == "time" else one.impulse), one.plan.base_translation

    return sorted(candidates.values(), key=rank)
