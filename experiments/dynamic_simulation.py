"""Executes plans in MuJoCo: the paper's walk, faster walks, random plans, time step and speed.

Usage: python experiments/dynamic_simulation.py [--out results] [--plans 50]
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.integrate import cumulative_trapezoid

from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.files import write_whole
from mlivr_gym.simulation.timing import step_trajectory
from mlivr_gym.motion.clocks import Durations
from mlivr_gym.paper import CASES, case_graph, default_setup
from mlivr_gym.pictures.simulation_figure import simulation_figure
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.execution import Execution, execute
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.stance_graph import StanceGraph

CONTROLLERS = {"PD": Physics(feedforward=False), "PD and feedforward": Physics()}
"""The paper's controller, and the same with the torques of the dynamics fed forward."""

DURATIONS = (50.0, 30.0, 20.0, 10.0, 5.0)
TIME_STEPS = (0.004, 0.002, 0.001, 0.0005)
"""Durations of a step [s] and time steps of the simulation [s] that are tried."""

SEED = 20261121
"""Seed of the random plans."""


def figures(execution: Execution) -> dict[str, Any]:
    """What the tables show of a walk."""
    peaks, failure = execution.peaks, execution.failure
    return {
        "success": failure is None,
        "failure": None if failure is None else failure.to_dict(),
        "steps": len(execution.plan.steps),
        "steps_done": len(execution.captures),
        "peak_grasp_force_N": float(peaks.grasp_force.max()),
        "peak_grasp_torque_N_m": float(peaks.grasp_torque.max()),
        "peak_joint_torque_N_m": peaks.joint_torque.max(axis=0).tolist(),
        "peak_torque_rms_N_m": peaks.torque_rms,
        "mean_torque_rms_N_m": float(execution.recording.torque_rms.mean()),
        "largest_base_error_mm": 1e3 * peaks.base_error,
        "largest_base_angle_error_deg": float(np.rad2deg(peaks.base_angle_error)),
        "largest_capture_distance_mm": max(
            (1e3 * c.distance for c in execution.captures), default=None
        ),
        "simulation_time_s": execution.simulation_time + execution.preparation_time,
    }


def walks(graph: Any, plan: Plan, out: Path) -> dict[str, Any]:
    """The same walk with each controller at several durations of a step, and at the shortest."""
    data: dict[str, Any] = {}
    for name, physics in CONTROLLERS.items():
        rows = {}
        for duration in DURATIONS:
            execution = execute(graph, plan, Durations.of_step(duration), physics)
            rows[f"{duration:g}"] = figures(execution)
            print(f"{name}, {duration:g} s a step: {tell(execution)}", flush=True)
            if duration == DURATIONS[0]:
                file = (
                    "dynamic_simulation.png"
                    if name == "PD"
                    else "dynamic_simulation_feedforward.png"
                )
                title = f"Case 3, {duration:g} s a step, {name}"
                simulation_figure(
                    execution.recording, execution.captures, execution.failure, out / file, title
                )
        # Bisected to half a second, success taken to grow with the duration.
        low, high = 1.0, DURATIONS[0]
        while high - low > 0.5:
            middle = 0.5 * (low + high)
            if execute(graph, plan, Durations.of_step(middle), physics).failure is None:
                high = middle
            else:
                low = middle
        fastest = execute(graph, plan, Durations.of_step(high), physics)
        below = execute(graph, plan, Durations.of_step(low), physics)
        assert below.failure is not None
        print(
            f"{name}: shortest {high:.2f} s a step; at {low:.2f} s: {below.failure.message}",
            flush=True,
        )
        data[name] = {
            "durations": rows,
            "shortest_s": high,
            "at_shortest": figures(fastest),
            "fails_at_s": low,
            "because": below.failure.to_dict(),
        }
    return data


def tell(execution: Execution) -> str:
    """One line on how a walk went."""
    if execution.failure is None:
        error, seconds = 1e3 * execution.peaks.base_error, execution.simulation_time
        return f"done, base error {error:.1f} mm, {seconds:.1f} s"
    failure = execution.failure
    return f"{failure.kind} in step {failure.step + 1}: {failure.message}"


def drawn_plans(graph: StanceGraph, count: int) -> list[Plan]:
    """Plans between random starts and goals, base cost and step cost by turns."""
    planner, rng = Planner(graph), np.random.default_rng(SEED)
    plans: list[Plan] = []
    while len(plans) < count:
        state, goal = sample_task(graph, rng, 0.2)
        cost = ("base", "steps")[len(plans) % 2]
        result = planner.plan(graph.ids(state.stance), goal.tolist(), cost)
        if result.plan is None:
            print(f"no plan: {result.message}", flush=True)
        elif result.plan.steps:
            plans.append(result.plan)
    return plans


