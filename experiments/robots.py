"""Measure the robots that ship as files: stances, time of the first and of a later plan, a walk.

    python experiments/robots.py [--out results]

Each robot of two limbs plans a walk of `WALKS` with the step cost, collisions checked, in a process
of its own, once to compile and once to measure: "first" contains the stance graph and every step
that the search had to check, "later" is the way back. Times are processor time, which other
programs on the machine do not lengthen. The walk is then executed in MuJoCo. Writes `robots.json`,
whose table `readme.py` shows in the docs, and `robots.png`, the robots in the first stance.
"""

from __future__ import annotations

import os
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from reports import ROOT, by_level, experiment, study_rows, table

from mlivr_gym import Settings, robot_spec, stance_graph
from mlivr_gym.pictures import Camera, SceneRenderer, save_image, with_caption
from mlivr_gym.planners import Planner
from mlivr_gym.robot import ROBOTS
from mlivr_gym.robot.limb_dynamics import arm_of
from mlivr_gym.simulation import Setup, execute


class Walk(NamedTuple):
    """A walk in a place."""

    start: tuple[str, str] = ("D2a:3", "D2b:4")
    """Stance at the start."""
    goal: tuple[str, str] = ("D4a:0", "D4b:1")
    """Stance at whose base position the goal is; by default two racks to port."""
    place: str = "jem"
    """Map."""
    clearance: float = 0.02
    """Distance that shapes keep [m]."""
    tolerance: float = 0.2
    """Radius of the goal [m]."""
    setup: str | None = None
    """Name of limits, controller and physics of the simulation."""


WALKS = {name: Walk() for name in ROBOTS if name.startswith("mlivr2")} | {
    "ssrms2": Walk(
        ("forward:1", "forward:3"), ("forward:8", "forward:10"), "truss", 0.1, 2.0, "station"
    )
}
"""Walks of the robots of two limbs by name; arms of a station do not fit into the module."""

CACHE = ROOT / "runs" / "robots"
"""Cache folder of the processes, without tables."""

SIZE = (420, 400)
"""Width and height of the picture of one robot [px]."""


def measured(task: int, name: str) -> dict[str, Any]:
    """Return what is measured of a robot."""
    robot, walk, began = robot_spec(name), WALKS[name], time.process_time()
    graph = stance_graph(walk.place, robot, Settings(clearance=walk.clearance))
    planner = Planner(graph)
    start, goal = (
        graph.configuration(graph.state(ids))[0].tolist() for ids in (walk.start, walk.goal)
    )
    within = {"goal_tolerance": walk.tolerance}
    plan = planner.plan(walk.start, goal, "steps", **within).unwrap()
    first = time.process_time()
    planner.plan(plan.stances[-1], start, "steps", **within).unwrap()
    later = time.process_time()
    setup = Setup.of(walk.setup, walk.setup, walk.setup)
    simulation = setup.simulation(graph.grasp_map, robot)
    execution = execute(graph, plan, setup.timing, simulation=simulation)
    arms = [robot.dynamics_of(limb) for limb in range(robot.limbs)]
    masses = (arm.base_mass + sum(arm.masses) + robot.gripper_mass for arm in arms)
    return {
        "limbs": robot.limbs,
        "arms": [
            arm_of(limb) or ("SSRMS" if limb.locked_joint == 1 else "iiwa 14")
            for limb in robot.every_limb
        ],
        "mass_kg": robot.body_mass + sum(masses),
        "stances": len(graph),
        "first_plan_s": first - began,
        "later_plan_s": later - first,
        "steps": len(plan.steps),
        "walked": execution.failure is None,
        "walk_s": execution.simulated_time,
        "source": robot.source,
    }


def all_measured() -> dict[str, Any]:
    """Return what is measured of each robot the second time, in a process of its own."""
    for file in CACHE.glob("*.npz"):
        file.unlink()
    os.environ["MLIVR_GYM_CACHE"] = str(CACHE)
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as processes:
        rows = study_rows("robots:measured", 2, processes, name=[*WALKS])
    return by_level([row for row in rows if row["task"]], "name")


def markdown(data: dict[str, Any]) -> str:
    """Return the table for the page on robots."""
    head = (
        "robot | limbs | place | mass [kg] | stances | first plan [s] | later plan [s] | "
        "steps of the walk | duration of the walk [s] | figures"
    )
    rows = [
        (
            f"`{name}`", ", ".join(dict.fromkeys(row["arms"])), WALKS[name].place,
            f"{row['mass_kg']:.1f}",
            f"{row['stances']:,}", f"{row['first_plan_s']:.1f}", f"{row['later_plan_s']:.2f}",
            row["steps"], f"{row['walk_s']:.0f}" if row["walked"] else "fails",
            row["source"] or "see `envs_assets/ur5e.json`",
        )
        for name, row in data.items()
    ]  # fmt: skip
    return table(head, rows)


def picture(data: dict[str, Any], path: Path) -> None:
    """Draw the robots that walk in the module in the first stance, with their names."""
    shots = []
    for name in (name for name in data if WALKS[name].place == "jem"):
        graph = stance_graph(robot=name)
        shown = graph.configuration(graph.state(WALKS[name].start))
        x, y, z = shown[0].tolist()
        camera = Camera((x, y, z - 0.2), distance=2.7, azimuth=70.0, elevation=-15.0)
        renderer = SceneRenderer(graph.grasp_map, graph.robot, *SIZE)
        shots.append(with_caption(renderer.render(*shown, camera=camera), name, SIZE[1]))
        renderer.close()
    save_image(np.hstack(shots), path)


if __name__ == "__main__":
    experiment("robots", __doc__, all_measured, draw=picture)
