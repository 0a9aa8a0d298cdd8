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
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners import Planner
from mlivr_gym.planners.corridor import plan_in_corridor
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_files import TableFiles
from mlivr_gym.world.grasp_map import as_map

SHORT, TO_TENTH = 10, "corridor, to lab 10"
"""Number of the lab to which a plan leads on every large row, and name of this measurement."""

TABLE = "table"
"""Name of the measurement of a plan by the complete table that ships."""

ACROSS = "mlivr3", "mlivr4, one limb folded"
"""Names of the measurements of three and four limbs across the station."""

FROM_DECK, INTO_LAST = ("columbus1/D1a:5", "columbus1/D1a:1", "columbus1/D1a:2"), (31.4, 0.0, -0.5)
"""Their start, in the module in which that of two limbs is, and their goal in the last node [m]."""

TOLERANCE = 0.4
"""Their goal tolerance [m]."""

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


def plan_across(method: str) -> Any:
    """Plan with three or four limbs; four fold the last one, see `carrying_robot`."""
    from mlivr_gym.collisions.carrying import carrying_robot
    from mlivr_gym.planners.folded_limb import NOTHING
    from mlivr_gym.robot.specification import robot_spec

    name, *folded = method.split(", ")
    robot = robot_spec(name)
    if folded:
        robot = carrying_robot(robot, robot.limbs - 1, NOTHING)
    return plan_in_corridor("station", FROM_DECK, INTO_LAST, robot=robot, goal_tolerance=TOLERANCE)


def checked(graph: StanceGraph, plan: Plan) -> dict[str, Any]:
    """Return the bound of a plan on the points of its graph, and whether MuJoCo carries it out."""
    import numpy as np

    from mlivr_gym.planners.query import Goal
    from mlivr_gym.planners.set_bounds import SetBounds
    from mlivr_gym.simulation.execution import execute

    goal = Goal.from_arguments(graph, INTO_LAST, "steps", None, TOLERANCE)
    start = np.array([graph.indices(plan.stances[0])])
    return {
        "base_m": plan.base_translation,
        "bound_on_points": len(plan.steps) / SetBounds(graph, graph.sets(), goal).steps(start)[0],
        "walked": execute(graph, plan).failure is None,
    }


def figures(labs: int, method: str, began: float) -> dict[str, Any]:
    """Return the figures of one plan; the process started at the time `began`."""
    world = as_map(row_of(labs) if labs else "station")
    read_at = time.time()
    start, goal = query(labs, SHORT if method == TO_TENTH else labs)
    if method in ("whole", TABLE):
        if method != TABLE:
            TableFiles.find = no_table  # type: ignore[method-assign]
        graph = stance_graph(world)
        result = Planner(graph).plan(start, goal, "steps", limit=LIMIT)
    else:
        found = (
            plan_across(method)
            if method in ACROSS
            else plan_in_corridor(world, start, goal, limit=LIMIT)
        )
        graph, result = found.graph, found.result
    used, plan = resource.getrusage(resource.RUSAGE_SELF), result.plan
    return {
        "points": len(world),
        "points_used": len(graph.grasp_map),
        "plan_s": time.time() - read_at,
        "wall_s": time.time() - began,
        "processor_s": used.ru_utime + used.ru_stime,
        "memory_gb": used.ru_maxrss / 1e6,
        "end": result.reason or "plan found",
        "steps": None if plan is None else len(plan.steps),
        "bound": None if plan is None else plan.statistics.bound,
    } | (checked(graph, plan) if method in ACROSS and plan is not None else {})


if __name__ == "__main__":
    print(json.dumps(figures(int(sys.argv[1]), sys.argv[2], float(sys.argv[3]))))
