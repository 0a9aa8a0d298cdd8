"""Compare duration, steps and base translation of plans that are optimal for different costs.

    python experiments/time_cost.py [--out results] [--tasks 40]

For each random task, one plan is made for each cost of `fastest.COSTS`, and each of its steps gets
the time-optimal time scaling at the default limits. The means over the tasks form a Pareto front;
`fastest` is the quickest of the plans of a task. Writes `time_cost.json`, `time_cost.md` and
`time_cost.png`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from reports import experiment, table
from tqdm import tqdm

from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.fastest import COSTS, step_durations
from mlivr_gym.pictures.figures import save_figure
from mlivr_gym.planners import Planner
from mlivr_gym.stances.build import stance_graph

SEED = 20270103
"""Seed of the random tasks."""


def measured(tasks: int) -> dict[str, Any]:
    """Return duration [s], number of steps and base translation [m] of each plan of each task."""
    planner, rng = Planner(stance_graph()), np.random.default_rng(SEED)
    rows = []
    for _ in tqdm(range(tasks), desc="tasks", mininterval=5.0):
        start, goal = sample_task(planner.graph, rng, 0.2)
        row = {}
        for cost, price in COSTS:
            plan = planner.plan(start.stance, goal, cost, regrasp_price=price).unwrap()
            seconds = sum(step_durations(planner.graph, plan)) if plan.steps else 0.0
            name = cost if price is None else f"{price:g} m a regrasp"
            row[name] = [seconds, len(plan.steps), plan.base_translation]
        row["fastest"] = min(row.values())
        rows.append(row)
    return {"tasks": rows}


def means(data: dict[str, Any]) -> dict[str, list[float]]:
    """Return the means of duration, steps and base translation for each cost."""
    rows = data["tasks"]
    return {name: np.mean([row[name] for row in rows], axis=0).tolist() for name in rows[0]}


def markdown(data: dict[str, Any]) -> str:
    """Return the page with the table of means."""
    rows, cells = data["tasks"], []
    for name, (seconds, steps, translation) in means(data).items():
        wins = sum(row[name][0] <= row["fastest"][0] + 1e-9 for row in rows)
        cells.append([name, f"{seconds:.1f}", f"{steps:.2f}", f"{translation:.2f}", wins])
    return f"""# Time as a cost

Made by `experiments/time_cost.py`: {len(rows)} random tasks, collisions checked, time-optimal \
time scaling at the default limits. Values are
means over the tasks; *fastest* is the fastest plan of each task, and *wins* counts the tasks in \
which the plan of a cost is as fast. Other plans
could be faster: the times have no lower bound.

{table("optimal for | time [s] | steps | base translation [m] | wins", cells)}"""


def front(data: dict[str, Any], path: Path) -> None:
    """Draw mean duration against mean base translation and against mean number of steps."""
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    places: dict[tuple[float, ...], list[str]] = {}
    for name, mean in means(data).items():
        places.setdefault(tuple(np.round(mean, 6)), []).append(name.removesuffix(" a regrasp"))
    for k, ((seconds, steps, translation), names) in enumerate(places.items()):
        best = "fastest" in names
        shift = (6, 5) if k % 2 else (6, -10)
        for axis, value in zip(axes, (translation, steps), strict=True):
            axis.plot(value, seconds, "*" if best else "o", color="#d62728" if best else "#1f5fd0")
            axis.annotate(", ".join(names), (value, seconds), xytext=shift,
                          textcoords="offset points", fontsize=7)  # fmt: skip
    axes[0].set(xlabel="mean base translation [m]", ylabel="mean time of a plan [s]")
    axes[1].set(xlabel="mean number of steps")
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.margins(0.15)
    figure.suptitle(
        f"Plans of {len(data['tasks'])} tasks, optimal for base, steps, or a price of a regrasp "
        "[m] (axes do not start at 0)",
        fontsize=10,
    )
    save_figure(figure, path)


if __name__ == "__main__":
    experiment("time_cost", __doc__, measured, markdown, front, tasks=40)
