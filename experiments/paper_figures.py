"""What the paper's figures show, measured here: torques by phase, and planned against actual paths.

    python experiments/paper_figures.py [--out results] [--plans 20]

Every step of Case 3 and of random plans is carried out by itself, from rest in its stance: with the
swing of the plan, on lines in joint space that were checked, and with one in task space as the
paper writes (`task_space_swing`); with the paper's controller and with feedforward; and with other
arrivals (`arrivals`). Writes `paper_figures.json`, the page, and the pictures of both figures.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from arrivals import Arrival, Measured, executed
from dynamic_simulation import drawn_plans
from paper_figures_report import SWINGS, markdown
from paper_pictures import WalkPaths, paths_figure, torque_figure
from task_space_swing import Attempt, attempts, best

from mlivr_gym.arrays import Array
from mlivr_gym.files import write_whole
from mlivr_gym.motion.clocks import Durations
from mlivr_gym.motion.regrasp import RegraspPath, planned_regrasp
from mlivr_gym.paper import CASES, case_graph, default_setup
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.simulation.controller import FEEDFORWARD, PAPER
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.execution import Execution, execute
from mlivr_gym.simulation.instruments import RECORD_PERIOD
from mlivr_gym.simulation.phase_torques import CAPTURE, largest, phase_torques
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.simulation.timing import plan_trajectory
from mlivr_gym.stances.stance_graph import StanceGraph

JOINT, TASK = SWINGS
PD, FED = Setup(Durations(), PAPER), Setup(Durations(), FEEDFORWARD)
STIFF = replace(
    FED,
    physics=Physics(
        grasp_stiffness=10.0 * FED.physics.grasp_stiffness,
        grasp_damping=10.0**0.5 * FED.physics.grasp_damping,
        grasp_rotational_stiffness=10.0 * FED.physics.grasp_rotational_stiffness,
        grasp_rotational_damping=10.0**0.5 * FED.physics.grasp_rotational_damping,
    ),
)
"""Grasps ten times as stiff, as near to critical damping as before."""

CONTROLLERS = {"PD": Arrival(PD), "PD and feedforward": Arrival(FED)}
"""The paper's controller, and the same with the torques of the dynamics fed forward."""

CAUSES = {
    "PD": Arrival(PD),
    "PD, 5 mm beside the point": Arrival(PD, offset=0.005),
    "PD, constant speed": Arrival(PD, constant_speed=True),
    "PD, no reference of velocity": Arrival(PD, velocity_reference=False),
    "feedforward": Arrival(FED),
    "feedforward, 1 mm beside the point": Arrival(FED, offset=0.001),
    "feedforward, 2 mm beside the point": Arrival(FED, offset=0.002),
    "feedforward, 5 mm beside the point": Arrival(FED, offset=0.005),
    "feedforward, 9 mm beside the point": Arrival(FED, offset=0.009),
    "feedforward, 1 mm, grasp ten times as stiff": Arrival(STIFF, offset=0.001),
}
"""What may make torques at the capture, with the swings of the plans."""

IN_TASK_SPACE = {
    f"{TASK}, {name}": CAUSES[name] for name in ("PD, 5 mm beside the point", "PD, constant speed")
}
"""The same with swings in task space."""


class PlannedStep(NamedTuple):
    """A step of a plan, with both swings."""

    plan: int
    """Index of the plan; 0 is Case 3."""
    step: int
    """Index of the step."""
    swing: str
    """Kind of the plan's swing."""
    path: RegraspPath
    """The step as planned."""
    found: list[Attempt]
    """Its swings in task space."""
    task: Attempt
    """The best of them."""


def planned_steps(graph: StanceGraph, plans: Sequence[Plan]) -> list[PlannedStep]:
    """Every step of some plans."""
    steps = []
    for number, plan in enumerate(plans):
        for k, step in enumerate(plan.steps):
            regrasp = planned_regrasp(graph, plan, k)
            found = attempts(graph, regrasp)
            chosen = best(found, regrasp.branches[regrasp.limb])
            path = RegraspPath(graph, regrasp)
            steps.append(PlannedStep(number, k, step.swing, path, found, chosen))
    return steps


def swings_told(step: PlannedStep) -> dict[str, Any]:
    """What comes of the swings in task space of a step, as plain data."""
    regrasp = step.path.regrasp
    branch, after = regrasp.branches[regrasp.limb], regrasp.branches[step.path.graph.limbs]
    here = [attempt for attempt in step.found if attempt.branch == branch]
    return {
        "planned_branch": best(here, branch).outcome,
        "any_branch": step.task.outcome,
        "attempts": dict(Counter(attempt.outcome for attempt in step.found)),
        "same_branch_after": branch == after,
        "taken": {
            "branch": step.task.branch,
            "as_planned": step.task.branch == branch,
            "turn_deg": float(np.rad2deg(step.task.turn)),
        },
    }


def compared(
    steps: Sequence[PlannedStep], simulations: dict[Setup, Simulation]
) -> tuple[list[dict[str, Any]], dict[tuple[str, str], list[Measured]]]:
    """Each step with both swings and controllers, and what was measured in Case 3."""
    rows = []
    measured: dict[tuple[str, str], list[Measured]] = {}
    for step in steps:
        runs: dict[str, Any] = {}
        for swing, path in ((JOINT, step.path), (TASK, step.task.path)):
            for name, arrival in CONTROLLERS.items():
                if path is None:
                    continue
                done = executed(path, arrival, simulations[arrival.setup])
                runs.setdefault(swing, {})[name] = done.figures()
                if step.plan == 0:
                    measured.setdefault((swing, name), []).append(done)
        told = {"plan": step.plan, "step": step.step, "swing": step.swing}
        rows.append({**told, "task_space": swings_told(step), "runs": runs})
        print(f"plan {step.plan}, step {step.step + 1}: {step.task.outcome}", flush=True)
    return rows, measured


