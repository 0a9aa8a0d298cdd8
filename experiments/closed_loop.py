"""Walks through a module with unknown things, with cameras and without, against full knowledge.

    python experiments/closed_loop.py [--tasks 20] [--out results]

Each task has a random start and goal, five unknown boxes in the cabin and ten points that are
covered by unknown plates. The robot walks with and without its cameras, undisturbed and with all
disturbances, and while a crew member crosses the cabin between start and goal. *In hindsight* is
the plan of a robot that knows everything. Writes `closed_loop.json`, `closed_loop.md`, and a
picture of one walk round a wall, `closed_loop.png` and `.svg`.
"""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from reports import CORES, NOTHING, experiment, study_rows, table, two_limb_graph

from mlivr_gym import Box, State
from mlivr_gym.arrays import Array
from mlivr_gym.cli.main import main as command
from mlivr_gym.closed_loop.crew import LEAST_DISTANCE, CrewMember
from mlivr_gym.closed_loop.depth_camera import DepthCamera
from mlivr_gym.closed_loop.loop import run_closed_loop
from mlivr_gym.closed_loop.record import ARRIVED, FAILED, STOPPED
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import ShapeError, StanceError
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

TOLERANCE = 0.2
"""Radius of the goal region [m]."""

BOXES, PLATES = 5, 10
"""Number of unknown boxes, and of points covered by unknown plates."""

CREW = "cameras, a crew member crosses"
"""The series in which a crew member crosses the cabin."""

MODES = {
    "blind, undisturbed": (None, Setup()),
    "cameras, undisturbed": (DepthCamera(), Setup()),
    CREW: (DepthCamera(), Setup()),
    "cameras, all disturbances": (DepthCamera(), Setup.of(disturbances="all")),
    "cameras, all disturbances, gentle pace": (
        DepthCamera(),
        Setup.of("gentle", disturbances="all"),
    ),
}
"""Camera and setup of each series."""


class Task(NamedTuple):
    """A start, a goal, and what the robot does not know."""

    start: tuple[str, ...]
    goal: Array
    unknown: tuple[Box, ...]
    in_hindsight: int | None
    """Fewest steps of a robot that knows everything; None if it cannot reach the goal."""


def unknown_things(graph: TwoLimbGraph, start: State, rng: np.random.Generator) -> tuple[Box, ...]:
    """Return unknown boxes and plates that do not touch the robot at the start."""
    grasp_map, found = graph.grasp_map, list[Box]()
    low, high = grasp_map.positions.min(axis=0), grasp_map.positions.max(axis=0)
    points = rng.permutation([k for k in range(len(grasp_map)) if k not in start.stance]).tolist()
    while len(found) < BOXES + PLATES:
        name = f"thing{len(found)}"
        if len(found) < BOXES:
            half = rng.uniform(0.08, 0.25, 3)
            middle = rng.uniform(low + half, high - half)
        else:
            point = points.pop()
            normal = grasp_map.normals[point]
            half = 0.06 - 0.04 * np.abs(normal)
            middle = grasp_map.positions[point] + 0.02 * normal
        box = Box.between(name, "obstacle", middle - half, middle + half)
        graph.add_obstacles([box])
        try:
            if graph.state(start.stance) == start:  # it touches the robot on none of its branches
                found.append(box)
        except StanceError:
            pass
        graph.remove_obstacles()
    return tuple(found)


def crossing(graph: TwoLimbGraph, task: Task, seed: int) -> CrewMember:
    """Return a crew member who crosses the cabin from one side to the other, or lengthwise."""
    rng = np.random.default_rng([2027, seed])
    start = graph.posture_of(graph.state(task.start)).base_position[0]
    middle = 0.5 * (start + task.goal) + rng.uniform(-0.3, 0.3, 3)
    away = np.zeros(3)
    away[int(rng.integers(2))] = rng.choice([-1.0, 1.0]) * 5.0
    line = (tuple((middle + sign * away).tolist()) for sign in (-1.0, 1.0))
    return CrewMember(*line, begin=float(rng.uniform(0.0, 10.0)))


@cache
def drawn(seed: int) -> Task:
    """Return a task whose goal can be reached without the unknown things."""
    graph, rng = two_limb_graph(), np.random.default_rng([2026, seed])
    task = sample_task(graph, rng, TOLERANCE)
    unknown = unknown_things(graph, task.start, rng)
    graph.add_obstacles(unknown)
    plan = Planner(graph).plan(task.start.stance, task.goal, "steps").plan
    steps = None if plan is None else len(plan.steps)
    return Task(graph.ids(task.start.stance), task.goal, unknown, steps)


