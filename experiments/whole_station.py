"""Measure one plan across a station from a cold start, against the number of points.

    python experiments/whole_station.py [--out results] [--most 114]

Each plan is made by a process of its own without cached tables; machine code is compiled before.
Stations are rows of labs (`station_modules.py`), and the station that ships. The plan of
two limbs leads from the first to the last module, on the graph of the whole map and in a corridor.
It is proved to have at most 1.2 times the fewest steps possible on the points that are used. Three
and four limbs go from a node into a module like Columbus, through a hatch. Writes
`whole_station.json`, `whole_station.md` and `whole_station.png`; takes half an hour.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from typing import Any

from matplotlib.figure import Figure
from reports import NOTHING, ROOT, experiment, study_rows, table

INFLATION, TIME_LIMIT = 1.2, 600.0
"""Suboptimality bound of the plans; time after which a process is ended [s]."""

LABS = (2, 5, 10, 20, 40, 80, 114)
"""Numbers of labs in a row."""

MOST_WHOLE = 20
"""Largest of these numbers for which the graph of the whole map is made."""

SHORT, TO_TENTH = 10, "corridor, to lab 10"
"""Number of the lab to which a plan leads on every large row, and name of this measurement."""

LIMBED = tuple(
    f"{robot}, {rules}"
    for robot in ("mlivr3", "mlivr4")
    for rules in ("thresholds", "no thresholds")
)
"""Robots and settings that go through a hatch, as names of measurements."""

LIMBED_TIME, GOAL_TOLERANCE, STARTS = 20.0, 0.4, 2
"""Time given to each of their plans [s], their goal tolerance [m], and the number of starts."""

NODE, THROUGH = "node/", (1.6, 5.0, 0.0)
"""First letters of the points at the start, and goal on the other side of the hatch [m]."""

LENGTH = 8.5
"""Length of a lab [m]."""

CACHE = ROOT / "runs" / "whole_station"
"""Cache folder of the processes."""

AIM = {"time": 2.0, "memory": 2.0}
"""Time [s] and memory [GB] aimed at for ten modules."""


def row_of(labs: int) -> dict[str, Any]:
    """Return the map of a row of labs with the origin in its middle."""
    file = str(ROOT / "envs_assets" / "lab.json")
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


def measured(labs: int, method: str, began: float) -> dict[str, Any]:
    """Return the figures of one plan; the process started at the time `began`."""
    from mlivr_gym.planners import Planner
    from mlivr_gym.planners.corridor import plan_in_corridor
    from mlivr_gym.stances.build import stance_graph
    from mlivr_gym.world.grasp_map import as_map

    imported = time.time()
    world = as_map(row_of(labs) if labs else "station")
    read_at = time.time()
    start, goal = query(labs, SHORT if method == TO_TENTH else labs)
    if method in ("corridor", TO_TENTH):
        found = plan_in_corridor(world, start, goal, inflation=INFLATION)
        graph, result = found.graph, found.result
    else:
        graph = stance_graph(world)
        result = Planner(graph).plan(start, goal, "steps", inflation=INFLATION)
    used = resource.getrusage(resource.RUSAGE_SELF)
    return {
        "modules": labs or 10,
        "points": len(world),
        "points_used": len(graph.grasp_map),
        "import_s": imported - began,
        "map_s": read_at - imported,
        "plan_s": time.time() - read_at,
        "wall_s": time.time() - began,
        "processor_s": used.ru_utime + used.ru_stime,
        "memory_gb": used.ru_maxrss / 1e6,
        "steps": None if result.plan is None else len(result.plan.steps),
    }


def through_a_hatch(method: str, began: float) -> dict[str, Any]:
    """Return how plans of three or four limbs from some starts end."""
    import numpy as np

    from mlivr_gym import Settings
    from mlivr_gym.planners.corridor import plan_in_corridor
    from mlivr_gym.stances.build import stance_graph
    from mlivr_gym.stances.random_states import random_state
    from mlivr_gym.world.grasp_map import as_map

    robot, rules = method.split(", ")
    settings, world = Settings(manipulability=rules == "thresholds"), as_map("hatch")
    keep = np.array([point.startswith(NODE) for point in world.ids])
    first = stance_graph(world.subset(keep), robot, settings)
    options: Any = {"goal_tolerance": GOAL_TOLERANCE, "time_limit": LIMBED_TIME}
    ends, steps = [], []
    for seed in range(STARTS):
        start = first.ids(random_state(first, np.random.default_rng(seed)).stance)
        found = plan_in_corridor(world, start, THROUGH, "steps", robot, settings, **options)
        ends.append(found.result.reason or "plan found")
        if found.result.plan is not None:
            steps.append((len(found.result.plan.steps), found.result.plan.statistics.bound))
    used = resource.getrusage(resource.RUSAGE_SELF)
    return {
        "points": len(world),
        "ends": ends,
        "steps_and_bounds": steps,
        "wall_s": time.time() - began,
        "memory_gb": used.ru_maxrss / 1e6,
    }


def in_process(task: int, labs: int, method: str) -> dict[str, str]:
    """Return the figures of one plan in a new process, for which only machine code is cached."""
    for file in CACHE.glob("*.npz"):
        file.unlink()
    command = [sys.executable, __file__, "--one", str(labs), method, repr(time.time())]
    environment = os.environ | {"MLIVR_GYM_CACHE": str(CACHE)}
    try:
        out = subprocess.run(
            command, capture_output=True, text=True, env=environment, timeout=TIME_LIMIT
        )
    except subprocess.TimeoutExpired:
        return {"figures": json.dumps({"fault": f"not finished within {TIME_LIMIT:g} s"})}
    if out.returncode:
        return {"figures": json.dumps({"fault": out.stderr.strip().splitlines()[-1]})}
    return {"figures": out.stdout.splitlines()[-1]}


def all_measured(most: int) -> dict[str, Any]:
    """Return the figures of all plans, in rows of at most some labs."""
    labs = [n for n in LABS if n <= most]
    todo = {
        "corridor": [0, *labs],
        "whole": [0, *(n for n in labs if n <= MOST_WHOLE)],
        TO_TENTH: [n for n in labs if n > SHORT],
    } | {method: [1] for method in LIMBED}
    in_process(0, 2, "corridor")  # compiles
    rows = []
    for method in (method for method, some in todo.items() if some):
        given = {"method": [method], "labs": todo[method]}
        for row in study_rows("whole_station:in_process", 1, 1, **given):
            shown = {"station": not row["labs"], "labs": row["labs"], "method": method}
            rows.append(shown | json.loads(row["figures"]))
    return {"rows": rows}


def limbed_table(rows: list[dict[str, Any]]) -> str:
    """Return the table of three and four limbs."""
    head = (
        "robot | how the plans end | steps of plans, proved bound | whole process [s] | memory [GB]"
    )
    limbed = [
        (
            row["method"], "; ".join(row["ends"]),
            ", ".join(f"{k} ({bound:.2f})" for k, bound in row["steps_and_bounds"]) or NOTHING,
            f"{row['wall_s']:.0f}", f"{row['memory_gb']:.2f}",
        )
        for row in rows
        if row["method"] in LIMBED
    ]  # fmt: skip
    return table(head, limbed)


def markdown(data: dict[str, Any]) -> str:
    """Return the report."""
    rows = []
    ten = next(r for r in data["rows"] if r["station"] and r["method"] == "corridor")
    two = [row for row in data["rows"] if row["method"] not in LIMBED]
    for row in sorted(two, key=lambda row: (row["labs"], row["method"])):
        name = "`station`" if row["station"] else f"row of {row['labs']} labs"
        if "fault" in row:
            rows.append((name, NOTHING, row["method"], row["fault"], *[NOTHING] * 5))
            continue
        rows.append(
            (
                name, row["points"], row["method"], row["points_used"], row["steps"] or "no plan",
                f"{row['import_s'] + row['map_s']:.1f} + {row['plan_s']:.1f}",
                f"{row['wall_s']:.1f}", f"{row['processor_s']:.1f}", f"{row['memory_gb']:.2f}",
            )
        )  # fmt: skip
    head = (
        "place | points | stances of | points used | steps | import and map, plan [s] | "
        "whole process [s] | processor time [s] | memory [GB]"
    )
    reached = (
        f"{ten['wall_s']:.1f} s and {ten['memory_gb']:.2f} GB, of which importing and reading the "
        f"map take {ten['import_s'] + ten['map_s']:.1f} s"
    )
    return f"""# A whole station

