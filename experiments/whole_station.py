"""Measure one plan across a station from a cold start, against the number of points.

    python experiments/whole_station.py [--out results] [--most 114]

Each plan is made by a process of its own without cached tables, see `station_plans.py`; machine
code and bytecode are compiled before.
Stations are rows of labs (`station_modules.py`), and the station that ships. The plan of
two limbs leads from the first to the last module, on the graph of the whole map and in a corridor.
It has the fewest steps possible on the points that are used, which is proved. Three and four limbs
go from a node into a module like Columbus, through a hatch, four limbs from there through a node
into a lab, and both across the station, four with one folded. Writes
`whole_station.json`, `whole_station.md` and `whole_station.png`; takes half an hour.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from reports import NOTHING, ROOT, counted, experiment, study_rows, table
from station_plans import (
    ACROSS,
    BOUNDS,
    LIMBED,
    LIMBED_TIME,
    LIMBED_TOLERANCE,
    NODES,
    SHORT,
    STARTS,
    TABLE,
    TO_TENTH,
)

from mlivr_gym.planners.corridor import MANY

TIME_LIMIT = 600.0
"""Time after which a process is ended [s]."""

LABS = (2, 5, 10, 20, 40, 80, 114)
"""Numbers of labs in a row."""

MOST_WHOLE = 20
"""Largest of these numbers for which the graph of the whole map is made."""

PLANS = Path(__file__).with_name("station_plans.py")
"""The script of the processes."""

CACHE = ROOT / "runs" / "whole_station"
"""Cache folder of the processes."""

TABLE_RUNS = 12
"""Number of plans by the table, of which the medians are shown."""

WALKED = {True: "yes", False: "no", None: NOTHING}
"""Whether a plan was carried out, in words."""

AIM = {"time": 2.0, "memory": 2.0}
"""Time [s] and memory [GB] aimed at for ten modules."""


def in_process(task: int, labs: int, method: str) -> dict[str, str]:
    """Return the figures of one plan in a new process, for which only compiled code is cached."""
    for file in CACHE.glob("*.npz"):
        file.unlink()
    environment = os.environ | {"MLIVR_GYM_CACHE": str(CACHE)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    command = [sys.executable, str(PLANS), str(labs), method, repr(time.time())]
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
        TABLE: [0],
    } | {method: [0] for method in (BOUNDS, *ACROSS, *LIMBED, *NODES)}
    in_process(0, 2, "corridor")  # compiles
    rows = []
    for method in (method for method, some in todo.items() if some):
        given = {"method": [method], "labs": todo[method]}
        runs = TABLE_RUNS if method == TABLE else 1
        found = study_rows("whole_station:in_process", runs, 1, **given)
        for labs in todo[method]:
            shown = {"station": not labs, "labs": labs, "method": method}
            figures = [json.loads(row["figures"]) for row in found if row["labs"] == labs]
            rows.append(shown | medians(figures))
    return {"rows": rows}


def medians(figures: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures of a plan, of several runs their medians and all wall times."""
    if len(figures) == 1:
        return figures[0]
    middle = {
        name: (statistics.median if isinstance(one, float) else statistics.median_low)(
            run[name] for run in figures
        )
        for name, one in figures[0].items()
    }
    return middle | {"walls_s": sorted(run["wall_s"] for run in figures)}


def limbed_table(rows: list[dict[str, Any]]) -> str:
    """Return the table of three and four limbs."""
    head = (
        "robot, handrails | points | nodes | how the plans end | steps of plans | "
        "largest proved bound | the first plan carried out"
    )
    limbed = []
    for row in (row for row in rows if row["method"] in LIMBED):
        steps, bounds = (
            zip(*row["steps_and_bounds"], strict=True) if row["steps_and_bounds"] else ((), ())
        )
        limbed.append(
            (
                row["method"], row["points"], f"{row['nodes']:,}", counted(Counter(row["ends"])),
                f"{min(steps)} to {max(steps)}" if steps else NOTHING,
                f"{max(bounds):.2f}" if bounds else NOTHING,
                WALKED[row["walked"]],
            )
        )  # fmt: skip
    return table(head, limbed)


