"""Make one plan across a station or a row of labs, and print its figures.

    python experiments/station_plans.py LABS METHOD BEGAN

`whole_station.py` runs this in new processes. LABS is the number of labs in a row, 0 for the
station that ships; BEGAN is the time at which the process began [s since the epoch]. METHOD is
`corridor`, `whole`, or one of the constants below. Only what a plan needs is imported before it.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from typing import Any

from mlivr_gym.envs_assets import asset_path
from mlivr_gym.planners import Planner
from mlivr_gym.planners.corridor import plan_in_corridor
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.table_files import TableFiles
from mlivr_gym.world.grasp_map import as_map

IMPORTED = time.time()
"""Time at which everything was imported [s since the epoch]."""

SHORT, TO_TENTH = 10, "corridor, to lab 10"
"""Number of the lab to which a plan leads on every large row, and name of this measurement."""

LIMBED = tuple(
    f"{robot}, {rails}" for robot in ("mlivr3", "mlivr4") for rails in ("with", "without")
)
"""Robots that go through the hatch of the map `hatch`, with its handrails and without them, as
names of measurements."""

LIMBED_TIME, LIMBED_TOLERANCE, STARTS = 20.0, 0.4, 25
"""Time given to each of their plans [s], their goal tolerance [m], and the number of starts."""

AROUND, THROUGH = (1.3, 1.0, 4.0), (1.6, 3.6, 0.0)
"""Largest distance from the axis of the hatch, and range along it, of the points that they use, and
goal behind the hatch [m]."""

ALCOVE = "node/aft/"
"""First letters of the points that they hold at the start, before the hatch."""

NODES = "mlivr4, handrails that ship", "mlivr4, with handrails around closed hatches"
"""Names of measurements: four limbs from a module through two hatches of a node of the map
`station` into the next, by its handrails, and with eight more."""

NODE = (0.3, -0.9), (5.8, 3.6)
"""Lower and upper corner, x and y, of the points that they use [m]; there are three on each seat
track, with the last letters `LAST`."""

LAST = (":2", ":4", ":6")

FROM_COLUMBUS = (
    "columbus2/aft end/0-:0", "columbus2/handrail node1+:3",
    "columbus2/handrail node1+:0", "columbus2/aft end/1+:0",
)  # fmt: skip
"""Their start, inside the hatch of a module like Columbus."""

INTO_LAB = (5.0, 0.0, 0.0)
"""Their goal in the lab [m]."""

ACROSS = "mlivr3", "mlivr4, one limb folded"
"""Names of the measurements of three and four limbs across the station."""

FROM_DECK = "columbus1/D1a:5", "columbus1/D1a:1", "columbus1/D1a:2"
"""Their start, in the module in which that of two limbs is."""

INTO_LAST = (31.4, 0.0, -0.5)
"""Their goal in the last node [m]."""

TABLE = "table"
"""Name of the measurement of a plan by the complete table that ships."""

BOUNDS = "bounds"
"""Name of the measurement of lower bounds."""

LIMIT = 10**9
"""Number of states that a search expands at most."""

LENGTH = 8.5
"""Length of a lab [m]."""


def row_of(labs: int) -> dict[str, Any]:
    """Return the map of a row of labs with the origin in its middle."""
    file = str(asset_path("lab.json"))
    parts = [
        {"id": f"lab{k}", "map": file, "translation": [(k - 0.5 * (labs - 1)) * LENGTH, 0.0, 0.0]}
        for k in range(labs)
    ]
    return {"name": f"row{labs}", "parts": parts}


def query(labs: int, last: int) -> tuple[tuple[str, str], tuple[float, float, float]]:
    """Return start and goal from the first lab of a row to a last one, or across the station."""
    if not labs:
        return ("columbus1/D1a:2", "columbus1/F1a:0"), (32.5, -5.0, 0.2)
    x = (last - 1 - 0.5 * (labs - 1)) * LENGTH + 2.0
    return ("lab0/D1a:2", "lab0/F1a:0"), (x, 0.2, 0.3)


def no_table(*_: Any, **__: Any) -> None:
    """Return that there is no table."""


def measured(labs: int, method: str, began: float) -> dict[str, Any]:
    """Return the figures of one plan; the process started at the time `began`."""
    world = as_map(row_of(labs) if labs else "station")
    read_at = time.time()
    start, goal = query(labs, SHORT if method == TO_TENTH else labs)
    if method in ("corridor", TO_TENTH):
        found = plan_in_corridor(world, start, goal, limit=LIMIT)
        graph, result = found.graph, found.result
    else:
        if method != TABLE:
            TableFiles.find = no_table  # type: ignore[method-assign]
        graph = stance_graph(world)
        result = Planner(graph).plan(start, goal, "steps", limit=LIMIT)
    used = resource.getrusage(resource.RUSAGE_SELF)
    return {
        "modules": labs or 10,
        "points": len(world),
        "points_used": len(graph.grasp_map),
        "import_s": IMPORTED - began,
        "map_s": read_at - IMPORTED,
        "plan_s": time.time() - read_at,
        "wall_s": time.time() - began,
        "processor_s": used.ru_utime + used.ru_stime,
        "memory_gb": used.ru_maxrss / 1e6,
        "steps": None if result.plan is None else len(result.plan.steps),
        "bound": None if result.plan is None else result.plan.statistics.bound,
    }


def through_a_hatch(method: str) -> dict[str, Any]:
    """Return how plans of three or four limbs from some starts end, over a table of all nodes."""
    import numpy as np

    from mlivr_gym.planners.corridor import around
    from mlivr_gym.robot.specification import robot_spec
    from mlivr_gym.simulation.execution import execute
    from mlivr_gym.stances.table_build import build_table

    name, rails = method.split(", ")
    robot, world = robot_spec(name), as_map("hatch")
    away, low, high = AROUND
    across, along = (world.positions - THROUGH)[:, ::2], world.positions[:, 1]
    keep = (np.linalg.norm(across, axis=1) < away) & (along > low) & (along < high)
    keep &= [rails == "with" or face != "handrails" for face in world.faces]
    graph = stance_graph(around(world, keep, robot), robot)
    build_table(graph)
    assert graph.table is not None
    planner, points = Planner(graph), graph.table.points.astype(int)
    before = np.array([point.startswith(ALCOVE) for point in graph.grasp_map.ids])
    first = points[before[points].all(axis=1)]
    results = [
        planner.plan(
            graph.ids(stance), THROUGH, "steps", goal_tolerance=LIMBED_TOLERANCE,
            time_limit=LIMBED_TIME,
        )
        for stance in np.random.default_rng(0).permutation(first)[:STARTS].tolist()
    ]  # fmt: skip
    plans = [found.plan for found in results if found.plan is not None]
    return {
        "points": len(graph.grasp_map),
        "nodes": len(points),
        "ends": [found.reason or "plan found" for found in results],
        "steps_and_bounds": [(len(plan.steps), plan.statistics.bound) for plan in plans],
        "walked": execute(graph, plans[0]).failure is None if plans else None,
    }


def around_closed() -> list[dict[str, Any]]:
    """Return four handrails around each of the hatches that a node may have in deck and overhead.

    They are those of `node1` of the map `station`, like the two beside each of its other hatches.
    """
    import numpy as np
    from station_modules import HALF, PORTS, TRACK_HEIGHT, flanking

    (axis, side, up), found = np.eye(3), []
    for face, out in (("deck", -up), ("overhead", up)):
        middle = PORTS * axis + (HALF + TRACK_HEIGHT) * out
        for along, name in ((axis, "y"), (side, "x")):
            found += flanking("node1", f"{face} {name}", middle, out, up=along)
    return found


def through_a_node(method: str, began: float) -> dict[str, Any]:
    """Return how a plan of four limbs ends, over a table of all nodes, see `NODES`."""
    import numpy as np

    from mlivr_gym.planners.corridor import around
    from mlivr_gym.robot.specification import robot_spec
    from mlivr_gym.simulation.execution import execute
    from mlivr_gym.stances.table_build import build_table

    robot = robot_spec(method.split(", ")[0])
    parts = [{"id": "all", "map": "station"}]
    added = {"segments": around_closed(), "spacing": 0.2} if method == NODES[1] else {}
    world = as_map({"name": "station", "parts": parts, **added})
    low, high = NODE
    keep = ((world.positions[:, :2] > low) & (world.positions[:, :2] < high)).all(axis=1)
    is_track = [point.startswith("all/lab1/") and point.count("/") == 2 for point in world.ids]
    is_track &= np.array(["handrail" not in point for point in world.ids])
    keep &= ~is_track | np.array([point.endswith(LAST) for point in world.ids])
    graph = stance_graph(around(world, keep, robot), robot)
    build_table(graph)
    assert graph.table is not None
    start = [f"all/{point}" for point in FROM_COLUMBUS]
    found = Planner(graph).plan(
        start, INTO_LAB, "steps", goal_tolerance=LIMBED_TOLERANCE, time_limit=LIMBED_TIME
    )
    used, plan = resource.getrusage(resource.RUSAGE_SELF), found.plan
    return {
        "points": len(graph.grasp_map),
        "nodes": len(graph.table.points),
        "end": found.reason or "plan found",
        "steps": None if plan is None else len(plan.steps),
        "bound": None if plan is None else plan.statistics.bound,
        "search_s": found.search_time,
        "wall_s": time.time() - began,
        "processor_s": used.ru_utime + used.ru_stime,
        "memory_gb": used.ru_maxrss / 1e6,
        "walked": None if plan is None else execute(graph, plan).failure is None,
    }


def across(method: str, began: float) -> dict[str, Any]:
    """Return the plan of three limbs from a module of the `station` to its last node.

    Four limbs fold the last one, see `carrying_robot`.
    """
    import numpy as np

    from mlivr_gym.collisions.carrying import carrying_robot
    from mlivr_gym.planners.folded_limb import NOTHING
    from mlivr_gym.planners.query import Goal
    from mlivr_gym.planners.set_bounds import SetBounds
    from mlivr_gym.robot.specification import robot_spec
    from mlivr_gym.simulation.execution import execute

    name, *folded = method.split(", ")
    robot = robot_spec(name)
    if folded:
        robot = carrying_robot(robot, robot.limbs - 1, NOTHING)
    found = plan_in_corridor(
        "station", FROM_DECK, INTO_LAST, robot=robot, goal_tolerance=LIMBED_TOLERANCE
    )
    used, plan, wall = resource.getrusage(resource.RUSAGE_SELF), found.result.plan, time.time()
    shown = {
        "points": len(found.graph.grasp_map),
        "end": found.result.reason or "plan found",
        "wall_s": wall - began,
        "processor_s": used.ru_utime + used.ru_stime,
        "memory_gb": used.ru_maxrss / 1e6,
    }
    if plan is None:
        return shown
    goal = Goal.from_arguments(found.graph, INTO_LAST, "steps", None, LIMBED_TOLERANCE)
    start = np.array([found.graph.indices(plan.stances[0])])
    least = SetBounds(found.graph, found.graph.sets(), goal).steps(start)[0]
    return shown | {
        "steps": len(plan.steps),
        "base_m": plan.base_translation,
        "bound": plan.statistics.bound,
        "bound_on_points": len(plan.steps) / least,
        "walked": execute(found.graph, plan).failure is None,
    }


def lower_bounds() -> dict[str, Any]:
    """Return lower bounds of the steps across the station, and the steps of plans."""
    import numpy as np

    from mlivr_gym.planners.fewest_moves import fewest_moves
    from mlivr_gym.planners.fewest_steps import fewest_steps
    from mlivr_gym.planners.lower_bounds import MAX_STEPS
    from mlivr_gym.planners.query import GOAL_TOLERANCE

    world = as_map("station")
    start, goal = query(0, 0)
    graph = stance_graph(world)
    here = graph.find([world.index(point) for point in start])
    away = np.linalg.norm(graph.base_position - goal, axis=1)
    nothing, none = np.zeros(len(graph), dtype=np.bool_), np.zeros(0, dtype=np.int64)
    moves, _ = fewest_steps(graph.table, away <= GOAL_TOLERANCE, nothing, none, MAX_STEPS)
    points = [world.index(point) for point in start]
    place = np.array(goal), GOAL_TOLERANCE
    inside = plan_in_corridor(world, start, goal)
    found = Planner(graph).plan(start, goal, "steps")
    return {
        "distance": int(np.ceil((away[here] - GOAL_TOLERANCE) / graph.max_displacement)),
        "free": int(fewest_moves(world, graph.robot, graph.settings, points, place)),
        "moves": int(moves[here]),
        "corridor": len(inside.result.unwrap().steps),
        "whole": len(found.unwrap().steps),
    }


def figures(labs: int, method: str, began: float) -> dict[str, Any]:
    """Return the figures that a method gives."""
    if method == BOUNDS:
        return lower_bounds()
    if method in ACROSS:
        return across(method, began)
    if method in NODES:
        return through_a_node(method, began)
    if method in LIMBED:
        return through_a_hatch(method)
    return measured(labs, method, began)


if __name__ == "__main__":
    print(json.dumps(figures(int(sys.argv[1]), sys.argv[2], float(sys.argv[3]))))
