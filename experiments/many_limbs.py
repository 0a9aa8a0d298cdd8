"""Measure plans of three and four limbs on random tasks, and compare other methods.

    python experiments/many_limbs.py [--out results] [--tasks 20] [--seconds 10]

A task leads from a random state that some step leaves to the base position of another one, 1 to 5 m
away, on the JEM with collisions checked. Each task is planned with two costs for `--seconds`; the
plans are then executed in MuJoCo at default timing. For some tasks the search proves that no plan
exists; the others without a plan remain undecided. Other methods get the same tasks with the step
cost and the same time. Writes `many_limbs.json`, `many_limbs.md` and `many_limbs.png`; a task takes
up to `--seconds` for each of two costs and six methods.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from reports import experiment, study_rows, table

from mlivr_gym import stance_graph
from mlivr_gym.arrays import Array
from mlivr_gym.motion import Plan
from mlivr_gym.pictures import save_figure
from mlivr_gym.planners import PROVED_IMPOSSIBLE, Planner
from mlivr_gym.stances import StanceGraph, State, random_state

ROBOTS, COSTS = ("mlivr3", "mlivr4"), ("steps", "base")
NEAREST, FARTHEST = 1.0, 5.0
"""Minimum and maximum distance of goals [m]."""

REPLANNING = 2.0
"""Time limit of a plan around an occupied point [s]."""

SOONEST_SHOWN, MOST_SHOWN = 0.02, 2.5
"""Shortest time [s] and largest factor that the figure shows."""

WELL_PROVED = 1.5
"""Optimality bound of plans that count as well proved."""


def random_task(graph: StanceGraph, rng: np.random.Generator) -> tuple[State, Array]:
    """Return a random state that some step leaves, and the base position of another one."""
    while True:
        start, end = random_state(graph, rng), random_state(graph, rng)
        goal = graph.posture_of(end).base_position[0]
        away = float(np.linalg.norm(goal - graph.posture_of(start).base_position[0]))
        if NEAREST <= away <= FARTHEST:
            return start, goal


def task_results(task: int, robot: str, seconds: float) -> dict[str, Any]:
    """Plan a task with both costs."""
    graph = stance_graph(robot=robot)
    start, goal = random_task(graph, np.random.default_rng([task, graph.limbs]))
    away = float(np.linalg.norm(goal - graph.posture_of(start).base_position[0]))
    out: dict[str, Any] = {"distance": away}
    for cost in COSTS:
        fresh = stance_graph(robot=robot)
        planner = Planner(fresh)
        found = planner.plan(start.stance, goal.tolist(), cost, time_limit=seconds)
        out[cost] = {
            "reason": found.reason,
            "improvements": [[one.time, one.cost, one.bound] for one in found.improvements],
            "bound": found.plan.statistics.bound if found.plan else None,
            "steps": len(found.plan.steps) if found.plan else None,
            "executed": executed(fresh, found.plan) if found.plan else None,
            "replanned": replanned(planner, found.plan, goal, cost) if found.plan else None,
        }
    return out


def replanned(planner: Planner, plan: Plan, goal: Array, cost: str) -> float | None:
    """Return the time of a first plan once a point that the plan grasps is occupied [s]."""
    start = plan.stances[0]
    grasped = [step.to_point for step in plan.steps if step.to_point not in start]
    if not grasped:
        return None
    planner.graph.occupy([grasped[len(grasped) // 2]])
    again = planner.plan(start, goal.tolist(), cost, time_limit=REPLANNING)
    return again.improvements[0].time if again.improvements else REPLANNING


def executed(graph: StanceGraph, plan: Plan) -> bool:
    """Return whether MuJoCo executes a plan without contact."""
    from mlivr_gym.simulation import execute  # loads GL

    return execute(graph, plan).failure is None


TASKS = (
    "robot | cost | tasks | plans | none exists | undecided | first plan [s] | within 0.5 s | "
    "within 2 s | first over last | bound | the least | within 1.5 | steps | replanned [s] | "
    "carried out"
)
"""Head of the table."""


def measured(tasks: int, seconds: float, workers: int) -> dict[str, Any]:
    """Return the results of all robots."""
    given = {"robot": ROBOTS, "seconds": [seconds]}
    rows = study_rows("many_limbs:task_results", tasks, workers, **given)
    names = ("distance", *COSTS)
    return {
        "workers": workers,
        "seconds": seconds,
        "tasks": {
            robot: [{name: row[name] for name in names} for row in rows if row["robot"] == robot]
            for robot in ROBOTS
        },
    }


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    tasks = [
        task_row(robot, cost, [task[cost] for task in data["tasks"][robot]])
        for robot in ROBOTS
        for cost in COSTS
    ]
    return f"""# Three and four limbs