def nodes_section(rows: list[dict[str, Any]]) -> str:
    """Return the section on four limbs through a node."""
    head = (
        "handrails | points | nodes | how the search ends | steps | bound | search [s] | "
        "whole process [s] | processor time [s] | memory [GB] | carried out"
    )
    shown = [
        (
            row["method"].split(", ")[1], row["points"], f"{row['nodes']:,}", row["end"],
            row["steps"] or NOTHING, f"{row['bound']:.2f}" if row["bound"] else NOTHING,
            f"{row['search_s']:.1f}", f"{row['wall_s']:.0f}", f"{row['processor_s']:.0f}",
            f"{row['memory_gb']:.2f}",
            WALKED[row["walked"]],
        )
        for row in rows
        if row["method"] in NODES
    ]  # fmt: skip
    return f"""## Four limbs through a node

From inside the hatch of a module like Columbus, through a node of the `station` and its hatch at a
right angle, into the next lab, by the points between, three on each seat track of the lab. The
table of all nodes on these points is built first, which takes most of the time. The node has
nothing to hold in deck and overhead between its hatches. Node 2 has hatches there, too (NASA: six
ports), which the node leaves out. *Around closed hatches*: with four handrails around each of these
two, of the length and at the distance that are assumed at the others; they are no part of the map
`station`, through whose nodes no plan of four limbs is known on which all four hold points. The
other nodes are not tried, and through the hatch of the JEM, on whose side nothing is near it, no
moves lead on the points that were tried.

{table(head, shown)}"""


def across_section(rows: list[dict[str, Any]]) -> str:
    """Return the section on three and four limbs across the station."""
    head = (
        "robot | points | how the search ends | steps | base translation [m] | bound | "
        "bound on these points | whole process [s] | processor time [s] | memory [GB] | carried out"
    )
    shown = []
    for row in (row for row in rows if row["method"] in ACROSS):
        figures = [NOTHING] * 4
        if "steps" in row:
            bounds = (f"{row[name]:.1f}" for name in ("bound", "bound_on_points"))
            figures = [row["steps"], f"{row['base_m']:.1f}", *bounds]
        used = f"{row['wall_s']:.0f}", f"{row['processor_s']:.0f}", f"{row['memory_gb']:.2f}"
        walked = WALKED[row.get("walked")]
        shown.append((row["method"], row["points"], row["end"], *figures, *used, walked))
    return f"""## Three and four limbs across the station

From a module like Columbus at the first node of the `station` through two labs and the node
between them to the last node, through five hatches, from a cold start. The search goes in
legs along a route (`planners.legs`), from which it takes its corridor of points. Four limbs keep
the last one folded above the body, as one that carries a bag does (`carrying_robot`); how it lets
go and folds is not part of these plans. *Bound* compares a plan with the fewest moves on the whole
map, in which the limbs only have to be within their span of each other; *bound on these points*
with those between sets of points that the limbs can hold. A plan in 2 s, as for two limbs, is out
of reach here: postures and steps of three limbs are computed as they are needed.

{table(head, shown)}"""


def bounds_section(rows: list[dict[str, Any]]) -> str:
    """Return the section on lower bounds, if they were measured."""
    for least in (row for row in rows if row["method"] == BOUNDS):
        parts = [f"{least[name] / least['whole']:.0%}" for name in ("distance", "free", "moves")]
        return f"""## How good lower bounds are

Across the `station` the plan on the whole map has {least["whole"]} steps, which is proved to be the
fewest, and that in the corridor {least["corridor"]}. The distance over the longest displacement of
a step gives {least["distance"]} ({parts[0]}). The fewest moves over postures without boxes are \
{least["free"]} ({parts[1]}); over all stances of the map at least {least["moves"]} moves are
needed, whether or not steps can make them ({parts[2]}). The rest takes checks of steps.

"""
    return ""


def two_limbs_table(rows: list[dict[str, Any]]) -> str:
    """Return the table of two limbs."""
    shown = []
    two = [row for row in rows if row["method"] not in (BOUNDS, *ACROSS, *LIMBED, *NODES)]
    for row in sorted(two, key=lambda row: (row["labs"], row["method"])):
        name = "`station`" if row["station"] else f"row of {row['labs']} labs"
        if "fault" in row:
            shown.append((name, NOTHING, row["method"], row["fault"], *[NOTHING] * 4))
            continue
        shown.append(
            (
                name, row["points"], row["method"], row["points_used"], row["steps"] or "no plan",
                f"{row['bound']:.3f}", f"{row['processor_s']:.1f}", f"{row['memory_gb']:.2f}",
            )
        )  # fmt: skip
    head = (
        "place | points | stances of | points used | steps | bound | processor time [s] | "
        "memory [GB]"
    )
    return table(head, shown)


