"""Plans on large maps: the stance graph is computed only in a corridor of points around a route.

The route is a shortest path over cells that hold points. If the corridor has no plan, it is
widened, up to the whole map; only the whole map proves that there is none. A plan of two limbs is
proved to be within a factor of the minimum on the whole map, see `fewest_moves`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.errors import RobotError, StanceError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.fewest_moves import fewest_moves
from mlivr_gym.planners.move_bounds import MoveBounds
from mlivr_gym.planners.outcome import LIMIT_REACHED
from mlivr_gym.planners.planner import Planner
from mlivr_gym.planners.planning_result import PlanningResult
from mlivr_gym.planners.query import QUERY, Goal
from mlivr_gym.robot.specification import ROBOT_OR_NAME, RobotSpec, robot_spec
from mlivr_gym.schema import FieldPath
from mlivr_gym.settings import Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.obstacles import POINTS
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.given_points import STANCE
from mlivr_gym.world.grasp_map import MAP, GraspMap, as_map

CELL = 1.0
"""Edge of the cells of the route [m]."""

CHUNK = 256
"""Number of points that are compared with all others at once."""

WIDTHS = 1.5, 2.5
"""Distances from the route within which points belong to the corridor, in order [m]."""

MANY = 1000
"""Number of points above which every other point of a corridor is tried before all of them.

