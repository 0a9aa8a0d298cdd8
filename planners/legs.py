"""Search along a route in legs: from each place on it to the next.

A search of more than two limbs is led by the distance to the goal, and spends itself where the way
there is not straight, as round the corners of a station. Along a route each leg is short. A leg
that is not found within its effort is halved; if its first part is not found either, the leg before
it is given up for a longer one (backtracking). A path is not the best one, and failed legs prove
nothing. If none leads away from the start, the search for the goal at once tells why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.planners.outcome import GOAL_REACHED, LIMIT_REACHED, SearchResult
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

LEG, SHORTEST = 3.0, 0.75
"""Length of a leg along the route, and that up to which a leg is not halved [m]."""

LEG_TOLERANCE = 0.8
"""Distance from the end of a leg within which the base may be there [m]."""

LEG_EFFORT = 8_000_000
"""Greatest effort of the search of a leg, see `PathSearch.effort`."""

MOST_FAILED = 60
"""Number of legs that may fail."""

Find = Callable[[SearchQuery, State], SearchResult | None]


@dataclass
class Stop:
    """The end of a leg, or the start."""

    states: tuple[State, ...]
    """The states of the leg, the first of which ends the leg before."""
    distance: float
    """How far along the route it is [m]."""
    longest: float
    """Length of the longest leg that is tried from here [m]."""


def search_by_legs(
    graph: StanceGraph, search: SearchQuery, start: State, find: Find
) -> SearchResult | None:
    """Search from a state along the route of a query, each leg by `find`, which is as this one.

    Returns None if no sequence of moves connects the state with the goal, see `GraphSearcher.find`.
    """
    base, target = graph.posture_of(start).base_position, search.goal.target[None]
    route = np.concatenate([base, np.reshape([*(search.route or ())], (-1, 3)), target])
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(route, axis=0), axis=1)))
    stops, length, end = [Stop((start,), 0.0, LEG)], LEG, float(along[-1])
    failed = expanded = generated = 0
    trees = [np.zeros((0, 2, 3))]
    while stops[-1].distance < end or len(stops) == 1:
        stop = stops[-1]
        # The last leg is up to half as long again as the others, rather than short.
        to = stop.distance + length
        to = end if to + 0.5 * length >= end else to
        place = None if to == end else np.array([np.interp(to, along, axis) for axis in route.T])
        found = find(_leg(search, place, search.limit - expanded), stop.states[-1])
        if found is not None:
            expanded, generated = expanded + found.expanded, generated + found.generated
            trees.append(found.tree)
        if found is not None and found.status == GOAL_REACHED:
            stops.append(Stop(found.states, to, LEG))
            length = LEG
            continue
        failed += 1
        is_over = expanded >= search.limit or search.clock.is_over
        if is_over or failed > MOST_FAILED:
            if len(stops) == 1 and not is_over:
                return find(_leg(search, None, search.limit), start)
            counts = expanded, generated, np.concatenate(trees)
            return SearchResult(LIMIT_REACHED, (start,), 0.0, *counts)
        if length > SHORTEST:
            length *= 0.5
            continue
        if len(stops) > 1:
            stops.pop()
        stops[-1].longest *= 1.5
        length = stops[-1].longest
    states = (start, *(state for stop in stops for state in stop.states[1:]))
    cost = search.goal.cost.of_path(graph.postures_of(states).base_position)
    return SearchResult(GOAL_REACHED, states, cost, expanded, generated, np.concatenate(trees))


def _leg(search: SearchQuery, place: Array | None, limit: int) -> SearchQuery:
    """Return the query of a leg to a place, None for the goal."""
    goal = search.goal
    if place is not None:
        goal = replace(goal, target=place, tolerance=LEG_TOLERANCE, face=None, on_face=None)
    effort = min(search.effort, LEG_EFFORT)
    return replace(search, goal=goal, route=None, limit=limit, effort=effort)
