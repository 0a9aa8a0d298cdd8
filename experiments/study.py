"""Run a study of thresholds and layouts with both engines, and estimate a large one from it.

    python experiments/study.py [--out results] [--tasks 100] [--workers 2]

The study varies the threshold of the limb manipulability and the share of occupied points. The
estimate is that of new robots, with grippers of other lengths, on the JEM: random tasks, and the
complete table of their steps. Writes `study.json`, `study.md` and `study.png`.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from pathlib import Path
from statistics import fmean
from typing import Any

from matplotlib.figure import Figure
from reports import experiment, table

from mlivr_gym.compiled.cache import cache_folder
from mlivr_gym.files import write_whole
from mlivr_gym.pictures.figures import save_figure
from mlivr_gym.studies import ENGINES, StudyDesign, read_study, run_study
from mlivr_gym.studies.rows import succeeded

THRESHOLDS, SHARES = (0.05, 0.08, 0.1, 0.12), (0.0, 0.4, 0.8, 0.9)
PAIRS, MACHINES, TASKS = 10_000, 100, 20
"""Pairs of a robot and a map, machines with two cores, and tasks of each pair of the estimate."""

TOOL_LENGTHS = (0.1537, 0.1617)
"""Distance from flange to grasped point of the new robots of the estimate [m]."""


def design_of(tasks: int) -> StudyDesign:
    """Return the design of the study."""
    factors = {"limb_threshold": list(THRESHOLDS), "occupied": list(SHARES)}
    return StudyDesign.from_data({"kind": "plan", "tasks": tasks, "factors": factors})


def measured(tasks: int, workers: int) -> dict[str, Any]:
    """Return the counts of each combination, and the times of both engines and of new robots."""
    return counted_runs(tasks, workers) | {"pairs": new_pairs()}


def counted_runs(tasks: int, workers: int) -> dict[str, Any]:
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
    }  # fmt: skip


def different(rows: list[dict[str, Any]], others: list[dict[str, Any]]) -> list[str]:
    """Return the columns in which rows differ, without the time, which always does."""
    pairs = list(zip(rows, others, strict=True))
    names = [name for name in rows[0] if name != "seconds"]
    return [name for name in names if any(one[name] != other[name] for one, other in pairs)]


def new_pairs() -> dict[str, float]:
    """Return the processor time of a new robot on the JEM [s], without a table of steps.

    `plan_s` is that of the tasks, `build_s` that of the complete table, which is removed again.
    """
    found, cache = {}, cache_folder()
    with tempfile.TemporaryDirectory() as folder:
        robots = []
        for length in TOOL_LENGTHS:
            robots.append(f"{folder}/robot-{length}.json")
            given = {"name": f"tool-{length}", "tool_length": length}
            write_whole(robots[-1], json.dumps(given))
        for kind, tasks in (("plan", TASKS), ("build", 1)):
            data = {"kind": kind, "tasks": tasks, "factors": {"robot": robots}}
            began = os.times()
            run_study(StudyDesign.from_data(data), f"{folder}/{kind}", workers=1)
            ended = os.times()
            spent = [ended[k] - began[k] for k in (2, 3)]  # of the process that has ended
            found[f"{kind}_s"] = sum(spent) / len(robots)
        for row in read_study(f"{folder}/build"):
            assert cache is not None
            (cache / row["file"]).unlink()
    return found


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
    spent = data["pairs"]
    hours = {name: one * PAIRS / (2 * MACHINES) / 3600.0 for name, one in spent.items()}
    differ = ", ".join(f"`{name}`" for name in ["seconds", *data["different"]])
    return f"""# A study with two engines

Made by `experiments/study.py`: {data["runs"]} plans of two limbs on the JEM with the step cost, \
{data["tasks"]} random tasks for each threshold of the limb manipulability and each share of \
occupied points. A task counts where its start can be drawn.

{table("threshold of w_m | occupied points | with a plan | mean steps", rows)}
With {data["workers"]} processes the study took {data["local_s"]:.0f} s with the engine `local` \
and {data["dask_s"]:.0f} s with `dask`, beside other work; their rows are equal but for the \
columns {differ}.

**A large study, on paper.** {TASKS} tasks of a new robot on the JEM, for which no table ships, \
took {spent["plan_s"]:.1f} s of processor time, and the complete table of its steps \
{spent["build_s"]:.0f} s, beside other work, each with half of the start of a process for \
{len(TOOL_LENGTHS)} robots. So {PAIRS:,} pairs of a robot and a map on {MACHINES} machines of two \
cores would take {60 * hours["plan_s"]:.1f} minutes with these tasks, and \
{hours["build_s"]:.1f} hours if all tables are built, if nothing is lost by sharing them out. Two \
limbs; more take far longer.
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
