"""Walks through a module with unknown things and all errors at once, against full knowledge.

    python experiments/closed_loop.py [--tasks 200] [--workers 2] [--out results]

Each task has a random start and goal, five unknown boxes in the cabin and ten points that are
covered by unknown plates. Robots of two, three and four limbs walk with their cameras, and in open
loop, with their own controller and with the paper's. *In hindsight* is the plan of a robot that
knows everything. Writes `closed_loop.json`, `closed_loop.md`, and a picture of one walk round a
wall, `closed_loop.png` and `.svg`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from reports import CORES, NOTHING, experiment, figures_of, study_rows, table

from mlivr_gym import Box, State, stance_graph
from mlivr_gym.arrays import Array
from mlivr_gym.cli.main import main as command
from mlivr_gym.envs import sample_task
from mlivr_gym.errors import ShapeError
from mlivr_gym.extensions.closed_loop import (
    ARRIVED,
    BOXES,
    EFFORT,
    PLATES,
    STOPPED,
    DepthCamera,
    run_closed_loop,
    unknown_things,
)
from mlivr_gym.extensions.closed_loop.record import FAILED
from mlivr_gym.motion import Durations
from mlivr_gym.planners import PROVED_IMPOSSIBLE, Planner, SearchOptions
from mlivr_gym.robot import robot_spec
from mlivr_gym.simulation import Setup, execute
from mlivr_gym.simulation.disturbances import ALL
from mlivr_gym.simulation.parameters import PAPER
from mlivr_gym.stances import StanceGraph

TOLERANCE = 0.2
"""Radius of the goal region [m]."""

ERRORS = replace(ALL, delay=0.01, refusal=0.02)
"""All errors at once: those of `ALL` with a delay of 10 ms, and 2 % of the grasps refused."""


class Mode(NamedTuple):
    """How a series of walks is carried out."""

    robot: str
    """Name of the robot."""
    loop: str
    """`"cameras"`, `"blind"`, or `"open"` for the first plan, carried out without replanning."""
    setup: Setup
    """Limits, controller, physics and disturbances."""


CAREFUL = Setup.of("careful", "delayed", disturbances=ERRORS)
SLOW = Setup(Durations(), PAPER, disturbances=ERRORS)
"""Setups of the robot's own controller and of the paper's, with all errors."""

AIM = 40.0
"""Time that replanning at a grasp should take at most [ms]."""

ROBOTS = {"two": "mlivr2", "three": "mlivr3", "four": "mlivr4"}
"""The robots by their number of limbs."""

MODES = {
    "two limbs, cameras, no errors": Mode("mlivr2", "cameras", Setup()),
    "two limbs, blind, no errors": Mode("mlivr2", "blind", Setup()),
    "two limbs, paper's controller, cameras, all errors": Mode("mlivr2", "cameras", SLOW),
    **{
        f"{number} limbs, {name}, all errors": Mode(robot, loop, setup)
        for number, robot in ROBOTS.items()
        for name, loop, setup in (
            ("cameras", "cameras", CAREFUL), ("open loop", "open", CAREFUL),
            ("paper's controller, open loop", "open", SLOW),
        )
    },
}  # fmt: skip
"""The series of walks by name."""


class Task(NamedTuple):
    """A start, a goal, and what the robot does not know."""

    start: tuple[str, ...]
    goal: Array
    unknown: tuple[Box, ...]
    in_hindsight: int | None
    """Steps of a robot that knows everything; None if no plan was found for it."""
    is_possible: bool
    """Whether it is not proved that the goal cannot be reached from any branches of the start."""


@cache
def graph_of(robot: str) -> StanceGraph:
    """Return the stance graph of a robot on the JEM."""
    return stance_graph(robot=robot_spec(robot))


def effort_for(graph: StanceGraph) -> int | None:
    """Return the effort of each planning of the closed loop; two limbs need no limit."""
    return EFFORT if graph.limbs > 2 else None


@cache
def drawn(robot: str, seed: int) -> Task:
    """Return a task whose goal can be reached without the unknown things."""
    graph, rng = graph_of(robot), np.random.default_rng([2026, seed])
    task = sample_task(graph, rng, TOLERANCE)
    unknown = unknown_things(graph, task.start, rng)
    graph.add_obstacles(unknown)
    planner = Planner(graph)
    found = planner.plan(
        task.start.stance, task.goal, "steps", options=SearchOptions(effort=effort_for(graph))
    )
    graph.remove_obstacles()
    steps = None if found.plan is None else len(found.plan.steps)
    is_possible = found.reason not in PROVED_IMPOSSIBLE
    return Task(graph.ids(task.start.stance), task.goal, unknown, steps, is_possible)


def walk(task: int, mode: str) -> dict[str, Any]:
    """Walk a task in one mode."""
    robot, loop, setup = MODES[mode]
    graph, given = graph_of(robot), drawn(robot, task)
    row: dict[str, Any] = {"in_hindsight": given.in_hindsight, "is_possible": given.is_possible}
    if loop == "open":
        return row | open_loop(graph, given, setup, task)
    try:
        record = run_closed_loop(
            graph, given.start, given.goal.tolist(), unknown=given.unknown,
            camera=DepthCamera() if loop == "cameras" else None, setup=setup, seed=task,
            max_steps=60,
        )  # fmt: skip
    except ShapeError:
        return row | {"outcome": None}
    return row | {
        "outcome": record.outcome, "proved": record.proved,
        "is_true": record.proved and is_cut_off(graph, given, record.state),
        "failure": record.reason.split(":")[0] if record.outcome == FAILED else "",
        "steps": record.steps, "duration": record.duration,
        "peak_force": record.peak_force,
        "replanning_times": record.replanning_times.tolist(),
    }  # fmt: skip


def is_cut_off(graph: StanceGraph, task: Task, state: State | None) -> bool:
    """Return whether it is proved that the goal cannot be reached from a state."""
    graph.add_obstacles(task.unknown)
    start = task.start if state is None else state
    found = Planner(graph).plan(
        start, task.goal, "steps", options=SearchOptions(effort=effort_for(graph))
    )
    graph.remove_obstacles()
    return found.reason in PROVED_IMPOSSIBLE


def open_loop(graph: StanceGraph, task: Task, setup: Setup, seed: int) -> dict[str, Any]:
    """Carry the first plan of a task out without looking or replanning."""
    found = Planner(graph).plan(
        task.start, task.goal, "steps", options=SearchOptions(effort=effort_for(graph))
    )
    if found.plan is None or not found.plan.steps:
        return {"outcome": None}
    simulation = setup.simulation(graph.grasp_map, graph.robot, task.unknown, seed)
    done = execute(graph, found.plan, setup.timing, simulation=simulation)
    return {
        "outcome": ARRIVED if done.failure is None else FAILED, "proved": False,
        "is_true": False,
        "failure": "" if done.failure is None else done.failure.kind,
        "steps": len(done.captures), "duration": done.simulated_time,
        "peak_force": float(done.peaks.grasp_force.max()),
        "replanning_times": [],
    }  # fmt: skip


def measured(tasks: int, workers: int) -> dict[str, Any]:
    """Return all walks by mode."""
    rows = study_rows("closed_loop:walk", tasks, workers, mode=list(MODES))
    return {"tasks": tasks, "modes": by_mode(rows)}


def by_mode(rows: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Return the walks of each mode, with rounded numbers."""
    walks: dict[str, list[dict[str, Any]]] = {mode: [] for mode in MODES}
    for row in rows:
        if row["outcome"] is not None:
            times = [round(seconds, 4) for seconds in row["replanning_times"]]
            kept = {
                name: round(one, 3) if isinstance(one, float) else one
                for name, one in figures_of(row, "mode").items()
            }
            walks[row["mode"]].append(kept | {"replanning_times": times})
    return walks


