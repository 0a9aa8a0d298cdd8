"""Simulate plans in MuJoCo: Case 3 at several paces, random plans, and varied limits.

    python experiments/dynamic_simulation.py [--out results] [--plans 50] [--workers 2]

Case 3 is executed by each controller at each pace. Random plans are executed at each pace by the
full controller. Without simulation, the duration of their steps is computed for varied limits of
joints and grasps. The speed of the simulation is measured. Writes `dynamic_simulation.json` and
`.md`, `dynamic_simulation_fast.png` and `pace.png`.
"""

from __future__ import annotations

import platform
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from dynamic_report import CONTROLLERS as NAMES
from dynamic_report import markdown, pace_figure
from reports import CORES, case_3, experiment, study_rows
from tqdm import tqdm

from mlivr_gym import stance_graph
from mlivr_gym.envs import sample_task
from mlivr_gym.errors import TimingError
from mlivr_gym.motion import Durations
from mlivr_gym.motion.time_scaling import duration_of
from mlivr_gym.pictures import simulation_figure
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.simulation import PACES, Execution, Limits, Setup, execute
from mlivr_gym.simulation.parameters import CONTROLLERS
from mlivr_gym.simulation.path_dynamics import segment_dynamics
from mlivr_gym.simulation.timing import shortest_scaling, step_trajectory
from mlivr_gym.stances import StanceGraph

PACES: dict[str, Limits | Durations] = {
    "paper": Durations(),
    "gentle": PACES["gentle"],
    "quintic": Limits(profile="quintic"),
    "fast": Limits(),
}
"""Paces of execution; the paper's is 50 s a step."""

VARIED = {
    "grasp_force": (10.0, 20.0, 30.0, 45.0, 60.0, 90.0, 150.0),
    "grasp_torque": (5.0, 10.0, 15.0, 22.5, 30.0, 45.0, 75.0),
    "torque": (0.1, 0.2, 0.4, 0.6, 0.8, 1.0),
}
"""Limits that are varied singly: force [N] and torque [N m] on a grasp, share of joint torque."""

SEED = 20261121
"""Seed of the random plans."""


@cache
def graph_and_plans(count: int, seed: int = SEED) -> tuple[StanceGraph, list[Plan]]:
    """Return the graph, and plans of random tasks, alternately for base cost and step cost."""
    graph, rng = stance_graph(), np.random.default_rng(seed)
    planner, plans = Planner(graph), list[Plan]()
    while len(plans) < count:
        state, goal = sample_task(graph, rng, 0.2)
        cost = ("base", "steps")[len(plans) % 2]
        result = planner.plan(graph.ids(state.stance), goal.tolist(), cost)
        if result.plan is None:
            print(f"no plan: {result.message}", flush=True)
        elif result.plan.steps:
            plans.append(result.plan)
    return graph, plans


def executed(graph: StanceGraph, plan: Plan, controller: str, pace: str) -> Execution:
    """Execute a plan with a controller at a pace."""
    setup = Setup(PACES[pace], CONTROLLERS[controller])
    simulation = setup.simulation(graph.grasp_map, graph.robot, graph.obstacles)
    return execute(graph, plan, setup.timing, simulation=simulation)


def figures(execution: Execution) -> dict[str, Any]:
    """Return the values of an execution that the tables show."""
    peaks, failure = execution.peaks, execution.failure
    told = ("kind", "step", "phase", "message")
    return {
        "success": failure is None,
        "failure": None if failure is None else {name: getattr(failure, name) for name in told},
        "steps": len(execution.plan.steps),
        "steps_done": len(execution.captures),
        "step_times_s": execution.step_times.tolist(),
        "peak_grasp_force_N": float(peaks.grasp_force.max()),
        "peak_grasp_torque_N_m": float(peaks.grasp_torque.max()),
        "peak_joint_torque_N_m": peaks.joint_torque.max(axis=0).tolist(),
        "peak_torque_rms_N_m": peaks.torque_rms,
        "mean_torque_rms_N_m": float(execution.recording.torque_rms.mean()),
        "largest_base_error_mm": 1e3 * peaks.base_error,
        "largest_capture_distance_mm": max(
            (1e3 * c.distance for c in execution.captures), default=None
        ),
    }


def walk(task: int, controller: str, pace: str) -> dict[str, Any]:
    """Execute Case 3 with a controller at a pace."""
    return figures(executed(*case_3(), controller, pace))


def random_plans(task: int, pace: str, plans: int) -> dict[str, Any]:
    """Execute random plans at a pace with the full controller, one after the other."""
    (graph, drawn), timing = graph_and_plans(plans), PACES[pace]
    simulation = Setup(timing).simulation(graph.grasp_map, graph.robot)
    rows = [figures(execute(graph, plan, timing, simulation=simulation)) for plan in drawn]
    times = np.concatenate([row["step_times_s"] for row in rows])
    done = [row for row in rows if row["success"]]
    return {
        "steps": sum(row["steps"] for row in rows),
        "succeeded": len(done),
        "seconds_a_step": [float(times.mean()), float(np.median(times)), float(times.max())],
        "largest_base_error_mm": max(row["largest_base_error_mm"] for row in rows),
        "largest_capture_distance_mm": max(row["largest_capture_distance_mm"] for row in done),
        "peak_grasp_force_N": max(row["peak_grasp_force_N"] for row in rows),
        "peak_grasp_torque_N_m": max(row["peak_grasp_torque_N_m"] for row in rows),
        "failures": [
            {"plan": k, **row["failure"]} for k, row in enumerate(rows) if not row["success"]
        ],
    }


