"""Run planners that others wrote on the benchmark's tasks: networkx, rustworkx, and OMPL.

    python experiments/peers.py [--out results] [--tasks 50] [--seconds 10]

Walks: the searches of `graph_libraries` on the held-out tasks. Steps: on each task's optimal walk a
step that the package accepts and one that it refuses, for RRTConnect of OMPL (`pip install ompl`).
Times are processor times. Writes `peers.json` and `peers.md` in a quarter of an hour.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np
from benchmark_planning import LIBRARY_HEAD, Task, libraries, library_rows, machine
from coal_ruler import Ruler
from ompl_steps import COARSE, FINE, connect, some_steps
from reports import NOTHING, experiment, spread, table
from tqdm import tqdm

from mlivr_gym.stances import StanceGraph

ENVIRONMENTS = ("MLIVR-JEM-v0", "MLIVR-JEM-Far-v0")
"""Environments of the tasks; steps are those of the last."""


def held_out(name: str, count: int) -> tuple[StanceGraph, list[Task]]:
    """Return the graph of an environment and the first tasks of its report."""
    env, tasks = gymnasium.make(f"mlivr_gym:{name}").unwrapped, list[Task]()
    for k in range(count):
        env.reset(options={"task": k})
        tasks.append((env.state, env.goal.copy()))
    return env.graph, tasks


def measured(tasks: int, seconds: float) -> dict[str, Any]:
    """Measure walks and steps."""
    from ompl import util

    util.RNG.setSeed(1)
    util.setLogLevel(util.LOG_WARN)
    data: dict[str, Any] = {"machine": machine(), "tasks": tasks, "seconds": seconds, "steps": []}
    data["machine"]["packages"]["ompl"] = version("ompl")
    (graph, every), rng = held_out(ENVIRONMENTS[-1], tasks), np.random.default_rng(1)
    ruler = Ruler(graph.robot, graph.grasp_map.boxes)
    list(some_steps(graph, every[0], rng))  # compiles, or loads, all kernels
    with patch("time.perf_counter", time.process_time):
        for task in tqdm(every, desc="steps", disable=None):
            for ends, figures in some_steps(graph, task, rng):
                data["steps"].append(figures | connect(graph, ruler, ends, seconds))
        data["walks"] = {name: libraries(*held_out(name, tasks), "steps") for name in ENVIRONMENTS}
    return data


def step_rows(rows: list[dict[str, Any]]) -> Iterator[list[Any]]:
    """Yield the table rows of accepted and of refused steps."""
    for accepted, words in ((True, "accepted"), (False, "refused")):
        some = [row for row in rows if row["accepted"] is accepted and row["ends"]]
        solved, figures = [row for row in some if row["solved"]], list[str]()
        for what, among in (("check", some), ("plan", some), ("seconds", solved)):
            times = spread([row[what] for row in among if what in row] or [np.nan])
            figures.append(f"{times['median']:.3g}, {times['p95']:.3g}")
        figures[1] = figures[1] if accepted else NOTHING
        medians = [np.median([row[what] for row in solved]) for what in ("checks", "length")]
        clear = sum(row["clear"] for row in solved)
        yield [
            words, len(some), *figures, len(solved), clear,
            f"{medians[0]:.0f}", f"{medians[1]:.1f}",
        ]  # fmt: skip


WALK_HEAD = LIBRARY_HEAD.replace(" | memory [MB]", "")
STEP_HEAD = "steps | number | our check | our plan | RRTConnect | solved | clear | checks | [rad]"
"""Heads of the tables."""


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    host, walks = data["machine"], ""
    for name, found in data["walks"].items():
        rows = ([*row[:5], row[6]] for row in library_rows({"libraries": found}))
        searches = ", ".join(f"{one['search']:.1f}" for one in found["this planner"].values())
        walks += f"\n{table(f'{name}, {WALK_HEAD}', rows)}\nIts searches alone: {searches} ms.\n"
    return f"""# Peers

Planners that others wrote, on {data["tasks"]} held-out tasks of each environment of the \
[benchmark](../docs/benchmark.md), on one core: {host["processor"]}, Python {host["python"]}, \
{", ".join(map(" ".join, host["packages"].items()))}. Times are processor times in ms, median and \
95th percentile. Made by `experiments/peers.py`.

## Walks

The fewest steps. In the graph libraries nodes are the stances, edges the valid steps, the goal a
virtual node joined to every goal stance; building is not in their times. Their A* has the
consistent heuristic. Branches are left out, which would multiply states and
steps: a path may cost less than any executable walk (*lower*). The times of this
planner are those of the whole call, with the motion of all joints.
{walks}
## Single steps

On the optimal walk of each task of `{ENVIRONMENTS[-1]}`, a step that this package accepts and one
that it refuses, both between stances that can be held, by a limb that can be released from both
points. RRTConnect plans in all 12 joints from above one point to above the other, on one branch of
each limb: the support's gripper stays, and the robot keeps clearance and manipulability, which coal
and NumPy measure at every {COARSE} rad. Limit {data["seconds"]:g} s, default range, seed 1, no
simplification. *Clear* paths pass a check at every {FINE} rad; the last columns are medians.

The package checks in compiled code, for the whole continuous motion, whether the base can move on a
line and the limb in one of a few swings; *our plan* is the joint path of that motion. It refuses
steps for which other motions exist: the problems differ. OMPL spends most of its time in checks
called from Python.

{table(STEP_HEAD, step_rows(data["steps"]))}"""


if __name__ == "__main__":
    experiment("peers", __doc__, measured, markdown, tasks=50, seconds=10.0)