def row_of(mode: str, walks: list[dict[str, Any]]) -> list[str]:
    """Return the table row of a mode."""
    outcomes = Counter(walked["outcome"] for walked in walks)
    failures = Counter(walked["failure"] for walked in walks if walked["outcome"] == FAILED)
    stopped = [walked for walked in walks if walked["outcome"] == STOPPED]
    proved = sum(walked["proved"] for walked in stopped)
    true = sum(walked["is_true"] for walked in stopped)
    both = [w for w in walks if w["outcome"] == ARRIVED and w["in_hindsight"]]
    more = [w["steps"] for w in both], [w["in_hindsight"] for w in both]
    forces = [w["peak_force"] for w in walks]
    times = [1e3 * seconds for w in walks for seconds in w["replanning_times"]]
    return [
        mode, str(len(walks)), str(outcomes[ARRIVED]), f"{len(stopped)} ({proved}, {true})",
        ", ".join(f"{kind} {count}" for kind, count in failures.most_common()) or "0",
        f"{sum(more[0]) / sum(more[1]):.2f}" if both else NOTHING,
        f"{max(forces):.0f} ({sum(force > 100.0 for force in forces)})",
        f"{np.mean(times):.0f}, {np.percentile(times, 95):.0f}, {max(times):.0f} "
        f"({sum(one > AIM for one in times)} of {len(times)})"
        if times else NOTHING,
    ]  # fmt: skip