One plan of two limbs from the first to the last module, or to the tenth, each by a process of its
own that has no cached table; machine code is compiled before. A plan is proved to have at most
{INFLATION} times the fewest steps possible on the points that are used. *Whole* computes the
stances of the whole map. *Corridor* (`planners.corridor.plan_in_corridor`) computes those near a
route over cells that hold points, and widens the corridor, up to the whole map, until a plan is
found: it is not proved that no plan outside the corridor is shorter.

The aim is {AIM["time"]:g} s and {AIM["memory"]:g} GB for ten modules. In the corridor the station \
takes {reached}.
The machine has two cores, on which other programs ran, so elapsed times would be shorter on an
idle one; processor time is the sum over threads. The row of 114 labs from end to end and those of
three and four limbs were measured later, while more programs ran. The largest rows have no *whole*.

![Time and memory against the number of points](whole_station.png)

{table(head, rows)}
## Three and four limbs

From {STARTS} random starts in the node of the map `hatch` through the hatch into the module, with
{LIMBED_TIME:g} s for a search and a goal tolerance of {GOAL_TOLERANCE} m. If the goal lies outside
the reachable set, no sequence of moves leads there, whatever steps could be made.

{limbed_table(data["rows"])}
`experiments/whole_station.py` makes this page.
"""


def draw(data: dict[str, Any], path: Any) -> None:
    """Draw time and memory against the number of points."""
    from mlivr_gym.pictures.figures import save_figure

    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    for axes, keys, label in zip(
        figure.subplots(1, 2),
        (("processor_s", "plan_s"), ("memory_gb",)),
        ("time [s]", "memory [GB]"),
        strict=True,
    ):
        colours = {"whole": "tab:red", "corridor": "tab:blue", TO_TENTH: "tab:green"}
        for method, colour in colours.items():
            rows = [
                r
                for r in data["rows"]
                if r["method"] == method and not r["station"] and "fault" not in r
            ]
            for key, style in zip(keys, ("-o", "--s"), strict=False):
                name = {"processor_s": "processor time", "plan_s": "plan, elapsed"}.get(key)
                axes.plot(
                    [r["points"] for r in rows],
                    [r[key] for r in rows],
                    style,
                    color=colour,
                    label=f"{method}, {name}" if name else method,
                    markersize=4,
                )
        axes.axhline(AIM["time" if "time" in label else "memory"], color="0.7", linewidth=1)
        axes.set(xscale="log", yscale="log", xlabel="points of the map", ylabel=label)
        axes.legend(fontsize=6, loc="upper left")
    save_figure(figure, path, vector=False)


if __name__ == "__main__":
    if "--one" in sys.argv:
        labs, method, began = sys.argv[2:]
        found = (
            through_a_hatch(method, float(began))
            if method in LIMBED
            else measured(int(labs), method, float(began))
        )
        print(json.dumps(found))
    else:
        experiment("whole_station", __doc__, all_measured, markdown, draw, most=LABS[-1])
