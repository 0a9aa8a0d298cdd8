"""The smallest changes with which a goal can be reached, of two kinds, compared.

A change takes obstacles or occupied points away, or lowers the threshold of w_m. Changes are
compared by the number of things that change. Each has been verified: a plan exists in the changed
world.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from mlivr_gym import stance_graph
from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.planners import GOAL_TOLERANCE, QUERY, Planner
from mlivr_gym.stances import StanceGraph, State, in_same_world

OBSTACLES, THRESHOLD = KINDS = ("obstacles", "limb_threshold")
"""Kinds of changes; of two of equal size, that of the earlier kind comes first."""

THRESHOLD_RESOLUTION = 0.002
"""Resolution of the threshold of w_m with which a plan exists."""

MOST_CONFLICTS = 60
"""Maximum number of conflicts by which the fewest obstacles in the way are sought."""

T = TypeVar("T")


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
    if not graph.lists_all:
        raise SettingError(f"smallest changes need two limbs; robot {graph.robot.name!r} has more")
    state = graph.validated_state(start) if isinstance(start, State) else graph.state(start)
    region: dict[str, Any] = {"goal_tolerance": goal_tolerance, "goal_face": goal_face}

    def steps(world: StanceGraph) -> int | None:
        """Return the fewest steps of a plan in a world, None if there is none."""
        try:
            start_state = world.state(world.indices(graph.ids(state.stance)), state.pose)
        except StanceError:
            return None
        plan = Planner(world).plan(start_state, goal, "steps", **region).plan
        return None if plan is None else len(plan.steps)

    changes = [*_fewer_obstacles(graph, steps), *_lower_threshold(graph, steps)]
    return tuple(sorted(changes, key=lambda change: (change.size, KINDS.index(change.kind))))


Steps = Callable[[StanceGraph], int | None]
"""Fewest steps of a plan in a world, None if there is none."""


def _fewer_obstacles(graph: StanceGraph, steps: Steps) -> Iterator[Change]:
    """Yield the fewest obstacles and occupied points without which a plan exists.

    The problem is known as minimum constraint removal (Hauser, The International Journal of
    Robotics Research 33, 2014).
    """
    free = stance_graph(graph.grasp_map, graph.robot, graph.settings)
    boxes = {box.id: box for box in graph.obstacles}
    points = dict(zip(graph.ids(sorted(graph.occupied)), sorted(graph.occupied), strict=True))

    def without(removed: list[str]) -> int | None:
        """Return the steps of a plan without some obstacles and occupied points."""
        free.remove_obstacles()
        free.vacate()
        free.add_obstacles([box for name, box in boxes.items() if name not in removed])
        free.occupy([point for name, point in points.items() if name not in removed])
        return steps(free)

    every = [*boxes, *points]
    if every and without(every) is not None:
        found, is_proved = minimum_subset(every, lambda removed: without(removed) is not None)
        yield Change(OBSTACLES, tuple(found), is_proved, without(found) or 0)


def _lower_threshold(graph: StanceGraph, steps: Steps) -> Iterator[Change]:
    """Yield the highest threshold of w_m with which a plan exists, by bisection."""

    def threshold(count: int) -> float:
        return round(count * THRESHOLD_RESOLUTION, 9)

    def steps_with(count: int) -> int | None:
        """Return the steps of a plan with a threshold of some units."""
        settings = replace(graph.settings, limb_threshold=threshold(count))
        return steps(in_same_world(graph, settings=settings))

    best = steps_with(0) if graph.settings.manipulability else None
    if best is None:
        return
    low, high = 0, int(np.ceil(graph.settings.limb_threshold / THRESHOLD_RESOLUTION))
    while high - low > 1:
        middle = (low + high) // 2
        found = steps_with(middle)
        low, high, best = (low, middle, best) if found is None else (middle, high, found)
    yield Change(THRESHOLD, (f"{threshold(low):g}",), True, best)


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
