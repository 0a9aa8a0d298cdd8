"""Compare plans of random tasks by steps, translation, time, and what the station feels of them.

    python experiments/station_load.py [--out results] [--tasks 10] [--workers 2]

Each plan is optimal for one cost and is carried out in MuJoCo at each pace. Writes
`station_load.json`, `station_load.md`, and a picture of one walk, `station_load.png` and `.svg`.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from reports import CORES, case_3, experiment, study_rows, table

from mlivr_gym import stance_graph
from mlivr_gym.arrays import Array
from mlivr_gym.envs import sample_task
from mlivr_gym.extensions.station_load import STATION_MASS, load_figure, station_load
from mlivr_gym.planners import Planner
from mlivr_gym.simulation import PACES, execute
from mlivr_gym.stances import State

SEED = 20270211
"""Seed of the random tasks."""

FEWEST_STEPS = 4
"""Tasks that need fewer steps are left out."""

COSTS = {"base": None, "0.1 m a regrasp": 0.1, "steps": None}
"""Costs of the plans, with the price of a regrasp [m]."""

PACE_NAMES = ("fast", "gentle")
"""Paces, see `simulation.parameters`."""


def drawn(planner: Planner) -> Iterator[tuple[State, Array]]:
    """Yield start and goal of random tasks that need enough steps."""
    rng = np.random.default_rng(SEED)
    while True:
        start, goal = sample_task(planner.graph, rng, 0.2)
        if len(planner.plan(start.stance, goal, "steps").unwrap().steps) >= FEWEST_STEPS:
            yield start, goal


def walk(task: int, cost: str, pace: str) -> dict[str, Any]:
    """Return the figures of a plan: steps, translation [m], time [s], and the load.

    The load is the peak force [N], the impulse [N s], the peak torque [N m] and the angular impulse
    [N m s], the largest of any step, and the ratio of the acceleration to its limit.
    """
    planner, price = Planner(stance_graph()), COSTS[cost]
    start, goal = next(islice(drawn(planner), task, None))
    name = cost if price is None else "weighted"
    plan = planner.plan(start.stance, goal, name, regrasp_price=price).unwrap()
    walked = execute(planner.graph, plan, PACES[pace])
    load = station_load(walked.recording)
    values = [
        len(plan.steps), plan.base_translation, walked.simulated_time,
        float(load.peak_forces.max()), float(load.impulses.max()),
        float(load.peak_torques.max()), float(load.angular_impulses.max()), load.largest_ratio,
    ]  # fmt: skip
    return {"failed": walked.failure is not None, "values": values}


def measured(tasks: int, workers: int) -> dict[str, Any]:
    """Return the figures of all walks, see `walk`."""
    rows = study_rows("station_load:walk", tasks, workers, cost=list(COSTS), pace=PACE_NAMES)
    names = "cost", "pace", "failed", "values"
    return {"tasks": tasks, "walks": [{name: row[name] for name in names} for row in rows]}


def markdown(data: dict[str, Any]) -> str:
    """Return the page with the table of means."""
    walks, cells = data["walks"], []
    for pace in PACE_NAMES:
        for cost in COSTS:
            some = [w["values"] for w in walks if (w["cost"], w["pace"]) == (cost, pace)]
            means = np.mean(some, axis=0)
            cells.append(
                [
                    pace, cost, f"{means[0]:.1f}", f"{means[1]:.2f}", f"{means[2]:.0f}",
                    *(f"{mean:.1f}" for mean in means[3:7]), f"{means[7]:.2f}",
                ]
            )  # fmt: skip
    failed, largest = sum(w["failed"] for w in walks), max(w["values"][7] for w in walks)
    head = (
        "pace | optimal for | steps | base translation [m] | time [s] | peak force [N] | "
        "impulse [N s] | peak torque [N m] | angular impulse [N m s] | acceleration over limit"
    )
    return f"""# What the station feels of a walk

Made by `experiments/station_load.py`: {data["tasks"]} random tasks of two limbs in the JEM \
of at least {FEWEST_STEPS} steps, carried out in MuJoCo without disturbances;
{failed} of {len(walks)} walks failed. Values are means over the tasks. *Impulse* is the largest \
that the module receives within a step; from
rest to rest a step leaves none. *Torque* and *angular impulse* are about the \
origin of the module frame, the middle of the end at which
Node 2 holds the module. *Acceleration over limit* is the largest ratio, over all \
one-third octave bands from 0.01 to 20 Hz, of
the station's acceleration (root mean square over 100 s, a rigid body of {STATION_MASS:,.0f} kg) \
to the limit of the
[microgravity control plan](../docs/how-to/simulate.md#what-the-station-feels); the largest of \
all walks is {largest:.2f}.

{table(head, cells)}
![Force and torque of the walk of Case 3 on the module, and the spectrum](station_load.png)
"""


def picture(data: dict[str, Any], path: Path) -> None:
    """Draw the load of Case 3."""
    graph, plan = case_3()
    load = station_load(execute(graph, plan).recording)
    load_figure(
        load, path, f"Case 3 as fast as the limits allow, station of {STATION_MASS:,.0f} kg"
    )


if __name__ == "__main__":
    experiment("station_load", __doc__, measured, markdown, picture, tasks=10, workers=CORES)
