"""Why there is no plan: the rule that cuts the goal off, and what would help.

Each rule is left out in turn (obstacles, collisions, thresholds, joint limits, step checks) and the
query repeated; then the rules are left out cumulatively in this order. The first relaxation with a
plan gives the cause. For two limbs, whose queries are exact, the smallest change is found, too:
which obstacles and points must go, or how far the threshold of w_m must fall. Changes of all kinds
are compared in `smallest_change`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from mlivr_gym.errors import StanceError
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.outcome import GOAL_REACHED
from mlivr_gym.planners.planning_result import too_far
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.planners.searches import GraphSearcher
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import in_same_world, stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.transitions.state import State

OBSTACLES, THRESHOLDS, JOINTS = "obstacles and occupied points", "thresholds", "joint limits"
"""Names of rules."""

RULES = {
    OBSTACLES: ({}, "removing some of them may help"),
    "collisions": ({"collisions": False}, "a smaller clearance or a slimmer robot may help"),
    THRESHOLDS: ({"manipulability": False}, "lower thresholds of w_m or w_b may help"),
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


THRESHOLD_RESOLUTION = 0.002
"""Resolution of the threshold of w_m that would have a plan."""

MOST_CONFLICTS = 60
"""Maximum number of conflicts by which the fewest obstacles in the way are sought."""

T = TypeVar("T")


class Cause(NamedTuple):
    """The rules that cut a goal off, and for two limbs a change after which a plan exists."""

    rules: tuple[str, ...]
    """The rules that must be left out, keys of `RULES`; none if leaving rules out does not help."""
    message: str
    """One sentence for people."""
    removed: tuple[str, ...] = ()
    """Ids of obstacles and occupied points without which a plan exists, where these alone cut the
    goal off; see `Removals`."""
    limb_threshold: float | None = None
    """A lower threshold of w_m with which a plan exists, where the thresholds alone cut the goal
    off; a multiple of `THRESHOLD_RESOLUTION`, with no plan at the next higher multiple."""


def find_cause(graph: StanceGraph, start: State, goal: Goal, limit: int) -> Cause:
    """Find the cause why no plan leads from a state to a goal.

    The start state and the goal are those of a search that found no plan. Each search of more than
    two limbs expands at most `limit` states; for two limbs the answer is exact.
    """
    if message := too_far(graph, goal):
        return Cause((), message)
    names = [name for name in RULES if _has_rule(name, graph)]
    for name in names:
        if _plan_exists(graph, (name,), start, goal, limit):
            message = f"the goal is cut off by {name}: {RULES[name][1]}"
            if not isinstance(graph, TwoLimbGraph):
                return Cause((name,), message)
            if name == OBSTACLES:
                removed, is_smallest, _ = removals(graph, start, goal, limit)
                few = ", and not if any more of them stay" if is_smallest else ""
                message = f"the goal is cut off by {name}: a plan exists without "
                return Cause((name,), f"{message}{', '.join(removed)}{few}", removed)
            lower = None if name != THRESHOLDS else lower_threshold(graph, start, goal, limit)
            if lower is not None:
                message += f"; a plan exists with limb_threshold={lower:g}"
            return Cause((name,), message, (), lower)
    for last in range(2, len(names) + 1):
        if _plan_exists(graph, tuple(names[:last]), start, goal, limit):
            listed = ", ".join(names[: last - 1]) + f" and {names[last - 1]}"
            return Cause(tuple(names[:last]), f"the goal is cut off by the combination of {listed}")
    return Cause((), "no path of this robot leads to the goal, whatever rule is left out")


class Removals(NamedTuple):
    """Obstacles and occupied points without which a plan exists."""

    ids: tuple[str, ...]
    """Their ids; there may be other such sets."""
    is_smallest: bool
    """Whether it is proved that no fewer suffice; if not, at least none of them may stay."""
    graph: StanceGraph
    """The graph without them."""


def removals(graph: StanceGraph, start: State, goal: Goal, limit: int) -> Removals:
    """Return the fewest obstacles and occupied points without which a plan exists.

    It exists without all of them. The problem is known as minimum constraint removal (Hauser, The
    International Journal of Robotics Research 33, 2014).
    """
    free = stance_graph(graph.grasp_map, graph.robot, graph.settings)
    boxes = {box.id: box for box in graph.obstacles}
    points = dict(zip(graph.ids(sorted(graph.occupied)), sorted(graph.occupied), strict=True))

    def suffices(removed: list[str]) -> bool:
        """Return whether a plan exists without some obstacles and occupied points."""
        free.remove_obstacles()
        free.vacate()
        free.add_obstacles([box for name, box in boxes.items() if name not in removed])
        free.occupy([point for name, point in points.items() if name not in removed])
        return is_plan_found(free, start, goal, limit)

    found, is_smallest = minimum_subset([*boxes, *points], suffices)
    suffices(found)
    return Removals(tuple(found), is_smallest, free)


def minimum_subset(
    entries: list[T], suffices: Callable[[list[T]], bool], most: int = MOST_CONFLICTS
) -> tuple[list[T], bool]:
    """Return the fewest entries that suffice together, and whether it is proved that they are.

    Each set that does not suffice shows a conflict: entries of which at least one is needed. The
    fewest entries that meet all conflicts so far are tried next (implicit hitting sets:
    Moreno-Centeno and Karp, Operations Research 61, 2013).

    All entries suffice together, and so do any that contain some that `suffices`. Beyond `most`
    conflicts the entries are those of `smallest_subset`.
    """
    enough, conflicts = smallest_subset(entries, suffices), list[list[T]]()
    for size in range(len(enough)):
        while (tried := _hitting(conflicts, size)) is not None:
            if suffices(tried):
                return [one for one in entries if one in tried], True
            if len(conflicts) == most:
                return enough, False
            rest = [one for one in entries if one not in tried]
            conflicts.append(
                smallest_subset(
                    rest, lambda kept: not suffices([one for one in entries if one not in kept])
                )
            )
    return enough, True


def _hitting(conflicts: list[list[T]], size: int) -> list[T] | None:
    """Return at most `size` entries, one of each conflict at least; None if there are none."""
    if not conflicts or not size:
        return None if conflicts else []
    for one in min(conflicts, key=len):
        others = _hitting([entries for entries in conflicts if one not in entries], size - 1)
        if others is not None:
            return [one, *others]
    return None


def smallest_subset(entries: list[T], suffices: Callable[[list[T]], bool]) -> list[T]:
    """Return entries that suffice together, of which none can be spared.

    The algorithm is QuickXplain (Junker 2004), with about `2 k log2(n / k)` tests for k of n
    entries. Earlier entries are preferred to later ones.

    All entries suffice together, and so do any that contain some that `suffices`.
    """

    def needed(given: list[T], is_changed: bool, others: list[T]) -> list[T]:
        if is_changed and suffices(given):
            return []
        if len(others) == 1:
            return others
        first, second = others[: len(others) // 2], others[len(others) // 2 :]
        late = needed(given + first, True, second)
        return needed(given + late, bool(late), first) + late

    return needed([], True, entries) if entries else []


def lower_threshold(graph: StanceGraph, start: State, goal: Goal, limit: int) -> float | None:
    """Return a lower threshold of w_m with which a plan exists, by bisection; None if none does."""

    def has_plan(count: int) -> bool:
        """Return whether a plan exists with a threshold of some units."""
        settings = replace(graph.settings, limb_threshold=count * THRESHOLD_RESOLUTION)
        return is_plan_found(in_same_world(graph, settings=settings), start, goal, limit)

    low, high = 0, int(np.ceil(graph.settings.limb_threshold / THRESHOLD_RESOLUTION))
    if not has_plan(low):
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if has_plan(middle) else (low, middle)
    return round(low * THRESHOLD_RESOLUTION, 9)


def _has_rule(name: str, graph: StanceGraph) -> bool:
    """Return whether a rule applies to a graph."""
    if name == OBSTACLES:
        return bool(graph.obstacles or graph.occupied)
    if name == JOINTS:
        return graph.settings.transitions
    return all(getattr(graph.settings, key) for key in RULES[name][0])


def goal_occupancy(graph: StanceGraph, goal: Sequence[float], tolerance: float) -> str:
    """Return in words how many stances at a goal obstacles and occupied points take away.

    These are the stances with the base at most `tolerance` away from the goal [m]. The text is
    empty if none is taken away; so it is with more than two limbs, where they are not known.
    """
    if not isinstance(graph, TwoLimbGraph):
        return ""
    at_goal = np.linalg.norm(graph.base_position - np.array(goal), axis=1) <= tolerance
    is_held = (graph.branch_sets[at_goal] > 0).all(axis=1)
    count, taken = len(is_held), int(np.sum(~is_held))
    if taken == count:
        return "the goal is occupied" if count else ""
    return f"{taken} of {count} stances at the goal are occupied" if taken else ""


def _plan_exists(
    graph: StanceGraph, rules: tuple[str, ...], start: State, goal: Goal, limit: int
) -> bool:
    """Return whether a plan leads to the goal with some rules left out."""
    changes = {key: value for name in rules for key, value in RULES[name][0].items()}
    settings: Settings = replace(graph.settings, **changes)
    if OBSTACLES in rules:
        relaxed: StanceGraph = stance_graph(graph.grasp_map, graph.robot, settings)
    else:
        relaxed = in_same_world(graph, settings=settings)
    if JOINTS in rules:
        relaxed.checks.ignore_joint_limits()
    return is_plan_found(relaxed, start, goal, limit)


def is_plan_found(graph: StanceGraph, start: State, goal: Goal, limit: int) -> bool:
    """Return whether a plan from the stance of a state leads to the goal on a graph."""
    try:
        here = graph.state(start.stance, start.pose)
    except StanceError:
        return False
    step_goal = replace(goal, cost=Cost.named("steps"))
    search = SearchQuery.from_options(graph, step_goal, limit=limit)
    # Stance sets are not worth building for a single query.
    result = GraphSearcher(graph, build_sets=False).find(search, here)
    return result is not None and result.status == GOAL_REACHED
