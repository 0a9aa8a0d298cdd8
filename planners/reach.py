"""Reach of a start: which points the limbs can grasp, and after how many steps at least."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import IntArray
from mlivr_gym.planners.query import EXPANSIONS, MAX_EXPANSIONS, QUERY
from mlivr_gym.schema import Integer, OrNone
from mlivr_gym.stances.critical import edges_of, parts_of
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.transitions.state import State

NOT_REACHED = -1
"""Steps of a point that was not reached."""


class Reach(NamedTuple):
    """The points that a robot can grasp from a start."""

    start: tuple[str, ...]
    """Points held at the start."""
    steps: NDArray[np.int64]
    """Fewest steps after which a limb holds each point, `NOT_REACHED` if none does, shape (m,)."""
    expanded: int
    """Number of states expanded."""
    is_complete: bool
    """Whether the other points are proved to be out of reach, however many steps are made."""


@checked({**QUERY, "most_steps": OrNone(Integer(0, MAX_EXPANSIONS))})
def reach_from(
    graph: StanceGraph,
    start: Sequence[str | int] | State,
    most_steps: int | None = None,
    limit: int = EXPANSIONS,
    progress: Callable[[int], None] | None = None,
) -> Reach:
    """Return after how many steps each point can be grasped from a start.

    This is breadth-first search over states, so every step is one that the robot can make on a
    branch that its limbs may be on. A state is left out if one of the same stance with all of its
    branches was reached before.

    The search ends after `most_steps` steps, or `limit` states expanded; `progress` is called with
    their number. Raises an `MlivrError` if an argument cannot be used, or the start cannot be held.


    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> reach = reach_from(stance_graph("truss", "ssrms2"), ("forward:1", "forward:3"))
    >>> int((reach.steps >= 0).sum()), int(reach.steps.max())
    (48, 2)
    """
    state = graph.validated_state(start) if isinstance(start, State) else graph.state(start)
    steps = np.full(len(graph.grasp_map), NOT_REACHED, dtype=np.int64)
    steps[list(state.stance)] = 0
    sought = set(points_of_part(graph, state).tolist()).difference(state.stance)
    labels = {state.stance: [state.branch_sets]}
    queue, expanded = deque([(state, 0)]), 0
    while queue and sought and expanded < limit and queue[0][1] != most_steps:
        before, level = queue.popleft()
        expanded += 1
        if progress is not None:
            progress(expanded)
        found = graph.successors(before)
        for k, point in enumerate(found.point.tolist()):
            after = found.after(before, k)
            known = labels.setdefault(after.stance, [])
            if any(_contains(label, after.branch_sets) for label in known):
                continue
            known.append(after.branch_sets)
            queue.append((after, level + 1))
            if point in sought:
                sought.remove(point)
                steps[point] = level + 1
    return Reach(graph.ids(state.stance), steps, expanded, not (queue and sought))


def points_of_part(graph: StanceGraph, state: State) -> IntArray:
    """Return the points of all stances that edges connect with that of a state, if these are known.

    Other points are out of reach. If the stances are not known, these are all points.
    """
    here = graph.find(state.stance) if isinstance(graph, TwoLimbGraph) else -1
    if not isinstance(graph, TwoLimbGraph) or state.pose is not None or here < 0:
        return np.arange(len(graph.grasp_map))
    part = parts_of(edges_of(graph), np.asarray((graph.branch_sets > 0).all(axis=1)))
    points: IntArray = np.unique(graph.points[part == part[here]])
    return points


def _contains(label: tuple[int, ...], other: tuple[int, ...]) -> bool:
    """Return whether a label has all branches of another one."""
    return all(one & both == both for one, both in zip(label, other, strict=True))