Made by `experiments/many_limbs.py`: the JEM, collisions checked, {data["seconds"]:g} s per task \
and cost. Only the table of all nodes is known beforehand; it ships and is unpacked once ([time of \
this](start_up.md)). Measured on two cores, tasks in parallel: {data.get("workers", 1)}.

![Share of tasks with a plan over time](many_limbs.png)

## Random tasks

*None exists*: tasks that are proved to have no plan; shares leave them out. *Undecided*: neither \
a plan nor such a proof. *First plan*: median time over the tasks with a plan; *within* 0.5 and 2 \
s: share of tasks. *First over last*: cost of the first plan over that of the last one, median. \
*Bound*: proved optimality bound of the last plan, median; *the least* and *within 1.5*: share of \
tasks whose plan is proved optimal, or within 1.5 times the minimum cost. *Replanned*: time of a \
first plan by the same planner once a point is occupied that the plan grasps half-way, median and \
95 %.

{table(TASKS, tasks)}"""


def task_row(robot: str, cost: str, found: list[dict[str, Any]]) -> list[Any]:
    """Return the row of a robot and a cost in the table of tasks."""
    plans = [one for one in found if one["improvements"]]
    none = sum(one["reason"] in PROVED_IMPOSSIBLE for one in found)
    counts = [f"`{robot}`", cost, len(found), len(plans), none, len(found) - len(plans) - none]
    if not plans:
        return counts + ["-"] * 10
    solvable = max(len(found) - none, 1)
    bounds = np.array([one["bound"] or np.inf for one in plans])
    best, good = ((bounds <= most).sum() / solvable for most in (1.0 + 1e-6, WELL_PROVED))
    first = np.array([one["improvements"][0][0] for one in plans])
    soon = [f"{(first <= most).sum() / solvable:.0%}" for most in (0.5, 2.0)]
    ratio = np.median([one["improvements"][0][1] / one["improvements"][-1][1] for one in plans])
    again = [one["replanned"] for one in plans if one["replanned"] is not None]
    return [
        *counts, f"{np.median(first):.2f}", *soon, f"{ratio:.2f}", f"{np.median(bounds):.2f}",
        f"{best:.0%}", f"{good:.0%}", f"{np.mean([one['steps'] for one in plans]):.1f}",
        "{:.2f}, {:.2f}".format(*np.percentile(again, (50, 95))) if again else "-",
        f"{sum(bool(one['executed']) for one in plans)} of {len(plans)}",
    ]  # fmt: skip


def curves(data: dict[str, Any], path: Path) -> None:
    """Plot the share of tasks with a plan over time, and the bounds of the last plans."""
    figure = Figure(figsize=(9.0, 6.4), layout="constrained")
    axes = figure.subplots(2, 2, sharey=True)
    for column, robot in enumerate(ROBOTS):
        above, below = axes[:, column]
        for cost, colour in zip(COSTS, ("#1f5fd0", "#d62728"), strict=True):
            found = [task[cost] for task in data["tasks"][robot]]
            first = sorted(one["improvements"][0][0] for one in found if one["improvements"])
            bounds = sorted(one["bound"] for one in found if one["bound"] is not None)
            for axis, values, end in ((above, first, data["seconds"]), (below, bounds, MOST_SHOWN)):
                share = np.arange(1, len(values) + 1) / len(found)
                axis.step([0.0, *values, end], [0.0, *share, share[-1] if values else 0.0],
                          where="post", color=colour, label=f"cost {cost}")  # fmt: skip
            none = sum(one["reason"] in PROVED_IMPOSSIBLE for one in found) / len(found)
        for axis in (above, below):
            axis.axhspan(1.0 - none, 1.0, color="#dddddd", linewidth=0.0, label="have no plan")
        above.set_title(robot)
        above.set_xscale("log")
        above.set_xlim(SOONEST_SHOWN, data["seconds"])
        above.set_xlabel("time of the first plan [s]")
        below.set_xlabel("last plan proved within this factor of the least cost")
        below.set_xlim(1.0, MOST_SHOWN)
        below.axvline(WELL_PROVED, color="#666666", linewidth=0.8, linestyle=":")
        for axis in (above, below):
            axis.grid(alpha=0.3)
            axis.legend(loc="lower right")
    axes[0, 0].set_ylabel("share of the tasks with a plan")
    axes[1, 0].set_ylabel("share of the tasks")
    axes[0, 0].set_ylim(0.0, 1.0)
    save_figure(figure, path)


if __name__ == "__main__":
    experiment(
        "many_limbs", __doc__, measured, markdown, curves,
        tasks=20, seconds=10.0, workers=1,
    )  # fmt: skip
