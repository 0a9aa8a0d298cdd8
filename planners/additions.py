"""What would make a goal reachable: points added to the map, or a robot with one more limb."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import MapError, SettingError, StanceError
from mlivr_gym.planners.outcome import GOAL_REACHED
from mlivr_gym.planners.query import GOAL_TOLERANCE, QUERY, Goal, SearchQuery
from mlivr_gym.planners.searches import GraphSearcher
from mlivr_gym.planners.why_not import smallest_subset
from mlivr_gym.robot.specification import ROBOTS, robot_spec
from mlivr_gym.schema import FieldPath, OrNone
from mlivr_gym.stances.build import in_same_world
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.stances.two_limb_rows import connected_parts
from mlivr_gym.transitions.state import State
from mlivr_gym.values import MAX_POINTS
from mlivr_gym.world.grasp_map import MAP, GraspMap
from mlivr_gym.world.map_entries import SPACING, Row, clear_of_handrails, discretise

HALF_SPACING = 0.1
"""Spacing of candidates along rails, half of that of the points of the JEM [m]."""

SAME = 1e-3
"""Distance from a point of the map below which a place on a rail is no candidate [m]."""

HANDRAIL_CLEARANCE = 0.03
"""Smallest distance of a candidate from handrails, as for the points of a map [m]."""

MOST_STARTS = 100
"""Maximum number of points that are tried for another limb at the start."""


class AddedPoints(NamedTuple):
    """Points with which a plan exists."""

    points: tuple[str, ...]
    """Ids of candidates that suffice together; none if even all of them do not."""
    alone: tuple[str, ...]
    """Ids of all candidates of which each one suffices alone, in the order of the candidates."""
    candidates: GraspMap
    """The candidates that were tried."""
    is_smallest: bool
    """Whether it is proved that no fewer of the candidates suffice."""

    @property
    def message(self) -> str:
        """One sentence for people."""
        tried = f"of {len(self.candidates)} candidates"
        if not self.points:
            return f"{tried} for points to be added not even all together would help"
        if self.alone:
            return f"{tried} each of these would help alone: {', '.join(self.alone)}"
        proof = "no fewer do" if self.is_smallest else "none of them can be spared"
        return f"{tried} these would help together: {', '.join(self.points)} ({proof})"


class MoreLimbs(NamedTuple):
    """A search with a robot that has one limb more."""

    robot: str
    """Name of the robot."""
    start: tuple[str, ...]
    """Its start, the points held and one more; empty if it holds none of those tried."""
    status: str
    """How the search ended, see `outcome`; empty if a plan was found or there is no start."""

    @property
    def has_plan(self) -> bool:
        """Whether a plan was found."""
        return bool(self.start) and self.status == GOAL_REACHED

    @property
    def message(self) -> str:
        """One sentence for people."""
        if not self.start:
            return f"robot {self.robot!r} could hold no more point at the start"
        end = "reach the goal" if self.has_plan else f"not be shown to reach it: {self.status}"
        return f"robot {self.robot!r} would {end}, from {' '.join(self.start)}"


@checked({"grasp_map": MAP, "spacing": SPACING})
def places_on_rails(grasp_map: GraspMap, spacing: float = HALF_SPACING) -> GraspMap | None:
    """Return the places on the rails of a map where it has no point, None if there are none.

    They lie at multiples of a spacing from the middle of each rail, clear of handrails, and have
    the id of the rail with the signed distance from its middle in millimetres.

    Raises an `MlivrError` if the spacing [m] is not valid, or a rail would have too many places.


    Examples
    --------
    >>> from mlivr_gym import jem_map
    >>> places = places_on_rails(jem_map())
    >>> len(places), places.ids[0]
    (298, 'D1a:-700')
    """
    rows: list[Row] = []
    for segment in grasp_map.segments:
        place = FieldPath(f"segment {segment.id!r}", MapError)
        found = discretise(segment, spacing, MAX_POINTS - len(rows), place)
        middle = 0.5 * (np.array(segment.start) + np.array(segment.end))
        for _, face, position, frame, width in found:
            away = round(1e3 * float((position - middle) @ frame[:, 0]))
            gap = np.linalg.norm(grasp_map.positions - position, axis=1).min()
            if gap > SAME:
                rows.append((f"{segment.id}:{away:+d}", face, position, frame, width))
    rows = clear_of_handrails(rows, grasp_map.handrails, HANDRAIL_CLEARANCE)
    if not rows:
        return None
    return replace(
        grasp_map,
        ids=tuple(row[0] for row in rows),
        positions=np.array([row[2] for row in rows]),
        rotations=np.array([row[3] for row in rows]),
        faces=tuple(row[1] for row in rows),
        name=f"{grasp_map.name}-places",
    )


@checked({**QUERY, "candidates": OrNone(MAP)})
def points_to_add(
    graph: StanceGraph,
    start: Sequence[str | int] | State,
    goal: Sequence[float] | Array,
    candidates: GraspMap | None = None,
    *,
    goal_tolerance: float = GOAL_TOLERANCE,
    goal_face: str | None = None,
    progress: Callable[[int], None] | None = None,
) -> AddedPoints:
    """Return points that would make a goal reachable if the map had them.

    Each candidate is tried alone. If none suffices, a set is sought of which none can be spared;
    two are then the smallest number, while of three or more that is not proved.

    The graph is one of two limbs. Start and goal are those of `Planner.plan`, for which no plan
    exists; the candidates are by default the `places_on_rails` of the map. `progress` is called
    with the number of candidates tried alone. Raises an `MlivrError` if an argument cannot be used,
    the start cannot be held, the map has no candidate, or the robot has more than two limbs.
    """
    if not isinstance(graph, TwoLimbGraph):
        raise SettingError(f"points to add need two limbs; robot {graph.robot.name!r} has more")
    here = graph.grasp_map
    places = places_on_rails(here) if candidates is None else candidates
    if places is None:
        raise MapError(f"map {here.name!r} has no place on a rail without a point: give candidates")
    held = (graph.validated_state(start) if isinstance(start, State) else graph.state(start)).stance
    trial = _Trial(graph, places, held)
    trial.goal = Goal.from_arguments(trial.graph, goal, "steps", None, goal_tolerance, goal_face)
    every = list(places.ids)
    if not trial.has_plan(every):
        return AddedPoints((), (), places, True)
    alone = []
    for k, one in enumerate(every):
        if trial.may_have_plan(one) and trial.has_plan([one]):
            alone.append(one)
        if progress is not None:
            progress(k + 1)
    if alone:
        return AddedPoints((alone[0],), tuple(alone), places, True)
    found = tuple(smallest_subset(every, trial.has_plan))
    return AddedPoints(found, (), places, len(found) <= 2)


def with_candidates(here: GraspMap, places: GraspMap) -> GraspMap:
    """Return a map with the points of another one, which come last."""
    return replace(
        here,
        ids=here.ids + places.ids,
        positions=np.concatenate([here.positions, places.positions]),
        rotations=np.concatenate([here.rotations, places.rotations]),
        faces=here.faces + places.faces,
    )


class _Trial:
    """A graph with all candidates, of which some are taken away as occupied points are."""

    goal: Goal

    def __init__(self, graph: TwoLimbGraph, places: GraspMap, held: tuple[int, ...]) -> None:
        here = graph.grasp_map
        joined = with_candidates(here, places)
        made = in_same_world(graph, grasp_map=joined)
        assert isinstance(made, TwoLimbGraph)
        self.graph, self.held, self.occupied = made, held, graph.occupied
        self.new = range(len(here), len(joined))
        self.able = (made.branch_sets > 0).all(axis=1)

    def has_plan(self, added: list[str]) -> bool:
        """Return whether a plan exists with some candidates."""
        kept = {self.graph.grasp_map.index(point) for point in added}
        self.graph.vacate()
        self.graph.occupy([*self.occupied, *(p for p in self.new if p not in kept)])
        search = SearchQuery.from_options(self.graph, self.goal)
        result = GraphSearcher(self.graph).find(search, self.graph.state(self.held))
        return result is not None and result.status == GOAL_REACHED

    def may_have_plan(self, point: str) -> bool:
        """Return whether moves lead to the goal with one candidate, if all steps are possible."""
        points = self.graph.points
        is_used = self.able & (
            (points < self.new[0]) | (points == self.graph.grasp_map.index(point))
        ).all(axis=1)
        _, part = connected_parts(points[is_used], len(self.graph.grasp_map))
        at_goal = self.goal.reached(self.graph.base_position[is_used], points[is_used])
        start = (points[is_used] == self.held).all(axis=1)
        return bool(np.isin(part[start], part[at_goal]).any())


@checked(QUERY)
def one_more_limb(
    graph: StanceGraph,
    start: Sequence[str | int] | State,
    goal: Sequence[float] | Array,
    *,
    goal_tolerance: float = GOAL_TOLERANCE,
    goal_face: str | None = None,
    limit: int = 2000,
) -> MoreLimbs | None:
    """Search for a plan of the shipped robot with one limb more; None if there is no such robot.

    Start and goal are those of `Planner.plan`. The other limb holds the first of the points nearest
    to those of the start with which the robot has a posture. The search expands at most `limit`
    states. Raises an `MlivrError` if an argument cannot be used.
    """
    name = f"mlivr{graph.limbs + 1}"
    if graph.robot != robot_spec(f"mlivr{graph.limbs}") or name not in ROBOTS:
        return None
    if isinstance(start, State):
        graph.check(start)
    held = start.stance if isinstance(start, State) else graph.indices(start)
    settings = replace(graph.settings, base_threshold=None)
    other = in_same_world(graph, robot=robot_spec(name), settings=settings)
    positions = graph.grasp_map.positions
    away = np.linalg.norm(positions - positions[list(held)].mean(axis=0), axis=1)
    for point in np.argsort(away, kind="stable")[:MOST_STARTS].tolist():
        try:
            state = other.state((*held, point))
        except StanceError:
            continue
        target = Goal.from_arguments(other, goal, "steps", None, goal_tolerance, goal_face)
        search = SearchQuery.from_options(other, target, limit=limit)
        result = GraphSearcher(other, build_sets=False).find(search, state)
        status = "no moves lead there" if result is None else result.status
        return MoreLimbs(name, other.ids(state.stance), status)
    return MoreLimbs(name, (), "")
