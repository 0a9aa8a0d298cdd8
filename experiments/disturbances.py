"""Simulate plans with a robot and a module that differ from what the controller assumes.

    python experiments/disturbances.py [--out results] [--tasks 200] [--each 20] [--workers 2]

A Monte Carlo study: all disturbances at once on held-out random tasks, and each disturbance alone,
for the paper's controller, for feedforward and for the guided controller. Writes
`disturbances.json`, `disturbances.md` and `disturbances.png`, a tornado chart.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from dynamic_simulation import graph_and_plans
from matplotlib.figure import Figure
from reports import CORES, experiment, study_rows, table
from scipy.stats import binomtest

from mlivr_gym.motion import Durations
from mlivr_gym.pictures import save_figure
from mlivr_gym.simulation import PACES, DisturbanceRanges, Limits, Setup, execute
from mlivr_gym.simulation.disturbances import ALL
from mlivr_gym.simulation.parameters import CONTROLLERS, PAPER, ControllerParameters

TASKS, SEED = 20270101, 77_000
"""Seeds of the held-out tasks and of their disturbances; gains were tuned with other seeds."""

CONTROLLERS: dict[str, tuple[Limits | Durations, ControllerParameters]] = {
    "guided, gentle": (PACES["gentle"], ControllerParameters()),
    "feedforward, gentle": (PACES["gentle"], CONTROLLERS["feedforward"]),
    "the paper's PD, 50 s": (Durations(), PAPER),
}
"""Pace and controller of each group of studies."""

TITLES = {
    "guided, gentle": "`full` controller, gentle pace",
    "feedforward, gentle": "`feedforward` controller, gentle pace",
    "the paper's PD, 50 s": "`paper` controller, the paper's 50 s a step",
}
"""Title of each group, with the name of the controller in `parameters.CONTROLLERS`."""

NAMES = {
    "friction": "friction to 3 N m",
    "damping": "damping to 1 N m s/rad",
    "encoder_bias": "encoders 0.5 deg off",
    "encoder_noise": "noise of encoders",
    "speed_noise": "noise of speeds",
    "delay": "2 ms of delay",
    "acceleration": "1e-3 g",
    "payload": "payload to 5 kg",
    "masses": "masses 20 % off",
    "stiffness": "grasps x 1/3 to x 3",
    "point_position": "points to 5 mm off",
    "point_angle": "points to 1 deg off",
}
"""The disturbances in words, with the ranges of `ALL`."""

ORDER = ("none", *NAMES, "all")
"""Studies of a controller in the order of the tables."""

HEAD = (
    "disturbance | walks | carried out | interval [%] | failures | grasp force [N] | "
    "capture [mm] | base error [mm]"
)


def only(disturbance: str) -> DisturbanceRanges:
    """Return one of the disturbances, with the others at their defaults."""
    return DisturbanceRanges(**{disturbance: getattr(ALL, disturbance)})


def walk(task: int, controller: str, disturbance: str, plans: int) -> dict[str, Any]:
    """Execute the plan of a task once, with its own random disturbances."""
    graph, made = graph_and_plans(plans, TASKS)
    timing, parameters = CONTROLLERS[controller]
    ranges = {"all": ALL, "none": DisturbanceRanges()}.get(disturbance) or only(disturbance)
    setup = Setup(timing, parameters, disturbances=ranges)
    plan, seed = made[task], SEED + task
    simulation = setup.simulation(graph.grasp_map, graph.robot, graph.obstacles, seed)
    done = execute(graph, plan, timing, simulation=simulation)
    failure = done.failure
    return {
        "failure": None if failure is None else failure.kind,
        "message": None if failure is None else failure.message,
        "steps": len(plan.steps),
        "done": len(done.captures),
        "time": done.simulated_time,
        "capture_distance": max((one.distance for one in done.captures), default=0.0),
        "grasp_force": float(done.peaks.grasp_force.max()),
        "base_error": done.peaks.base_error,
    }


def measured(tasks: int, each: int, workers: int) -> dict[str, Any]:
    """Return the results of each controller and each disturbance, those of all together first."""
    first = "guided, gentle"
    given: dict[str, Any] = {"workers": workers, "plans": [tasks]}
    rows = study_rows("disturbances:walk", tasks, controller=[first], disturbance=["all"], **given)
    some = study_rows(
        "disturbances:walk", each, controller=list(CONTROLLERS),
        disturbance=ORDER, **given,
    )  # fmt: skip
    rows += [row for row in some if (row["controller"], row["disturbance"]) != (first, "all")]
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in sorted(rows, key=lambda row: bool(row["disturbance"] != "all")):
        groups.setdefault(f"{row['controller']}: {row['disturbance']}", []).append(row)
    return {
        "studies": {name: summary(group) for name, group in groups.items()},
        "sizes": {field.name: getattr(ALL, field.name) for field in fields(ALL)},
    }


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the results of a study as plain data."""
    failures = Counter(row["failure"] for row in rows if row["failure"] is not None)
    count, done = len(rows), len(rows) - sum(failures.values())
    return {
        "walks": count,
        "carried_out": done,
        "share": done / count,
        "interval": list(map(float, binomtest(done, count).proportion_ci(method="wilson"))),
        "failures": dict(sorted(failures.items())),
        "steps": sum(row["steps"] for row in rows),
        "steps_done": sum(row["done"] for row in rows),
        "grasp_force_N": quantiles([row["grasp_force"] for row in rows]),
        "capture_mm": quantiles([1e3 * row["capture_distance"] for row in rows]),
        "base_error_mm": quantiles([1e3 * row["base_error"] for row in rows]),
        "seconds_a_step": float(np.mean([row["time"] / max(row["done"], 1) for row in rows])),
        "messages": [row["message"] for row in rows if row["message"] is not None],
    }