def walk(task: int, mode: str) -> dict[str, Any]:
    """Walk a task in one mode."""
    (camera, setup), given, graph = MODES[mode], drawn(task), two_limb_graph()
    crew = [crossing(graph, given, task)] if mode == CREW else []
    row: dict[str, Any] = {"in_hindsight": given.in_hindsight}
    try:
        record = run_closed_loop(
            graph, given.start, given.goal.tolist(), unknown=given.unknown, camera=camera,
            setup=setup, seed=task, max_steps=60, crew=crew,
        )  # fmt: skip
    except ShapeError:
        return row | {"outcome": None}
    return row | {
        "outcome": record.outcome,
        "failure": record.reason.split(":")[0] if record.outcome == FAILED else "",
        "steps": record.steps, "duration": record.duration,
        "peak_force": record.peak_force, "crew_distance": record.crew_distance,
    }  # fmt: skip


COLUMNS = (
    "outcome", "failure", "steps", "in_hindsight", "duration", "peak_force", "crew_distance"
)  # fmt: skip


def measured(tasks: int, workers: int) -> dict[str, Any]:
    """Return all walks by mode."""
    rows = study_rows("closed_loop:walk", tasks, workers, mode=list(MODES))
    modes = {
        mode: {
            "walks": [
                {name: row[name] for name in COLUMNS}
                for row in rows
                if row["mode"] == mode and row["outcome"] is not None
            ]
        }
        for mode in MODES
    }
    impossible = sum(row["in_hindsight"] is None for row in rows[:tasks])
    return {"tasks": tasks, "impossible": impossible, "modes": modes}


def row_of(mode: str, walks: list[dict[str, Any]]) -> list[str]:
    """Return the table row of a mode."""
    outcomes = Counter(walked["outcome"] for walked in walks)
    failures = Counter(walked["failure"] for walked in walks if walked["outcome"] == FAILED)
    both = [w for w in walks if w["outcome"] == ARRIVED and w["in_hindsight"]]
    more = sum(w["steps"] for w in both) / max(sum(w["in_hindsight"] for w in both), 1)
    forces = [w["peak_force"] for w in walks]
    gaps = [w["crew_distance"] for w in walks if w["crew_distance"] is not None]
    in_vain = sum(w["outcome"] == STOPPED and w["in_hindsight"] is None for w in walks)
    return [
        mode, str(len(walks)), str(outcomes[ARRIVED]), f"{outcomes[STOPPED]} ({in_vain})",
        ", ".join(f"{kind} {count}" for kind, count in failures.items()) or "0",
        f"{more:.2f}", f"{max(forces):.0f}",
        f"{min(gaps):.2f} ({sum(gap < LEAST_DISTANCE for gap in gaps)})" if gaps else NOTHING,
    ]  # fmt: skip


HEAD = (
    "mode | tasks | arrived | stopped (no plan exists) | failed | steps over those in hindsight | "
    f"largest grasp force [N] | least distance from crew [m] (walks below {LEAST_DISTANCE:g} m)"
)


def sentence(data: dict[str, Any]) -> str:
    """Return what the walks with all disturbances show, in one sentence for the docs."""
    blind, *_, last = ([w["outcome"] for w in mode["walks"]] for mode in data["modes"].values())
    return (
        f"Of {len(last)} walks among unknown boxes and plates, with all disturbances at the gentle "
        f"pace, {last.count(ARRIVED)} arrive, {last.count(STOPPED)} stop on all points and "
        f"{last.count(FAILED)} fail; of {len(blind)} blind and undisturbed ones "
        f"{blind.count(FAILED)} collide.\n"
    )


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    rows = [row_of(mode, found["walks"]) for mode, found in data["modes"].items()]
    return f"""# Walks through a partly unknown module

Made by `experiments/closed_loop.py`: two limbs on the JEM, random starts and goals, {BOXES} \
unknown boxes and {PLATES} points under unknown plates in each task. In {data["impossible"]} of \
{data["tasks"]} tasks no plan exists even for a robot that knows everything. A robot that stopped \
holds all its points and has no plan among what it has sensed. Crew members cross the cabin at \
0.5 m/s across or along it, and do not evade the robot; where it cannot make way in time, they \
touch it.

{table(HEAD, rows)}"""


def draw_walk(data: dict[str, Any], path: Path) -> None:
    """Draw a walk round a wall that the robot does not know, by the command."""
    wall = ["3.2", "-1.0", "-1.0", "3.5", "1.0", "0.3"]
    if command(["walk", "--unknown", *wall, "--picture", str(path), "--quiet"]) != 0:
        raise SystemExit("the walk of the picture did not arrive")


if __name__ == "__main__":
    experiment("closed_loop", __doc__, measured, markdown, draw_walk, tasks=20, workers=CORES)
