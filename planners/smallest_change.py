"""The smallest changes with which a goal can be reached, of several kinds, compared.

A change takes obstacles or occupied points away, lowers the threshold of w_m, adds points on rails,
or gives the robot one limb more. Changes are compared by the number of things that change. Each has
been verified: a plan exists in the changed world.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.planners.additions import (
    one_more_limb,
    places_on_rails,
    points_to_add,
    with_candidates,
)
from mlivr_gym.planners.planner import Planner
from mlivr_gym.planners.query import GOAL_TOLERANCE, MAX_EXPANSIONS, QUERY, Goal
from mlivr_gym.planners.why_not import is_plan_found, lower_threshold, removals
from mlivr_gym.schema import OrNone
from mlivr_gym.stances.build import in_same_world, stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.grasp_map import MAP, GraspMap

OBSTACLES, THRESHOLD, POINTS, LIMB = KINDS = ("obstacles", "limb_threshold", "points", "limb")
"""Kinds of changes; of two of equal size, that of the earlier kind comes first."""


class Change(NamedTuple):
    """A change with which a plan exists."""

    kind: str
    """One of `KINDS`."""
    parts: tuple[str, ...]
    """What changes: the ids of obstacles and occupied points that go, the threshold of w_m, the ids
    of the points that are added, or the name of the robot with one limb more."""
    is_smallest: bool
    """Whether it is proved that no fewer parts of this kind, or no higher threshold, suffice."""
    steps: int | None = None
    """Fewest steps of a plan in the changed world; None for a robot with one limb more."""
    alternatives: tuple[str, ...] = ()
    """Ids of all points of which each one suffices, too, if one point is added."""

    @property
    def size(self) -> int:
        """Return the number of things that change."""
        return len(self.parts)

    @property
    def message(self) -> str:
        """Return the change in words, after which a plan exists."""
        named = ", ".join(self.parts)
        others = len(self.alternatives) - 1
        return {
            OBSTACLES: f"without {named}",
            THRESHOLD: f"with limb_threshold={named}",
            POINTS: f"with {named} added" + (f" (or one of {others} others)" if others > 0 else ""),
            LIMB: f"with robot {named}",
        }[self.kind]


@checked({**QUERY, "candidates": OrNone(MAP)})
def smallest_changes(
    graph: StanceGraph,
    start: Sequence[str | int] | State,
    goal: Sequence[float] | Array,
    candidates: GraspMap | None = None,
    *,
    goal_tolerance: float = GOAL_TOLERANCE,
    goal_face: str | None = None,
    limit: int = 2000,
    progress: Callable[[int], None] | None = None,
) -> tuple[Change, ...]:
    """Return the smallest change of each kind with which a goal can be reached, the smallest first.

    With more than two limbs, only a robot with one limb more is tried.

    Start and goal are those of `Planner.plan`, for which no plan exists; the candidates are by
    default the `places_on_rails` of the map. With one limb more, at most `limit` states are
    expanded; `progress` is called with the number of candidates tried alone. The result has at most
    one change of each of `KINDS`, none if none of them alone is enough. Raises an `MlivrError` if
    an argument cannot be used, or the start cannot be held.
    """
    state = graph.validated_state(start) if isinstance(start, State) else graph.state(start)
    target = Goal.from_arguments(graph, goal, "steps", None, goal_tolerance, goal_face)
    region: dict[str, Any] = {"goal_tolerance": goal_tolerance, "goal_face": goal_face}
    found = []
    if isinstance(graph, TwoLimbGraph):
        for change, world in (
            *_fewer_obstacles(graph, state, target),
            *_lower_threshold(graph, state, target),
            *_more_points(graph, state, target, candidates, progress),
        ):
            here = world.state(world.indices(graph.ids(state.stance)), state.pose)
            plan = Planner(world).plan(here, goal, "steps", **region).unwrap()
            found.append(change._replace(steps=len(plan.steps)))
    more = one_more_limb(graph, state, goal, limit=limit, **region)
    if more is not None and more.has_plan:
        found.append(Change(LIMB, (more.robot,), True))
    return tuple(sorted(found, key=lambda change: (change.size, KINDS.index(change.kind))))


Changed = Iterator[tuple[Change, StanceGraph]]
"""A change and the graph of the changed world, or none."""


def _fewer_obstacles(graph: TwoLimbGraph, start: State, goal: Goal) -> Changed:
    """Yield the fewest obstacles and occupied points without which a plan exists."""
    if graph.obstacles or graph.occupied:
        free = stance_graph(graph.grasp_map, graph.robot, graph.settings)
        if is_plan_found(free, start, goal, MAX_EXPANSIONS):
            ids, is_smallest, world = removals(graph, start, goal, MAX_EXPANSIONS)
            yield Change(OBSTACLES, ids, is_smallest), world


def _lower_threshold(graph: TwoLimbGraph, start: State, goal: Goal) -> Changed:
    """Yield the highest threshold of w_m with which a plan exists."""
    if graph.settings.manipulability:
        value = lower_threshold(graph, start, goal, MAX_EXPANSIONS)
        if value is not None:
            settings = replace(graph.settings, limb_threshold=value)
            world = in_same_world(graph, settings=settings)
            yield Change(THRESHOLD, (f"{value:g}",), True), world


def _more_points(
    graph: TwoLimbGraph,
    start: State,
    goal: Goal,
    candidates: GraspMap | None,
    progress: Callable[[int], None] | None,
) -> Changed:
    """Yield the fewest points to be added with which a plan exists."""
    places = places_on_rails(graph.grasp_map) if candidates is None else candidates
    if places is None:
        return
    region: dict[str, Any] = {"goal_tolerance": goal.tolerance, "goal_face": goal.face}
    found = points_to_add(graph, start, goal.target, places, progress=progress, **region)
    if found.points:
        chosen = places.subset(np.isin(places.ids, found.points))
        whole = with_candidates(graph.grasp_map, chosen)
        change = Change(POINTS, found.points, found.is_smallest, alternatives=found.alone)
        yield change, in_same_world(graph, grasp_map=whole)