A row of ten labs then takes a third of the processor time, with as many steps.
"""


LEGS_FROM = 12.0
"""Length of the route from which on more than two limbs are planned for in legs along it [m]."""


class CorridorPlan(NamedTuple):
    """Result of `plan_in_corridor`."""

    result: PlanningResult
    """The result; the bound of its plan holds for the whole map, None if nothing is proved. Those
    of its improvements hold for the points of `graph`."""
    graph: StanceGraph
    """The stance graph on which it was planned, whose map has the points and boxes used."""
    is_whole: bool
    """Whether the graph has all points, so that a result without a plan proves that none exists."""


@checked({**QUERY, "grasp_map": MAP, "robot": ROBOT_OR_NAME, "occupied": POINTS})
def plan_in_corridor(
    grasp_map: str | GraspMap | dict[str, Any] | None,
    start: Sequence[str],
    goal: Sequence[float] | Array,
    cost: str = "steps",
    robot: str | RobotSpec | dict[str, Any] = "mlivr2",
    settings: Settings | None = None,
    *,
    obstacles: Sequence[Box] = (),
    occupied: Sequence[str] = (),
    **options: Any,
) -> CorridorPlan:
    """Plan on a large map without computing the stances of the whole of it.

    Parameters
    ----------
    grasp_map, robot, settings
        As for `stance_graph`.
    start
        Point id of each limb.
    goal
        Goal position of the base [m].
    cost
        As for `Planner.plan`.
    obstacles
        Boxes in addition to those of the map.
    occupied
        Ids of points that no limb may grasp.
    **options
        Further arguments of `Planner.plan`.

    Returns
    -------
    CorridorPlan
        The result in the first corridor that has a plan, or in which a limit was reached,
        otherwise that of the whole map. Its plan is one of the whole map, of which it has the
        fingerprint.

    Raises
    ------
    MlivrError
        If an argument cannot be used, as for `stance_graph` and `Planner.plan`.

    Examples
    --------
    >>> start, goal = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)
    >>> found = plan_in_corridor("jem", start, goal)
    >>> len(found.result.unwrap().steps), len(found.graph.grasp_map) < 331
    (4, True)
    """
    world, robot = as_map(grasp_map), robot_spec(robot)
    named = STANCE.read(start, FieldPath("start", StanceError))
    if len(named) != robot.limbs:
        raise StanceError(
            f"start names {len(named)} points; robot {robot.name!r} has {robot.limbs} limbs"
        )
    held = [world.index(point) for point in named]
    taken = [world.ids[k] for k in sorted({world.index(point) for point in occupied})]
    target = world.check_goal(goal)
    route = route_of(world.positions, held[0], target, robot.span)
    far = nearest_distances(world.positions, route)
    length = float(np.linalg.norm(np.diff(route, axis=0), axis=1).sum())
    needed = np.linalg.norm(world.positions - target, axis=1) <= robot.reach + robot.mount_radius
    needed[held] = True
    if robot.limbs > 2 and length > LEGS_FROM and options.get("inflation") is None:
        options = {"route": route[-2:0:-1]} | options
    for keep in _corridors(needed, far):
        part = around(world, keep, robot)
        try:
            graph = stance_graph(part, robot, settings)
        except RobotError:  # no stance among so few points
            continue
        graph.add_obstacles(obstacles)
        graph.occupy([point for point in taken if point in part.ids])
        result = Planner(graph).plan(start, target, cost, **options)
        if result.plan is not None:
            made = replace(
                result.plan.world, map_fingerprint=world.fingerprint, occupied=tuple(taken)
            )
            statistics = replace(result.plan.statistics, bound=_bound_on_map(result.plan, world))
            plan = replace(result.plan, world=made, statistics=statistics)
            result = replace(result, plan=plan)
        elif result.reason == LIMIT_REACHED:
            used = f", on {len(part)} of {len(world)} points: there may be a plan"
            result = replace(result, message=result.message + used)
        if result.plan is not None or result.reason == LIMIT_REACHED:
            return CorridorPlan(result, graph, False)
    whole = stance_graph(world, robot, settings)
    whole.add_obstacles(obstacles)
    whole.occupy(taken)
    return CorridorPlan(Planner(whole).plan(start, target, cost, **options), whole, True)


def _bound_on_map(plan: Plan, world: GraspMap) -> float | None:
    """Return the factor of the minimum on a whole map within which a plan is proved, or None.

    The base moves at least as far as the goal is away, and limbs need the fewest moves.
    """
    query, robot, settings = plan.query, plan.world.robot, plan.world.settings
    cost, target = Cost.named(query.cost_name, query.regrasp_price), np.array(query.goal)
    start = [world.index(point) for point in plan.stances[0]]
    if robot.limbs == 2:
        moves = fewest_moves(world, robot, settings, start, (target, query.goal_tolerance))
    else:
        goal = Goal(target, query.goal_tolerance, cost)
        graph = stance_graph(world, robot, settings)
        moves = float(MoveBounds(graph, goal).steps(np.array([start]))[0])
    away = float(np.linalg.norm(plan.motion.base_positions[0] - target)) - query.goal_tolerance
    least = cost.base_weight * max(0.0, away) + cost.step_weight * moves
    return max(1.0, plan.cost / least) if least else None


def _corridors(needed: BoolArray, far: Array) -> Iterator[BoolArray]:
    """Yield which points belong to each corridor but the whole map, in the order of trial."""
    every_other = np.arange(len(far)) % 2 == 0
    for width in WIDTHS:
        keep = needed | (far <= width)
        if keep.sum() > MANY:
            yield needed | (keep & every_other)
        if keep.all():
            return
        yield keep


def route_of(positions: Array, first: int, goal: Array, span: float) -> Array:
    """Return the places of a route from a point to a goal, at most half a cell apart, (k, 3) [m].

    Cells are joined if the means of their points are within the span, at the square of their
    distance, so that many short hops past points are preferred to a long one through a wall. If no
    such hops lead to the goal, the route is a straight line.
    """
    cells, inverse = np.unique(np.floor(positions / CELL), axis=0, return_inverse=True)
    count, inverse = len(cells), inverse.ravel()
    sums = np.zeros((count, 3))
    np.add.at(sums, inverse, positions)
    means = sums / np.bincount(inverse)[:, None]
    here, end = int(inverse[first]), int(np.linalg.norm(means - goal, axis=1).argmin())
    places = [goal, *means[_cheapest_hops(means, here, end, span)][::-1]]
    places.append(positions[first])
    line = [
        np.linspace(a, b, 2 + int(2.0 * np.linalg.norm(b - a) / CELL)) for a, b in pairwise(places)
    ]
    return np.concatenate(line)


def around(world: GraspMap, keep: BoolArray, robot: RobotSpec) -> GraspMap:
    """Return a map with some points, shape (m,), and the boxes that a robot there may touch."""
    cells = (np.unique(np.floor(world.positions[keep] / CELL), axis=0) + 0.5) * CELL
    centres = np.array([box.centre for box in world.boxes]).reshape(-1, 3)
    radii = np.array([np.linalg.norm(box.half) for box in world.boxes])
    reach = robot.span + robot.extent + 0.5 * np.sqrt(3.0) * CELL
    close = nearest_distances(centres, cells) <= radii + reach
    boxes = tuple(box for box, is_close in zip(world.boxes, close, strict=True) if is_close)
    return replace(world.subset(keep), boxes=boxes)


def nearest_distances(points: Array, others: Array) -> Array:
    """Return the distance of each point, shape (k, 3), to the nearest of others, (n, 3) [m].

    All are compared with all, which for a corridor is quicker than to import SciPy's tree.
    """
    squares = [
        ((points[k : k + CHUNK, None] - others) ** 2).sum(axis=2).min(axis=1)
        for k in range(0, len(points), CHUNK)
    ]
    found: Array = np.sqrt(np.concatenate([np.zeros(0), *squares]))
    return found


def _cheapest_hops(means: Array, here: int, end: int, span: float) -> list[int]:
    """Return the cells from one to another at the least sum of squared hops (Dijkstra 1959)."""
    cost, before = np.full(len(means), np.inf), np.full(len(means), here)
    waits, nearest = np.full(len(means), True), here
    cost[here] = 0.0
    while nearest != end and waits[nearest]:
        waits[nearest] = False
        hops = ((means - means[nearest]) ** 2).sum(axis=1)
        through = np.where(hops <= span**2, cost[nearest] + hops, np.inf)
        better = through < cost
        cost[better], before[better] = through[better], nearest
        nearest = int(np.where(waits, cost, np.inf).argmin())
    path = [end]
    while path[-1] != here:
        path.append(int(before[path[-1]]))
    return path[::-1]
