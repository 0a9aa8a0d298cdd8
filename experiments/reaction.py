"""Compare 50 plans of one query by steps, base translation, time, and the force on the station.

    python experiments/reaction.py [--out results] [--tasks 20] [--workers 2]

The plans are optimal for the costs of `fastest.COSTS`, have the motion of the search or that of
least reaction on the same footholds, and are carried out in MuJoCo within several limits of the
grasp force. For random tasks the costs are compared by the planned motion. Writes
`reaction.json`, `reaction.md` and `reaction.png`.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from reports import CORES, GOAL, START, experiment, graph_and_tasks, study_rows, table

from mlivr_gym import stance_graph
from mlivr_gym.arrays import BoolArray
from mlivr_gym.extensions.reaction import ranked_plans, step_reactions
from mlivr_gym.extensions.station_load import station_load
from mlivr_gym.pictures import save_figure
from mlivr_gym.planners import Planner
from mlivr_gym.simulation import Limits, execute

SEED = 20270405
"""Seed of the random tasks."""

FORCES = (15.0, 25.0, 40.0, 60.0, 80.0)
"""Limits of the grasp force [N]."""

CHOICES = ("least base translation", "fewest steps", "`time`", "`reaction`")
"""Which of the plans of a random task is chosen."""

COLOURS = ("#1f5fd0", "#d62728", "#2ca02c", "#9467bd")
"""Colours of the numbers of steps."""

MOTIONS = {"of the search": "time", "least reaction": "reaction"}
"""How base poses and swings are chosen, by what the best plan is best in."""


def plans_within(task: int, limit: float, motion: str) -> dict[str, Any]:
    """Plan the query for each cost within a limit of the grasp force, and carry the plans out.

    Returned are steps, base translation [m], time [s], forces [N] and impulses [N s] of each plan.
    """
    graph, plans = stance_graph(), []
    limits = Limits(grasp_force=limit, grasp_torque=0.5 * limit)
    for found in ranked_plans(Planner(graph), START, GOAL, limits, MOTIONS[motion]):
        plan = found.plan
        walked, planned = execute(graph, plan, limits), step_reactions(graph, plan, limits)
        load = station_load(walked.recording)
        sizes = np.linalg.norm(load.forces, axis=1)
        plans.append({
            "cost": found.cost if found.price is None else f"{found.price:g} m a regrasp",
            "motion": motion,
            "limit": limit,
            "steps": len(plan.steps),
            "translation": plan.base_translation,
            "time": walked.simulated_time,
            "peak": float(load.peak_forces.max()),
            "impulse": float(np.trapezoid(sizes, load.times)),
            "planned_peak": max(one.peak_force for one in planned),
            "planned_impulse": sum(one.impulse for one in planned),
            "failed": walked.failure is not None,
        })  # fmt: skip
    return {"plans": plans}


def choices(task: int, count: int) -> dict[str, Any]:
    """Return the values of each choice for a random task, and the time of the last [s]."""
    graph, drawn = graph_and_tasks(count, SEED)
    planner, (state, target) = Planner(graph), drawn[task]
    found = ranked_plans(planner, state.stance, target)
    before = time.process_time()
    least = ranked_plans(planner, state.stance, target, best="reaction")
    spent = time.process_time() - before
    chosen = (
        min(found, key=lambda one: one.plan.base_translation),
        min(found, key=lambda one: (len(one.plan.steps), one.plan.base_translation)),
        found[0],
        least[0],
    )
    values = [
        [len(c.plan.steps), c.plan.base_translation, c.seconds, c.peak_force, c.impulse]
        for c in chosen
    ]
    return {"values": values, "spent": spent}


def measured(tasks: int, workers: int) -> dict[str, Any]:
    """Return the rows of the 50 plans, and means of the choices over random tasks."""
    runs = study_rows("reaction:plans_within", 1, workers, limit=FORCES, motion=list(MOTIONS))
    rows = study_rows("reaction:choices", tasks, workers, count=[tasks])
    return {
        "plans": [one for run in runs for one in run["plans"]],
        "tasks": tasks,
        "means": np.mean([row["values"] for row in rows], axis=0).tolist(),
        "spent": float(np.mean([row["spent"] for row in rows])),
    }


def in_front(rows: list[dict[str, Any]]) -> BoolArray:
    """Return which plans no other one surpasses in steps, translation, time and peak force."""
    values = np.array([[row[n] for n in ("steps", "translation", "time", "peak")] for row in rows])
    no_worse = (values[:, None] <= values[None] + 1e-9).all(axis=2)
    better = (values[:, None] < values[None] - 1e-9).any(axis=2)
    front: BoolArray = ~(no_worse & better).any(axis=0)
    return front


def markdown(data: dict[str, Any]) -> str:
    """Return the page with the front and the means over random tasks."""
    rows, front = data["plans"], in_front(data["plans"])
    best = [row for row, is_in in zip(rows, front, strict=True) if is_in]
    best.sort(key=lambda row: (row["steps"], row["translation"], row["time"]))
    cells = [
        [
            row["steps"], f"{row['translation']:.2f}", f"{row['time']:.1f}", f"{row['peak']:.1f}",
            f"{row['impulse']:.0f}", row["cost"], row["motion"], f"{row['limit']:g}",
        ]
        for row in best
    ]  # fmt: skip
    means = [
        [name, f"{s:.1f}", f"{m:.2f}", f"{t:.1f}", f"{peak:.1f}", f"{impulse:.0f}"]
        for name, (s, m, t, peak, impulse) in zip(CHOICES, data["means"], strict=True)
    ]
    off = [abs(row["planned_impulse"] / row["impulse"] - 1.0) for row in rows]
    peaks = [abs(row["planned_peak"] / row["peak"] - 1.0) for row in rows]
    failed, at = sum(row["failed"] for row in rows), dict(zip(CHOICES, data["means"], strict=True))
    impulse, peak = (100.0 * (1.0 - at["`reaction`"][k] / at["`time`"][k]) for k in (4, 3))
    fewer = 100.0 * (1.0 - at["`reaction`"][4] / at["least base translation"][4])
    head = (
        "steps | base translation [m] | time [s] | peak force [N] | total impulse [N s] | "
        "optimal for | motion | limit of grasp force [N]"
    )
    titles = (
        "choice | steps | base translation [m] | time [s] | peak force [N] | total impulse [N s]"
    )
    return f"""# Little reaction as a cost

