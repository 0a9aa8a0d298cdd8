"""The result of a planning query: a plan, or the reason why there is none."""

from __future__ import annotations

import time
from dataclasses import dataclass

from mlivr_gym.arrays import Array
from mlivr_gym.errors import NoPlanError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners.outcome import LIMIT_REACHED, SEARCH_EXHAUSTED, Improvement, SearchResult
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

START_INFEASIBLE, GOAL_UNREACHABLE, NO_SWING = (
    "start infeasible", "goal outside the reachable set", "no swing",
)  # fmt: skip
"""Reasons why there is no plan, in addition to the ends of a search in `outcome`."""

PROVED_IMPOSSIBLE = GOAL_UNREACHABLE, SEARCH_EXHAUSTED
"""Reasons that prove that no plan exists; `Planner.why_not` finds the cause."""


class Timer:
    """Time spent on checking the start state, and on the search."""

    def __init__(self) -> None:
        """Start at 0."""
        self.start_time, self.start_state, self.search = time.perf_counter(), 0.0, 0.0

    def lap(self) -> float:
        """Return the time since the last call, or since the timer was made [s]."""
        before, self.start_time = self.start_time, time.perf_counter()
        return self.start_time - before


@dataclass(frozen=True, repr=False)
class PlanningResult:
    """A plan, or the reason why there is none, with the statistics of the search."""

    plan: Plan | None
    """The plan, or None."""
    reason: str
    """`""` for a plan, otherwise `"start infeasible"`, `"goal outside the reachable set"`, `"search
    exhausted"`, `"limit reached"` or `"no swing"`."""
    message: str
    """One sentence for people."""
    expanded: int
    """Number of states expanded."""
    generated: int
    """Number of states put into the open queue."""
    feasibility_time: float
    """Time spent on checking the start state [s]."""
    search_time: float
    """Time spent on the search and on step checks [s]."""
    tree: Array
    """Base positions at both ends of the steps that the last search explored, (e, 2, 3) [m]."""
    improvements: tuple[Improvement, ...] = ()
    """The paths found in turn, each cheaper than the one before, with the times at which they were
    found; the last one is that of the plan."""

    def __repr__(self) -> str:
        """Return the message in one line."""
        return f"<PlanningResult: {self.message}>"

    def __bool__(self) -> bool:
        """Return whether there is a plan."""
        return self.plan is not None

    def unwrap(self) -> Plan:
        """Return the plan; raise a `NoPlanError` that says why if there is none."""
        if self.plan is None:
            raise NoPlanError(self.message)
        return self.plan


def too_far(graph: StanceGraph, goal: Goal) -> str:
    """Return the message about a goal near which no stance has its base, empty if one has.

    It is empty for more than two limbs, too, whose stances are not all known.
    """
    if not graph.lists_all:
        return ""
    is_goal = (graph.branch_sets > 0).all(axis=1) & goal.on_goal_face(graph.points)
    if not is_goal.any():  # it may be that all points are occupied
        of_face = f"no stance holds points of face {goal.face!r} with all limbs"
        return "" if goal.face is None else of_face
    smallest = float(goal.distance(graph.base_position)[is_goal].min())
    if smallest <= goal.tolerance:
        return ""
    on_face = f" on face {goal.face!r}" if goal.face else ""
    return (
        f"no stance{on_face} has its base within {goal.tolerance:g} m of goal "
        f"{goal.target.tolist()}; the nearest is {smallest:.3f} m away: a goal_tolerance of "
        f"{smallest + 0.0005:.3f} m would have one"
    )


def not_connected(graph: StanceGraph, goal: Goal) -> str:
    """Return the message about a goal that no sequence of moves connects with the start."""
    return too_far(graph, goal) or (
        f"no stance that can be reached from the start has its base within {goal.tolerance:g} m of "
        f"goal {goal.target.tolist()}"
    )


def no_swing(graph: StanceGraph, before: State, after: State) -> str:
    """Return the message about an edge of the graph for which no swing was found."""
    return (
        f"no swing was found from {graph.ids(before.stance)} to {graph.ids(after.stance)}, "
        f"although the edge passed its checks"
    )


def why_no_path(
    graph: StanceGraph, result: SearchResult, search: SearchQuery, start_state: State
) -> str:
    """Return the message about a search that ended without reaching the goal."""
    start, goal = graph.ids(start_state.stance), search.goal.target.tolist()
    detail = f" after {result.expanded} expansions, no path from {start} to {goal}"
    if result.status == LIMIT_REACHED and not result.expanded:
        detail = (
            ": the tables of this robot on this map, or the bounds of this goal, were not computed "
            f"within {search.time_limit:g} s; plan again, or for longer"
        )
    elif not result.expanded and (start_state.pose is None or graph.successors(start_state)):
        detail = f": no sequence of moves leads from {start} to {goal}, on whatever branches"
    elif result.generated <= 1:
        detail = f": no step leaves the start {start} on the branches that its limbs may be on"
    return f"{result.status}{detail}"


def without_plan(
    reason: str, message: str, timer: Timer, result: SearchResult | None = None
) -> PlanningResult:
    """Return a result without a plan."""
    result = result or SearchResult(reason, ())
    counts, times = (result.expanded, result.generated), (timer.start_state, timer.search)
    return PlanningResult(None, reason, message, *counts, *times, result.tree)
