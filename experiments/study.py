"""Run a study of thresholds and layouts with both engines, and estimate a large one from it.

    python experiments/study.py [--out results] [--tasks 100] [--workers 2]

The study varies the threshold of the limb manipulability and the share of occupied points. Each
threshold but that of the paper gives a stance graph that no shipped table has, as a robot of a user
does. Writes `study.json`, `study.md` and `study.png`.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from statistics import fmean
from typing import Any

from matplotlib.figure import Figure
from reports import experiment, table

from mlivr_gym.pictures.figures import save_figure
from mlivr_gym.studies import ENGINES, StudyDesign, read_study, run_study
from mlivr_gym.studies.rows import succeeded

THRESHOLDS, SHARES = (0.05, 0.08, 0.1, 0.12), (0.0, 0.4, 0.8, 0.9)
PAIRS, MACHINES, TASKS = 10_000, 100, 20
"""Pairs of a robot and a map, machines with two cores, and tasks of each pair of the estimate."""


def design_of(tasks: int) -> StudyDesign:
    """Return the design of the study."""
    factors = {"limb_threshold": list(THRESHOLDS), "occupied": list(SHARES)}
    return StudyDesign.from_data({"kind": "plan", "tasks": tasks, "factors": factors})


def measured(tasks: int, workers: int) -> dict[str, Any]:
    """Run the study with each engine; return the counts of each combination, and the times."""
    design, found = design_of(tasks), {}
    for engine in ENGINES:
        with tempfile.TemporaryDirectory() as folder:
            began = time.perf_counter()
            run_study(design, folder, engine, workers=workers)
            found[engine] = time.perf_counter() - began, read_study(folder)
    (local, rows), (dask, others) = (found[engine] for engine in ENGINES)
    cells = []
    for k, levels in enumerate(design.combinations):
        some = rows[k * tasks : (k + 1) * tasks]
        solved = [row["steps"] for row in some if succeeded("plan", row)]
        cells.append({
            "limb_threshold": levels["limb_threshold"], "occupied": levels["occupied"],
            "starts": sum(not row["error"] for row in some), "solved": len(solved),
            "steps": fmean(solved) if solved else None,
        })  # fmt: skip
    return {
        "tasks": tasks, "workers": workers, "runs": len(rows), "local_s": local, "dask_s": dask,
        "different": different(rows, others), "cells": cells,
        "pair_s": new_pair(design_of(TASKS)),
    }  # fmt: skip


def different(rows: list[dict[str, Any]], others: list[dict[str, Any]]) -> list[str]:
    """Return the columns in which rows differ, without the time, which always does."""
    pairs = list(zip(rows, others, strict=True))
    names = [name for name in rows[0] if name != "seconds"]
    return [name for name in names if any(one[name] != other[name] for one, other in pairs)]


def new_pair(design: StudyDesign) -> float:
    """Return the time of one process for the tasks of a new robot on a map [s]."""
    factors = {"limb_threshold": [0.07, 0.08, 0.09]}
    others = StudyDesign.from_data(design.to_data() | {"factors": factors})
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        run_study(others, folder, workers=1)
        return (time.perf_counter() - began) / len(factors["limb_threshold"])


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    rows = [
        (
            f"{cell['limb_threshold']:g}", f"{100 * cell['occupied']:.0f} %",
            f"{cell['solved']} of {cell['starts']}",
            "" if cell["steps"] is None else f"{cell['steps']:.2f}",
        )
        for cell in data["cells"]
    ]  # fmt: skip
    hours = data["pair_s"] * PAIRS / (2 * MACHINES) / 3600.0
    differ = ", ".join(f"`{name}`" for name in ["seconds", *data["different"]])
    return f"""# A study with two engines

Made by `experiments/study.py`: {data["runs"]} plans of two limbs on the JEM with the step cost, \
{data["tasks"]} random tasks for each threshold of the limb manipulability and each share of \
occupied points. A task counts where its start can be drawn.

{table("threshold of w_m | occupied points | with a plan | mean steps", rows)}
With {data["workers"]} processes the study took {data["local_s"]:.0f} s with the engine `local` \
and {data["dask_s"]:.0f} s with `dask`, beside other work; their rows are equal but for the \
columns {differ}.

**A large study, on paper.** A robot on a map for which no table ships, with {TASKS} tasks, took \
one process {data["pair_s"]:.1f} s, the start of the process included. So {PAIRS:,} pairs of a \
robot and a map on {MACHINES} machines of two cores would take {hours:.1f} hours, if nothing is \
lost by sharing them out. Two limbs; tables of three and four limbs take far longer.
"""


def picture(data: dict[str, Any], path: Path) -> None:
    """Draw the share of tasks with a plan, and the mean steps, over the occupied points."""
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    shares, steps = figure.subplots(1, 2, sharex=True)
    colours, marks = ("#1f5fd0", "#17a2a2", "#e08a1e", "#d62728"), "os^D"
    for threshold, colour, mark in zip(THRESHOLDS, colours, marks, strict=True):
        cells = [cell for cell in data["cells"] if cell["limb_threshold"] == threshold]
        occupied = [100.0 * cell["occupied"] for cell in cells]
        look = {"color": colour, "marker": mark, "label": f"$w_m \\geq {threshold:g}$"}
        shares.plot(
            occupied, [100.0 * cell["solved"] / max(cell["starts"], 1) for cell in cells], **look
        )
        steps.plot(occupied, [cell["steps"] or float("nan") for cell in cells], **look)
    shares.set(ylabel="tasks with a plan [%]", ylim=(0.0, 103.0))
    steps.set(ylabel="mean steps of the plans", ylim=(0.0, None))
    for axes in (shares, steps):
        axes.set_xlabel("occupied points [%]")
        axes.grid(alpha=0.3)
    shares.legend(title="threshold of the limb manipulability", fontsize=9)
    save_figure(figure, path)


if __name__ == "__main__":
    experiment("study", __doc__, measured, markdown, picture, tasks=100, workers=2)