Made by `experiments/reaction.py`. The reaction of a step is the force on the station; its *total \
impulse* is the integral of the magnitude of that force.
`plan --cost reaction` chooses, among plans that are optimal for several costs, the one of the \
least total impulse, after it has chosen other base poses and
clear swings on the footholds of each ([how](../docs/how-to/simulate.md#choose-the-speed)).

## Front of {len(rows)} plans

Five plans from {" and ".join(START)} to {GOAL}, each with the motion of the search and with \
that of least reaction, carried out in MuJoCo
within {len(FORCES)} limits of the grasp force; {failed} of {len(rows)} walks failed. {len(best)} \
plans are surpassed by no other one in steps, translation, time and
peak force together; the table and the picture show these. The planned motion alone predicts the \
measured impulse to {100 * max(off):.1f} %
and the measured peak force to {100 * max(peaks):.0f} % in each walk.

{table(head, cells)}
![Peak force over time and over base translation](reaction.png)

## Choices over random tasks

Means of {data["tasks"]} random tasks, by the planned motion at the default limits. The cost \
`reaction` saves {impulse:.0f} % of the total impulse and {peak:.0f} % of the
peak force against `time`, and {fewer:.0f} % of the impulse against the least base translation. \
Neither bounds what other plans could save. A query takes {data["spent"]:.0f} s
of processor time.

{table(titles, means)}"""


def picture(data: dict[str, Any], path: Path) -> None:
    """Draw peak force over time and over base translation, with the front filled."""
    figure = Figure(figsize=(9.5, 4.0), layout="constrained")
    axes, rows, front = figure.subplots(1, 2, sharey=True), data["plans"], in_front(data["plans"])
    counts = sorted({row["steps"] for row in rows})
    for count, colour in zip(counts, COLOURS, strict=False):
        for is_in in (False, True):
            some = [
                r for r, f in zip(rows, front, strict=True) if r["steps"] == count and f == is_in
            ]
            for axis, name in zip(axes, ("time", "translation"), strict=True):
                axis.scatter(
                    [r[name] for r in some], [r["peak"] for r in some], s=30, edgecolors=colour,
                    facecolors=colour if is_in else "none",
                    label=f"{count} steps" if is_in else None,
                )  # fmt: skip
    axes[0].set(xlabel="time [s]", ylabel="peak force on the station [N]")
    axes[1].set(xlabel="base translation [m] (axis does not start at 0)")
    axes[0].set(xlim=(0.0, None), ylim=(0.0, None))
    axes[0].legend(fontsize=8)
    for axis in axes:
        axis.grid(alpha=0.3)
    figure.suptitle(
        f"{len(rows)} plans of one query; filled: no plan is better in steps, translation, time "
        "and peak force together", fontsize=10,
    )  # fmt: skip
    save_figure(figure, path)


if __name__ == "__main__":
    experiment("reaction", __doc__, measured, markdown, picture, tasks=20, workers=CORES)