HEAD = (
    "mode | walks | arrived | stopped (with a proof, with a true one) | failed | "
    "steps over those in hindsight | largest grasp force [N] (walks above 100 N) | "
    f"replanning at a grasp: mean, 95 %, maximum [ms] (above {AIM:g} ms)"
)


def sentence(data: dict[str, Any]) -> str:
    """Return what the walks with all errors show, in one sentence for the docs."""
    parts = []
    for number in ROBOTS:
        walks = data["modes"][f"{number} limbs, cameras, all errors"]
        counts = Counter(walked["outcome"] for walked in walks)
        true = sum(walked["is_true"] for walked in walks)
        parts.append(
            f"{counts[ARRIVED]} of {len(walks)} with {number} limbs arrive, {counts[STOPPED]} stop "
            f"on all points, {true} of them with a proof that is true, and {counts[FAILED]} fail"
        )
    blind = [walked["outcome"] for walked in data["modes"]["two limbs, open loop, all errors"]]
    return (
        f"Of walks among unknown boxes and plates with all errors at once, {'; '.join(parts)}. "
        f"Of {len(blind)} plans of two limbs that are carried out without looking, "
        f"{blind.count(FAILED)} fail.\n"
    )


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    modes = data["modes"]
    tasks = {
        robot: modes[f"{number} limbs, cameras, all errors"] for number, robot in ROBOTS.items()
    }
    impossible = ", ".join(
        f"{sum(not walked['is_possible'] for walked in walks)} of {len(walks)} for `{robot}`"
        for robot, walks in tasks.items()
    )
    turn, angle = np.rad2deg([ERRORS.encoder_bias, ERRORS.point_angle]).tolist()
    delay, refused, off = 1e3 * ERRORS.delay, 100.0 * ERRORS.refusal, 1e3 * ERRORS.point_position
    text = f"""# Walks through a partly unknown module

Made by `experiments/closed_loop.py`: random starts and goals on the JEM, {BOXES} unknown boxes and
{PLATES} points under unknown plates in each task. It is proved that no plan exists, even for a
robot that knows everything, in {impossible}.

*All errors*: masses {100.0 * ERRORS.masses:g} % off, joint friction to {ERRORS.friction:g} N m,
encoders {turn:g} degrees off, points {off:g} mm and {angle:g} degrees off, grasps up to
{ERRORS.stiffness:g} times as stiff or as soft, {ERRORS.acceleration:g} g, {delay:g} ms of delay,
{refused:g} % of the grasps refused, and the others of `DisturbanceRanges`. The robot's own
controller is `delayed` at the careful pace with errors, `full` at the fast one without; the paper's
takes 50 s a step. At a grasp a robot with cameras goes on with what remains of its plan if that is
still possible, and searches where it is not. Planning times are those of one walk on each core.
*Open loop* is the first plan, carried out without looking. A robot that stopped holds all its
points; its proof is about what it has sensed, and true if no plan exists from there in the whole
module either.

{table(HEAD, (row_of(mode, walks) for mode, walks in modes.items()))}"""
    return "\n".join([text, *data.get("remarks", [])]).strip() + "\n"


def draw_walk(data: dict[str, Any], path: Path) -> None:
    """Draw a walk round a wall that the robot does not know, by the command."""
    wall = ["3.2", "-1.0", "-1.0", "3.5", "1.0", "0.3"]
    if command(["walk", "--unknown", *wall, "--picture", str(path), "--quiet"]) != 0:
        raise SystemExit("the walk of the picture did not arrive")


if __name__ == "__main__":
    experiment(
        "closed_loop", __doc__, measured, markdown, draw_walk, None, tasks=200, workers=CORES
    )  # fmt: skip