def pace(graph: StanceGraph, plans: Sequence[Plan]) -> dict[str, Any]:
    """Compute the duration of a step under varied limits, and the binding limit of each segment."""
    steps = [plan.joint_path(index) for plan in plans for index in range(len(plan.steps))]

    def seconds(limits: Limits) -> tuple[float, Counter[str]]:
        total, deciding = 0.0, Counter[str]()
        for path in steps:
            for segment in path.segments:
                rows = segment_dynamics(path, segment, limits)
                scaling = shortest_scaling(rows, limits)
                total += duration_of(scaling)
                deciding[rows.binding(scaling).limit] += 1
        return total / len(steps), deciding

    data: dict[str, Any] = {"steps": len(steps), "fronts": {}}
    for profile in ("fastest", "quintic"):
        mean, deciding = seconds(Limits(profile=profile))
        data[profile] = {"seconds_a_step": mean, "deciding": dict(deciding)}
    for name, values in VARIED.items():
        data["fronts"][name] = [
            [value, seconds(replace(Limits(), **{name: value}))[0]]
            for value in tqdm(values, desc=f"limits of {name}", mininterval=5.0)
        ]
    data["fronts"]["all_limits"] = [
        [share, seconds(Limits(0.8 * share, 0.8, 60.0 * share, 30.0 * share))[0]]
        for share in (0.1, 0.2, 0.4, 0.7, 1.0)
    ]
    return data


def shortest_fixed(graph: StanceGraph, plan: Plan) -> dict[str, float]:
    """Return the shortest equal duration of all steps of a walk, for two ways to divide it."""
    needed, paper = [], []
    for timing, shortest in ((Limits(step_duration=0.1), needed), (Durations.of_step(1.0), paper)):
        for index in range(len(plan.steps)):
            try:
                step_trajectory(graph, plan, index, timing)
            except TimingError as error:
                shortest.append(error.shortest)
    return {"as_limits_need_s": max(needed), "as_the_paper_s": max(paper)}


def overhead(graph: StanceGraph, plans: Sequence[Plan]) -> dict[str, float]:
    """Return the processor time of steps at the default pace, and of a bare loop of `mj_step`."""
    simulation = Setup().simulation(graph.grasp_map, graph.robot)
    prepared = simulated = bare = 0.0
    steps = ticks = 0
    for plan in plans:
        simulation.reset(*plan.configuration(0), graph.indices(plan.stances[0]))
        for index in range(len(plan.steps)):
            begin = time.process_time()
            trajectory = step_trajectory(graph, plan, index)
            ready = time.process_time()
            simulation.execute(trajectory, index)
            prepared, simulated = prepared + ready - begin, simulated + time.process_time() - ready
            steps, ticks = steps + 1, ticks + len(trajectory.times) - 1
    begin = time.process_time()
    for _ in range(10_000):
        mujoco.mj_step(simulation.model, simulation.data)
    bare = (time.process_time() - begin) / 10_000
    return {
        "steps": steps,
        "steps_a_second": steps / (prepared + simulated),
        "preparation_ms": 1e3 * prepared / steps,
        "time_step_us": 1e6 * simulated / ticks,
        "bare_step_us": 1e6 * bare,
    }


def measured(plans: int, workers: int) -> dict[str, Any]:
    """Return the results of all parts."""
    kind, paces = "dynamic_simulation", list(PACES)
    cases = study_rows(f"{kind}:walk", 1, workers, controller=list(NAMES), pace=paces)
    rows = study_rows(f"{kind}:random_plans", 1, workers, pace=paces, plans=[plans])
    graph, drawn = graph_and_plans(plans)
    return {
        "machine": f"Python {platform.python_version()}, MuJoCo {mujoco.__version__}, one core",
        "walks": cases,
        "shortest_fixed": shortest_fixed(*case_3()),
        "random_plans": {row["pace"]: row for row in rows},
        "pace": pace(graph, drawn),
        "overhead": overhead(graph, drawn[:10]),
    }


def draw(data: dict[str, Any], path: Path) -> None:
    """Draw Case 3 as fast as the limits allow, and the durations within varied limits."""
    done = executed(*case_3(), "full", "fast")
    title, file = "Case 3, controller: full, pace: fast", path.with_stem(f"{path.stem}_fast")
    simulation_figure(done.recording, done.captures, done.failure, file, title)
    pace_figure(data, path.with_stem("pace"))


if __name__ == "__main__":
    experiment("dynamic_simulation", __doc__, measured, markdown, draw, plans=50, workers=CORES)