def random_plans(count: int) -> dict[str, Any]:
    """Random plans executed at 50 s a step with each controller."""
    graph = stance_graph()
    plans, data = drawn_plans(graph, count), {}
    for name, physics in CONTROLLERS.items():
        simulation = Simulation(graph.grasp_map, graph.robot, physics)
        rows = [figures(execute(graph, plan, simulation=simulation)) for plan in plans]
        done = [row for row in rows if row["success"]]
        data[name] = {
            "plans": count,
            "steps": sum(row["steps"] for row in rows),
            "succeeded": len(done),
            "largest_base_error_mm": max(row["largest_base_error_mm"] for row in rows),
            "largest_capture_distance_mm": max(row["largest_capture_distance_mm"] for row in done),
            "peak_grasp_force_N": max(row["peak_grasp_force_N"] for row in rows),
            "failures": [
                {"plan": k, **row["failure"]} for k, row in enumerate(rows) if not row["success"]
            ],
        }
        print(f"{name}: {len(done)} of {count} random plans carried out", flush=True)
    return data


def time_steps(graph: Any, plan: Plan) -> dict[str, Any]:
    """The walk at 20 s a step with several time steps."""
    rows = {}
    for step in TIME_STEPS:
        execution = execute(graph, plan, Durations.of_step(20.0), Physics(timestep=step))
        rows[f"{1e3 * step:g} ms"] = {
            **figures(execution),
            "impulse_error": impulse_error(graph, plan, step),
        }
        print(f"time step {1e3 * step:g} ms: {tell(execution)}", flush=True)
    return rows


def impulse_error(graph: Any, plan: Plan, timestep: float) -> float:
    """Largest difference of momentum and impulse of the only grasp in the first step.

    A share of the largest momentum.
    """
    simulation = Simulation(
        graph.grasp_map, plan.world.robot, Physics(timestep=timestep), plan.world.obstacles
    )
    start = (
        plan.motion.base_positions[0],
        plan.motion.base_quaternions[0],
        plan.motion.joint_positions[0],
    )
    simulation.reset(*start, graph.indices(plan.stances[0]))
    trajectory = step_trajectory(graph, plan, 0, Durations.of_step(20.0), timestep)
    recording = simulation.execute(trajectory).recording
    held = 1 - plan.steps[0].limb
    frame = simulation.data.site(f"limb{held}/anchor").xmat.reshape(3, 3)
    impulse = cumulative_trapezoid(
        recording.grasp_forces[:, held] @ frame.T, recording.times, axis=0, initial=0.0
    )
    gained = recording.momenta - recording.momenta[0]
    return float(np.abs(impulse - gained).max() / np.linalg.norm(gained, axis=1).max())


def overhead(graph: Any, plan: Plan, repeats: int = 5) -> dict[str, float]:
    """Processor time of one step, trajectory and measurements included, over that of `mj_step`.

    Both run one after the other.
    """
    simulation, ratios, bare_times = Simulation(graph.grasp_map, plan.world.robot), [], []
    for _ in range(repeats):
        start = (
            plan.motion.base_positions[0],
            plan.motion.base_quaternions[0],
            plan.motion.joint_positions[0],
        )
        simulation.reset(*start, graph.indices(plan.stances[0]))
        count = len(step_trajectory(graph, plan, 0).times) - 1
        begin = time.process_time()
        simulation.execute(step_trajectory(graph, plan, 0))
        used = time.process_time() - begin
        simulation.reset(*start, [-1, *graph.indices(plan.stances[0])[1:]])
        simulation.data.ctrl[simulation.joint_actuators] = plan.motion.joint_positions[0].ravel()
        begin = time.process_time()
        for _ in range(count):
            mujoco.mj_step(simulation.model, simulation.data)
        bare_times.append(time.process_time() - begin)
        ratios.append(used / bare_times[-1])
    return {
        "ratio_median": float(np.median(ratios)),
        "ratio_largest": max(ratios),
        "bare_step_us": 1e6 * float(np.median(bare_times)) / count,
    }


def markdown(data: dict[str, Any]) -> str:
    """The results as tables."""
    return "\n".join(
        [
            *walk_lines(data["walks"]),
            *plan_lines(data["random_plans"]),
            *time_step_lines(data["time_steps"]),
            *speed_lines(data),
        ]
    )


