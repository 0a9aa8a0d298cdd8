"""Why there is no plan: the rule that cuts the goal off, and what would help.

Each rule is left out in turn (obstacles, collisions, thresholds, joint limits, step checks) and the
query repeated; then the rules are left out cumulatively in this order. The first relaxation with a
plan gives the cause.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mlivr_gym.errors import StanceError
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.outcome import GOAL_REACHED
from mlivr_gym.planners.query import Goal, SearchOptions, SearchQuery
from mlivr_gym.planners.searches import GraphSearcher
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.transitions.state import State

OBSTACLES, JOINTS = "obstacles and occupied points", "joint limits"
"""Names of the rules that are no settings."""

RULES = {
    OBSTACLES: ({}, "removing some of them may help"),
    "collisions": ({"collisions": False}, "a smaller clearance or a slimmer robot may help"),
    "thresholds": ({"manipulability": False}, "lower thresholds of w_m or w_b may help"),
    JOINTS: (
        {},
        "support limbs would leave their joint windows: wider joint_limits or other "
        "window_starts may help",
    ),
    "steps": (
        {"transitions": False},
        "stances at the goal exist, but support limbs would leave their branches or fall below "
        "path_floor along steps: a lower path_floor may help",
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

    Parameters
    ----------
    graph
        The stance graph on which a search found no plan.
    start
        The start state.
    goal
        The goal.
    limit
        Maximum number of expansions of each search; for two limbs the answer is exact.
    """
    smallest = _smallest_goal_distance(graph, goal)
    if smallest == np.inf:
        return Cause((), f"no stance holds points of face {goal.face!r} with all limbs")
    if smallest > goal.tolerance:
        on_face = f" on face {goal.face!r}" if goal.face else ""
        return Cause(
            (),
            f"no stance{on_face} has its base within {goal.tolerance:g} m of the goal; the nearest "
            f"is {smallest:.3f} m away: a goal_tolerance of {smallest + 0.0005:.3f} m would "
            "have one",
        )
    names = [name for name in RULES if _has_rule(name, graph)]
    for name in names:
        if _plan_exists(graph, (name,), start, goal, limit):
            return Cause((name,), f"the goal is cut off by {name}: {RULES[name][1]}")
    for last in range(2, len(names) + 1):
        if _plan_exists(graph, tuple(names[:last]), start, goal, limit):
            listed = ", ".join(names[: last - 1]) + f" and {names[last - 1]}"
            return Cause(tuple(names[:last]), f"the goal is cut off by the combination of {listed}")
    return Cause((), "no path of this robot leads to the goal, whatever rule is left out")


def _has_rule(name: str, graph: StanceGraph) -> bool:
    """Return whether a rule applies to a graph."""
    if name == OBSTACLES:
        return bool(graph.obstacles or graph.occupied)
    if name == JOINTS:
        return graph.settings.transitions
    return all(getattr(graph.settings, key) for key in RULES[name][0])


def _smallest_goal_distance(graph: StanceGraph, goal: Goal) -> float:
    """Return the smallest distance of a stance's base to the goal [m]; 0 if it is not known."""
    if not isinstance(graph, TwoLimbGraph):
        return 0.0
    is_goal = (graph.branch_sets > 0).all(axis=1) & goal.on_goal_face(graph.points)
    distances = np.where(is_goal, goal.distance(graph.base_position), np.inf)
    return float(distances.min(initial=np.inf))


def _plan_exists(
    graph: StanceGraph, rules: tuple[str, ...], start: State, goal: Goal, limit: int
) -> bool:
    """Return whether a plan leads to the goal with some rules left out."""
    changes = {key: value for name in rules for key, value in RULES[name][0].items()}
    settings: Settings = replace(graph.settings, **changes)
    relaxed = stance_graph(graph.grasp_map, graph.robot, settings)
    if OBSTACLES not in rules:
        relaxed.add_obstacles(graph.obstacles)
        relaxed.occupy(sorted(graph.occupied))
    if JOINTS in rules:
        relaxed.checks.ignore_joint_limits()
    try:
        relaxed_start = relaxed.state(start.stance, start.pose)
    except StanceError:
        return False
    step_goal = replace(goal, cost=Cost.named("steps"))
    search = SearchQuery.from_options(relaxed, step_goal, SearchOptions(limit=limit))
    # Stance sets are not worth building for a single query.
    result = GraphSearcher(relaxed, build_sets=False).find(search, relaxed_start)
    return result is not None and result.status == GOAL_REACHED
