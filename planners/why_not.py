"""Why there is no plan: the rule that cuts the goal off, and what would help.

Each rule is left out in turn (obstacles, collisions, thresholds, step checks) and the
query repeated; then the rules are left out cumulatively in this order. The first relaxation with a
plan gives the cause.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from mlivr_gym.errors import StanceError
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.outcome import GOAL_REACHED, LIMIT_REACHED
from mlivr_gym.planners.planning_result import too_far
from mlivr_gym.planners.query import Goal, SearchOptions, SearchQuery
from mlivr_gym.planners.searches import GraphSearcher
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import in_same_world, stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

OBSTACLES, THRESHOLDS = "obstacles and occupied points", "thresholds"
"""Names of rules."""

RULES = {
    OBSTACLES: ({}, "removing some of them may help"),
    "collisions": ({"collisions": False}, "a smaller clearance or a slimmer robot may help"),
    THRESHOLDS: ({"manipulability": False}, "lower thresholds of w_m or w_b may help"),
    "steps": (
        {"transitions": False},
        "stances at the goal exist, but along steps support limbs would leave their branches or "
        "joint windows or fall below path_floor: a lower path_floor or wider joint_limits may help",
    ),
}
"""Settings that leave each rule out, and what would help, in the order in which they are left
out."""


class Cause(NamedTuple):
    """The rules that cut a goal off."""

    rules: tuple[str, ...]
    """The rules that must be left out, keys of `RULES`; none if leaving rules out does not help."""
    message: str
    """One sentence for people."""


def find_cause(graph: StanceGraph, start: State, goal: Goal, limit: int) -> Cause:
    """Find the cause why no plan leads from a state to a goal.

    The start state and the goal are those of a search that found no plan. Each search of more than
    two limbs expands at most `limit` states; for two limbs the answer is exact.
    """
    if message := too_far(graph, goal):
        return Cause((), message)
    names, is_decided = [name for name in RULES if _has_rule(name, graph)], True
    for name in names:
        exists = _plan_exists(graph, (name,), start, goal, limit)
        if exists:
            return Cause((name,), f"the goal is cut off by {name}: {RULES[name][1]}")
        is_decided &= exists is not None
    for last in range(2, len(names) + 1):
        exists = _plan_exists(graph, tuple(names[:last]), start, goal, limit)
        if exists:
            listed = ", ".join(names[: last - 1]) + f" and {names[last - 1]}"
            return Cause(tuple(names[:last]), f"the goal is cut off by the combination of {listed}")
        is_decided &= exists is not None
    if not is_decided:
        return Cause((), f"whatever rule is left out, no path was found by {limit} expansions")
    return Cause((), "no path of this robot leads to the goal, whatever rule is left out")


def _has_rule(name: str, graph: StanceGraph) -> bool:
    """Return whether a rule applies to a graph."""
    if name == OBSTACLES:
        return bool(graph.obstacles or graph.occupied)
    return all(getattr(graph.settings, key) for key in RULES[name][0])


def _plan_exists(
    graph: StanceGraph, rules: tuple[str, ...], start: State, goal: Goal, limit: int
) -> bool | None:
    """Return whether a plan leads to the goal with some rules left out, None as below."""
    changes = {key: value for name in rules for key, value in RULES[name][0].items()}
    settings: Settings = replace(graph.settings, **changes)
    if OBSTACLES in rules:
        relaxed: StanceGraph = stance_graph(graph.grasp_map, graph.robot, settings)
    else:
        relaxed = in_same_world(graph, settings=settings)
    return is_plan_found(relaxed, start, goal, limit)


def is_plan_found(graph: StanceGraph, start: State, goal: Goal, limit: int) -> bool | None:
    """Return whether a plan from the stance of a state leads to the goal on a graph.

    None says that the search reached its limit before it found out.
    """
    try:
        start_state = graph.state(start.stance, start.pose)
    except StanceError:
        return False
    step_goal = replace(goal, cost=Cost.named("steps"))
    search = SearchQuery.from_options(graph, step_goal, SearchOptions(limit=limit))
    result = GraphSearcher(graph).find(search, start_state)
    if result is not None and result.status == LIMIT_REACHED:
        return None
    return result is not None and result.status == GOAL_REACHED