def quantiles(values: list[float]) -> list[float]:
    """Return median, 95th percentile and maximum."""
    return [float(value) for value in np.quantile(values, [0.5, 0.95, 1.0])]


def cells(field: str, row: dict[str, Any]) -> list[Any]:
    """Return the table row of a study."""
    low, high = row["interval"]
    failures = ", ".join(f"{kind} {count}" for kind, count in row["failures"].items()) or "none"
    three = [
        ", ".join(f"{value:.{digits}f}" for value in row[key])
        for key, digits in (("grasp_force_N", 0), ("capture_mm", 1), ("base_error_mm", 0))
    ]
    return [
        NAMES.get(field, field), row["walks"], f"{100 * row['share']:.1f} %",
        f"{100 * low:.1f} to {100 * high:.1f}", failures, *three,
    ]  # fmt: skip


def section(data: dict[str, Any], name: str) -> str:
    """Return the section of the page on a controller."""
    rows = [cells(field, data["studies"][f"{name}: {field}"]) for field in ORDER]
    return f"""## {TITLES[name]}

{table(HEAD, rows)}"""


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    sections = "\n".join(section(data, name) for name in CONTROLLERS)
    return f"""# A robot and a module that the controller does not know

Made by `experiments/disturbances.py`: random tasks, each executed once with its own disturbances, \
drawn uniformly from the stated ranges
(`simulation/disturbances.py`). With the \
`full` controller a sensor on the gripper that approaches (noise 1 mm and 0.5 deg)
guides the limb to the point. A walk counts as \
carried out if every step ends with a grasp, \
without contact and with no torque at its limit
for 0.1 s. Intervals are 95 % Wilson intervals.

{sections}
Forces, captures and errors: median, 95th percentile and maximum over the walks.
"""


def readme_text(data: dict[str, Any]) -> str:
    """Return the table of the docs: all disturbances at once, by controller."""
    rows = []
    for name in CONTROLLERS:
        whole, none = (data["studies"][f"{name}: {field}"] for field in ("all", "none"))
        low, high = (100 * share for share in whole["interval"])
        rows.append([
            TITLES[name], f"{whole['carried_out']} of {whole['walks']}",
            f"{low:.1f} to {high:.1f} %",
            "{1:.0f}, {2:.0f}".format(*whole["grasp_force_N"]),
            f"{none['carried_out']} of {none['walks']}",
        ])  # fmt: skip
    head = (
        "controller and pace | walks carried out with all disturbances | 95 % interval | "
        "grasp force, 95 % and largest [N] | carried out without disturbances"
    )
    return table(head, rows)


def tornado(data: dict[str, Any], path: Path) -> None:
    """Draw the share of walks that fail for each disturbance and controller."""
    figure = Figure(figsize=(11.0, 5.4), layout="constrained")
    axes = figure.subplots(1, len(CONTROLLERS), sharey=True, sharex=True)
    for axis, (name, colour) in zip(
        axes, zip(CONTROLLERS, ("#1f5fd0", "#17a2a2", "#d62728"), strict=True), strict=True
    ):
        for place, field in enumerate(reversed(ORDER)):
            row = data["studies"][f"{name}: {field}"]
            low, high = row["interval"]
            failed = 100.0 * (1.0 - row["share"])
            axis.barh(place, failed, color=colour, height=0.7)
            span = np.maximum([[failed - 100.0 * (1.0 - high)], [100.0 * (1.0 - low) - failed]], 0)
            axis.errorbar(failed, place, xerr=span, color="0.25", capsize=2.5, linewidth=1.0)
        axis.set_title(TITLES[name].replace("`", ""), fontsize=10)
        axis.set_xlim(0.0, 100.0)
        axis.grid(axis="x", alpha=0.3)
        axis.set_xlabel("walks that fail [%]")
    axes[0].set_yticks(range(len(ORDER)), [NAMES.get(name, name) for name in reversed(ORDER)])
    figure.suptitle("Walks that fail, by disturbance; thin lines: 95 % intervals", fontsize=11)
    save_figure(figure, path)


if __name__ == "__main__":
    options = {"tasks": 200, "each": 20, "workers": CORES}
    experiment("disturbances", __doc__, measured, markdown, tornado, **options)
