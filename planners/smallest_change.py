"""The smallest changes with which a goal can be reached, of two kinds, compared.

A change takes obstacles or occupied points away, or lowers the threshold of w_m. Changes are
compared by the number of things that change. Each has been verified: a plan exists in the changed
world.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError
from mlivr_gym.planners.planner import Planner
from mlivr_gym.planners.query import GOAL_TOLERANCE, MAX_EXPANSIONS, QUERY, Goal
from mlivr_gym.planners.why_not import is_plan_found, lower_threshold, removals
from mlivr_gym.stances.build import in_same_world, stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.transitions.state import State

OBSTACLES, THRESHOLD = KINDS = ("obstacles", "limb_threshold")
"""Kinds of changes; of two of equal size, that of the earlier kind comes first."""


class Change(NamedTuple):
    """A change with which a plan exists."""

    kind: str
    """One of `KINDS`."""
    parts: tuple[str, ...]
    """What changes: the ids of obstacles and occupied points that go, or the threshold of w_m."""
    is_smallest: bool
    """Whether it is proved that no fewer parts of this kind, or no higher threshold, suffice."""
    steps: int
    """Fewest steps of a plan in the changed world."""

    @property
    def size(self) -> int:
        """Return the number of things that change."""
        return len(self.parts)

    @property
    def message(self) -> str:
        """Return the change in words, after which a plan exists."""
        named = ", ".join(self.parts)
        return f"without {named}" if self.kind == OBSTACLES else f"with limb_threshold={named}"


@checked(QUERY)
def smallest_changes(
    graph: StanceGraph,
    start: Sequence[str | int] | State,
    goal: Sequence[float] | Array,
    *,
    goal_tolerance: float = GOAL_TOLERANCE,
    goal_face: str | None = None,
) -> tuple[Change, ...]:
    """Return the smallest change of each kind with which a goal can be reached, the smallest first.

    Start and goal are those of `Planner.plan`, for which no plan exists. The result has at most one
    change of each of `KINDS`, none if none of them alone is enough. Raises an `MlivrError` if an
    argument cannot be used, the start cannot be held, or the robot has more than two limbs.
    """
    if not isinstance(graph, TwoLimbGraph):
        raise SettingError(f"smallest changes need two limbs; robot {graph.robot.name!r} has more")
    state = graph.validated_state(start) if isinstance(start, State) else graph.state(start)
    target = Goal.from_arguments(graph, goal, "steps", None, goal_tolerance, goal_face)
    region: dict[str, Any] = {"goal_tolerance": goal_tolerance, "goal_face": goal_face}
    found = []
    for kind, parts, is_smallest, world in (
        *_fewer_obstacles(graph, state, target),
        *_lower_threshold(graph, state, target),
    ):
        here = world.state(world.indices(graph.ids(state.stance)), state.pose)
        plan = Planner(world).plan(here, goal, "steps", **region).unwrap()
        found.append(Change(kind, parts, is_smallest, len(plan.steps)))
    return tuple(sorted(found, key=lambda change: (change.size, KINDS.index(change.kind))))


Changed = Iterator[tuple[str, tuple[str, ...], bool, StanceGraph]]
"""Kind and parts of a change, whether it is the smallest, and the changed world; or none."""


def _fewer_obstacles(graph: TwoLimbGraph, start: State, goal: Goal) -> Changed:
    """Yield the fewest obstacles and occupied points without which a plan exists."""
    if graph.obstacles or graph.occupied:
        free = stance_graph(graph.grasp_map, graph.robot, graph.settings)
        if is_plan_found(free, start, goal, MAX_EXPANSIONS):
            ids, is_smallest, world = removals(graph, start, goal, MAX_EXPANSIONS)
            yield OBSTACLES, ids, is_smallest, world


def _lower_threshold(graph: TwoLimbGraph, start: State, goal: Goal) -> Changed:
    """Yield the highest threshold of w_m with which a plan exists."""
    if graph.settings.manipulability:
        value = lower_threshold(graph, start, goal, MAX_EXPANSIONS)
        if value is not None:
            settings = replace(graph.settings, limb_threshold=value)
            world = in_same_world(graph, settings=settings)
            yield THRESHOLD, (f"{value:g}",), True, world