def markdown(data: dict[str, Any]) -> str:
    """Return the report."""
    ten, corridor, whole = (
        next(r for r in data["rows"] if r["station"] and r["method"] == method)
        for method in (TABLE, "corridor", "whole")
    )
    met = ten["wall_s"] <= AIM["time"] and ten["memory_gb"] <= AIM["memory"]
    return f"""# A whole station

One plan of two limbs from the first to the last module, or to the tenth, each by a process of its
own that has no cached table; machine code is compiled before. A plan is proved to have at most
*bound* times the fewest steps possible on the map. *Whole* computes the stances of
the whole map. *Corridor* (`planners.corridor.plan_in_corridor`) computes those near a
route over cells that hold points, of more than {MANY:,} only every other point at first, and \
widens the corridor, up to the whole map, until a plan is
found; its bound compares it with the fewest moves on the whole map (`planners.fewest_moves`).

*Table* reads the complete table of the station, which ships, as does that of the JEM.

The aim is a proved optimum for ten modules within {AIM["time"]:g} s and {AIM["memory"]:g} GB.
With the table it is {"met" if met else "missed"}: the process takes {ten["wall_s"]:.2f} s (median \
of {len(ten["walls_s"])} runs of {ten["walls_s"][0]:.1f} to {ten["walls_s"][-1]:.1f} s), of which \
{ten["plan_s"]:.1f} s are the graph and the plan
({ten["processor_s"]:.1f} s of processor time, {ten["memory_gb"]:.2f} GB). Without it, the optimum \
takes {whole["processor_s"]:.1f} s
of processor time, and a plan with {corridor["steps"] - whole["steps"]} step more, proved to be \
within {corridor["bound"]:.2f} times the fewest, {corridor["processor_s"]:.1f} s.
Processor time is the sum over threads, with import and reading the map. The largest rows have no \
*whole*. {data.get("remark", "")}

![Processor time and memory against the number of points](whole_station.png)

{two_limbs_table(data["rows"])}
{bounds_section(data["rows"])}## Three and four limbs

From {STARTS} random starts before the hatch of the map `hatch`, with all limbs in the alcove, into
the module, with {LIMBED_TIME:g} s for a search and a goal tolerance of {LIMBED_TOLERANCE} m, over a
table of all nodes around the hatch. *Search exhausted* proves that no plan exists on these points,
and a bound of 1.00 that no plan has fewer steps. The handrails beside the hatch belong to the map;
*without*: the same map, if it had none.

{limbed_table(data["rows"])}
With the handrails four limbs pass the hatch from some starts; steps do not connect the
other starts with these.

{nodes_section(data["rows"])}
{across_section(data["rows"])}
`experiments/whole_station.py` makes this page.
"""


def draw(data: dict[str, Any], path: Any) -> None:
    """Draw processor time and memory against the number of points."""
    from mlivr_gym.pictures.figures import save_figure

    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    for axes, key, label in zip(
        figure.subplots(1, 2),
        ("processor_s", "memory_gb"),
        ("processor time [s]", "memory [GB]"),
        strict=True,
    ):
        colours = {"whole": "tab:red", "corridor": "tab:blue", TO_TENTH: "tab:green"}
        for method, colour in colours.items():
            rows = [
                r
                for r in data["rows"]
                if r["method"] == method and not r["station"] and "fault" not in r
            ]
            points, values = [r["points"] for r in rows], [r[key] for r in rows]
            axes.plot(points, values, "-o", color=colour, label=method, markersize=4)
        axes.axhline(AIM["time" if "time" in label else "memory"], color="0.7", linewidth=1)
        axes.set(xscale="log", yscale="log", xlabel="points of the map", ylabel=label)
        axes.legend(fontsize=6, loc="upper left")
    save_figure(figure, path, vector=False)


if __name__ == "__main__":
    experiment("whole_station", __doc__, all_measured, markdown, draw, most=LABS[-1])