def walk_lines(walks: dict[str, Any]) -> list[str]:
    """The walk of Case 3 with each controller."""
    lines = [
        "# Dynamic simulation",
        "",
        "Made by `experiments/dynamic_simulation.py`. Case 3 of Table I with collisions checked, "
        "zero gravity, PD control with the",
        "paper's gains. *Feedforward* adds what the trajectory needs by the robot's dynamics and "
        "the grasps' stiffness, both known",
        "exactly. Figures are peaks over every time step; a walk that failed is measured up to the "
        "failure.",
        "",
        "| controller | step [s] | outcome | grasp force [N] | grasp torque [N m] "
        "| joint torque [N m] | torque RMS, peak (mean) [N m] | base error [mm] | capture [mm] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, walk in walks.items():
        rows = {**walk["durations"], f"{walk['shortest_s']:.1f} (shortest)": walk["at_shortest"]}
        for duration, row in rows.items():
            failure = row["failure"]
            outcome = (
                "done" if row["success"] else f"{failure['kind']} in step {failure['step'] + 1}"
            )
            captured = "-" if not row["steps_done"] else f"{row['largest_capture_distance_mm']:.2f}"
            lines.append(
                f"| {name} | {duration} | {outcome} | {row['peak_grasp_force_N']:.1f} "
                f"| {row['peak_grasp_torque_N_m']:.1f} | {max(row['peak_joint_torque_N_m']):.2f} "
                f"| {row['peak_torque_rms_N_m']:.2f} ({row['mean_torque_rms_N_m']:.2f}) "
                f"| {row['largest_base_error_mm']:.2f} | {captured} |"
            )
    for name, walk in walks.items():
        lines += [
            "",
            f"{name}: at {walk['fails_at_s']:.1f} s a step, {walk['because']['message']}.",
        ]
    return lines


def plan_lines(plans: dict[str, Any]) -> list[str]:
    """The random plans with each controller."""
    lines = ["", "## Random plans, 50 s a step", ""]
    for name, row in plans.items():
        lines.append(
            f"* {name}: {row['succeeded']} of {row['plans']} plans ({row['steps']} steps) carried "
            f"out; largest base error {row['largest_base_error_mm']:.1f} mm, largest capture "
            f"distance of those that succeeded {row['largest_capture_distance_mm']:.2f} mm, "
            f"largest grasp force {row['peak_grasp_force_N']:.1f} N."
        )
        for failure in row["failures"]:
            lines.append(
                f"  * plan {failure['plan']}, step {failure['step'] + 1}, {failure['phase']}: "
                f"{failure['message']}."
            )
    return lines


def time_step_lines(rows: dict[str, Any]) -> list[str]:
    """The walk with several time steps."""
    lines = [
        "",
        "## Time step",
        "",
        "The walk at 20 s a step with the paper's gains and feedforward. *Impulse*: largest "
        "difference of the",
        "grasp's impulse and the robot's momentum in the first step, as a share of the largest "
        "momentum; Newton's law wants 0, and the",
        "error of the first-order integrator goes with the time step.",
        "",
        "| time step | torque RMS, peak [N m] | grasp force [N] | base error [mm] | capture [mm] "
        "| impulse [%] | wall time [s] |",
        "|---|---|---|---|---|---|---|",
    ]
    for step, row in rows.items():
        lines.append(
            f"| {step} | {row['peak_torque_rms_N_m']:.4f} | {row['peak_grasp_force_N']:.3f} "
            f"| {row['largest_base_error_mm']:.4f} | {row['largest_capture_distance_mm']:.4f} "
            f"| {100 * row['impulse_error']:.1f} | {row['simulation_time_s']:.1f} |"
        )
    return lines


def speed_lines(data: dict[str, Any]) -> list[str]:
    """How fast the simulation is."""
    walk = data["walks"]["PD and feedforward"]["durations"]["50"]
    speed, wall = data["overhead"], walk["simulation_time_s"]
    return [
        "",
        "## Speed",
        "",
        f"{walk['steps']} steps, {50 * walk['steps']} s simulated: {wall:.1f} s. A step with its "
        f"trajectory and measurements takes {speed['ratio_median']:.2f} times a bare loop of "
        f"`mj_step` on the same model (largest of five {speed['ratio_largest']:.2f}; "
        f"{speed['bare_step_us']:.0f} us a time step). {data['machine']}.",
        "",
    ]


def main() -> None:
    """Run everything and write `dynamic_simulation.{json,md,png}`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results"))
    parser.add_argument("--plans", type=int, default=50)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    setup = default_setup()
    graph = case_graph(3, setup, "collisions")
    plan = (
        Planner(graph)
        .plan(setup["start"], setup["goal"], CASES[3].cost, goal_face=setup["goal_face"])
        .unwrap()
    )
    data = {
        "machine": f"Python {platform.python_version()}, MuJoCo {mujoco.__version__}, one core",
        "walks": walks(graph, plan, args.out),
        "time_steps": time_steps(graph, plan),
        "overhead": overhead(graph, plan),
        "random_plans": random_plans(args.plans),
    }
    write_whole(args.out / "dynamic_simulation.json", json.dumps(data, indent=1) + "\n")
    write_whole(args.out / "dynamic_simulation.md", markdown(data))


if __name__ == "__main__":
    main()
