"""Executes plans in MuJoCo, step by step, and tells what was measured."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.errors import PlanError
from mlivr_gym.files import write_whole
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.plan_motion import step_trajectory
from mlivr_gym.motion.trajectory import Durations
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.recording import Capture, Failure, Peaks, Recording
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.stances.stance_graph import StanceGraph

REST = 2.0
"""How long the last grasp is held at the end of a walk [s]."""


@dataclass(frozen=True)
class Execution:
    """A plan that was executed, or as far as it went.

    Attributes:
        plan: The plan.
        durations: How long the parts of a step took.
        physics: Figures of controller, grasps and failures.
        recording: Measurements.
        peaks: Largest values at any time step.
        captures: How each limb grasped its point.
        failure: Why the walk ended before its end, or None.
        preparation_time: Time spent on trajectories [s].
        simulation_time: Time spent on simulation [s].
    """

    plan: Plan
    durations: Durations
    physics: Physics
    recording: Recording
    peaks: Peaks
    captures: tuple[Capture, ...]
    failure: Failure | None
    preparation_time: float
    simulation_time: float

    @property
    def simulated_time(self) -> float:
        """Time that passed in the simulation [s]."""
        return (
            self.durations.total * len(self.captures) + REST
            if self.failure is None
            else self.failure.time
        )

    def summary(self) -> dict[str, Any]:
        """What was measured, without the arrays, as plain data for JSON."""
        distances = [capture.distance for capture in self.captures]
        momenta = np.linalg.norm(self.recording.momenta, axis=1)
        return {
            "success": self.failure is None,
            "failure": None if self.failure is None else self.failure.to_dict(),
            "steps": len(self.plan.steps),
            "steps_done": len(self.captures),
            "step_duration_s": self.durations.total,
            "simulated_time_s": self.simulated_time,
            "preparation_time_s": self.preparation_time,
            "simulation_time_s": self.simulation_time,
            "torque_rms_mean_N_m": float(self.recording.torque_rms.mean()),
            "largest_capture_distance_m": max(distances, default=None),
            "largest_momentum_kg_m_s": float(momenta.max()),
            "peaks": self.peaks.to_dict(),
            "captures": [asdict(capture) for capture in self.captures],
            "durations_s": asdict(self.durations),
            "physics": asdict(self.physics),
        }

    def save(self, path: str | Path) -> None:
        """Write the measurements as a NumPy archive `path`, and `summary` as JSON beside it.

        Raises:
            FileError: If a file cannot be written.
        """
        stream = io.BytesIO()
        np.savez_compressed(stream, **self.recording.arrays())  # type: ignore[arg-type]
        write_whole(path, stream.getvalue())
        write_whole(Path(path).with_suffix(".json"), json.dumps(self.summary(), indent=1) + "\n")


def execute(
    graph: StanceGraph,
    plan: Plan,
    durations: Durations | None = None,
    physics: Physics | None = None,
    progress: Callable[[int], None] | None = None,
    simulation: Simulation | None = None,
) -> Execution:
    """Execute a plan in MuJoCo.

    Args:
        graph: The stance graph of the plan's robot and map.
        plan: The plan.
        durations: How long the parts of a step take; by default the paper's 10, 30 and 10 s.
        physics: Figures of controller, grasps and failures.
        progress: Called with the number of steps done.
        simulation: A simulation of the plan's robot, map and obstacles to use again; its `physics`
            are used then.

    Raises:
        PlanError: If the plan has no step, or a step cannot be followed inside the joint limits.
        RobotError: If the robot's masses are not known, see `dynamics.check_masses`.

    Example:
        >>> execution = execute(graph, plan)
        >>> execution.failure is None, execution.peaks.grasp_force.max()
    """
    if not plan.steps:
        raise PlanError("the plan has no step: it starts at its goal")
    durations = durations or Durations()
    world = plan.world
    simulation = simulation or Simulation(graph.grasp_map, world.robot, physics, world.obstacles)
    simulation.reset(*plan.configuration(0), graph.indices(plan.stances[0]))
    recordings, peaks, captures, failure = [], [], [], None
    prepared = simulated = 0.0
    for index in range(len(plan.steps)):
        start = time.perf_counter()
        trajectory = step_trajectory(graph, plan, index, durations, simulation.physics.timestep)
        ready = time.perf_counter()
        done = simulation.execute(trajectory, index)
        prepared, simulated = prepared + ready - start, simulated + time.perf_counter() - ready
        recordings.append(done.recording)
        peaks.append(done.peaks)
        if done.capture is not None:
            captures.append(done.capture)
        if progress is not None:
            progress(index + 1)
        failure = done.failure
        if failure is not None:
            break
    else:
        # The walk goes on for a moment, so that the last grasp is measured too.
        start = time.perf_counter()
        done = simulation.rest(trajectory, REST, len(plan.steps) - 1)
        simulated += time.perf_counter() - start
        recordings.append(done.recording)
        peaks.append(done.peaks)
        failure = done.failure
    return Execution(
        plan, durations, simulation.physics, Recording.join(recordings), Peaks.join(peaks),
        tuple(captures), failure,
        prepared, simulated,
    )  # fmt: skip