def causes(
    steps: Sequence[PlannedStep], simulations: dict[Setup, Simulation]
) -> dict[str, list[dict[str, Any]]]:
    """Torques at the capture and in the swing of each step, arriving in several ways."""
    data: dict[str, list[dict[str, Any]]] = {}
    for name, arrival in (CAUSES | IN_TASK_SPACE).items():
        data[name] = []
        for step in steps:
            path = step.task.path if name in IN_TASK_SPACE else step.path
            if path is None:
                continue
            done = executed(path, arrival, simulations[arrival.setup]).figures()
            row = {"largest_in": done["largest_in"], "failure": done["failure"]}
            row |= {part: found["peak_N_m"] for part, found in done["parts"].items()}
            row["capture_distance_mm"] = done["capture_distance_mm"]
            data[name].append(row)
        caught = [row for row in data[name] if CAPTURE in row]
        first = sum(row["largest_in"] == CAPTURE for row in caught)
        print(f"{name}: largest at {first} of {len(caught)} captures", flush=True)
    return data


def grippers(simulation: Simulation, poses: tuple[Array, ...]) -> Array:
    """Grasp points of all limbs at k configurations, shape (k, N, 3) [m]."""
    model, data = simulation.model, mujoco.MjData(simulation.model)
    limbs, first = simulation.robot.limbs, int(model.joint("base").qposadr[0])
    joints = [
        int(model.joint(f"limb{i}/joint{k}").qposadr[0]) for i in range(limbs) for k in range(1, 7)
    ]
    out = np.empty((len(poses[0]), limbs, 3))
    for k, (position, quaternion, angles) in enumerate(zip(*poses, strict=True)):
        data.qpos[first : first + 3], data.qpos[first + 3 : first + 7] = position, quaternion
        data.qpos[joints] = angles.ravel()
        mujoco.mj_kinematics(model, data)
        out[k] = [data.site(f"limb{i}/grasp").xpos for i in range(limbs)]
    return out


def walked(graph: StanceGraph, plan: Plan, simulation: Simulation) -> tuple[Execution, WalkPaths]:
    """Case 3 as one walk, and where base and grippers were planned and are."""
    execution = execute(graph, plan, Durations(), simulation=simulation)
    planned = plan_trajectory(graph, plan, Durations(), period=RECORD_PERIOD)
    there = execution.recording
    count = min(len(planned.times), len(there.times))
    poses = [
        (
            found.base_positions[:count],
            found.base_quaternions[:count],
            found.joint_positions[:count],
        )
        for found in (planned, there)
    ]
    paths = WalkPaths(
        planned.times[:count],
        *(np.concatenate([pose[0][:, None], grippers(simulation, pose)], axis=1)
          for pose in poses),
    )  # fmt: skip
    return execution, paths


def walk_told(execution: Execution, paths: WalkPaths) -> dict[str, Any]:
    """A walk as plain data: torques by phase, deviations by step and over all."""
    torques = phase_torques(execution.recording, execution.captures)
    steps = sorted({entry.step for entry in torques})
    off = 1e3 * paths.deviations
    per_step = round(Durations().total / RECORD_PERIOD)
    return {
        "failure": None if execution.failure is None else execution.failure.message,
        "largest_in": [largest(torques, step).part for step in steps],
        "peaks_N_m": [
            {entry.part: entry.peak for entry in torques if entry.step == step} for step in steps
        ],
        "deviation_mm": {
            name: {"peak": float(off[:, n].max()), "mean": float(off[:, n].mean())}
            for n, name in enumerate(paths.names)
        },
        "deviation_by_step_mm": [
            off[k * per_step : (k + 1) * per_step].max(axis=0).tolist() for k in steps
        ],
        "capture_distance_mm": [1e3 * capture.distance for capture in execution.captures],
    }


def rounded(data: Any) -> Any:
    """Plain data with numbers of six digits."""
    if isinstance(data, dict):
        return {name: rounded(value) for name, value in data.items()}
    if isinstance(data, list):
        return [rounded(value) for value in data]
    return float(f"{data:.6g}") if isinstance(data, float) else data


def main() -> None:
    """Measure everything and write data, page and pictures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("results"))
    parser.add_argument("--plans", type=int, default=20, help="random plans besides Case 3")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    case_setup = default_setup()
    graph = case_graph(3, case_setup, "collisions")
    case = Planner(graph).plan(
        case_setup["start"], case_setup["goal"], CASES[3].cost, goal_face=case_setup["goal_face"]
    )
    plans = [case.unwrap(), *drawn_plans(graph, args.plans)]
    walks, both = {}, {}
    for name, arrival in CONTROLLERS.items():
        simulation = arrival.setup.simulation(graph.grasp_map, graph.robot)
        execution, paths = walked(graph, plans[0], simulation)
        walks[name], both[name] = walk_told(execution, paths), (execution, paths)
    paths_figure(graph.grasp_map, both, args.out / "paper_paths.png")
    simulations = {
        setup: setup.simulation(graph.grasp_map, graph.robot) for setup in (PD, FED, STIFF)
    }
    steps = planned_steps(graph, plans)
    rows, measured = compared(steps, simulations)
    torque_figure(measured, args.out / "paper_torques.png")
    made = causes(steps, simulations)
    data = rounded({"plans": len(plans), "steps": rows, "walks": walks, "causes": made})
    write_whole(args.out / "paper_figures.json", json.dumps(data, indent=1) + "\n")
    write_whole(args.out / "paper_figures.md", markdown(data))


if __name__ == "__main__":
    main()
