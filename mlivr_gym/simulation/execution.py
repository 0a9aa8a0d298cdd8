"""Execution of plans in MuJoCo, step by step, with all measurements.

Before anything is simulated, each step of the plan is made a `Trajectory` on the time grid of the
simulation. Then a `Simulation` starts in the first stance and executes one trajectory after the
other, until the last one or the first failure.
"""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.files import write_whole, written_together
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.schema import OrNone
from mlivr_gym.simulation.disturbances import Disturbance
from mlivr_gym.simulation.parameters import ControllerParameters, Limits, Physics
from mlivr_gym.simulation.recording import Capture, Failure, Peaks, Recording, SimulatedInterval
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.simulation.timing import TIMING, step_trajectories
from mlivr_gym.stances.stance_graph import StanceGraph

FINAL_REST = 2.0
"""Time for which the robot stands still after the last grasp [s]."""


@dataclass(frozen=True)
class Execution:
    """An executed plan, or the part of it before a failure."""

    plan: Plan
    """The plan."""
    timing: Limits | Durations
    """Limits or durations that determine the time scaling."""
    controller: ControllerParameters
    """Parameters of the joint controller."""
    physics: Physics
    """Parameters of grasps and failures."""
    disturbance: Disturbance
    """Difference between the simulated robot and module and the model of the controller."""
    recording: Recording
    """Measurements on a time grid."""
    peaks: Peaks
    """Maxima over all time steps."""
    captures: tuple[Capture, ...]
    """The captures, one for each step that ended with a grasp."""
    failure: Failure | None
    """The failure that ended the execution, or None if it reached the end of the plan."""
    simulated_time: float
    """Time at the end of the simulation [s]."""
    trajectory_computing_time: float
    """Computing time of the trajectories [s]."""
    simulation_computing_time: float
    """Computing time of the simulation, compilation of the model included [s]."""

    @property
    def step_times(self) -> Array:
        """Duration of each step that ended with a grasp, shape (k,) [s]."""
        times: Array = np.diff([0.0, *(capture.time for capture in self.captures)])
        return times

    def summary(self) -> dict[str, Any]:
        """Return the measurements without the arrays as plain data for JSON."""
        distances = [capture.distance for capture in self.captures]
        momenta = np.linalg.norm(self.recording.momenta, axis=1)
        return {
            "success": self.failure is None,
            "failure": None if self.failure is None else self.failure.to_dict(),
            "steps": len(self.plan.steps),
            "steps_done": len(self.captures),
            "step_times_s": self.step_times.tolist(),
            "simulated_time_s": self.simulated_time,
            "preparation_time_s": self.trajectory_computing_time,
            "simulation_time_s": self.simulation_computing_time,
            "torque_rms_mean_N_m": float(self.recording.torque_rms.mean()),
            "largest_capture_distance_m": max(distances, default=None),
            "largest_momentum_kg_m_s": float(momenta.max()),
            "peaks": self.peaks.to_dict(),
            "captures": [asdict(capture) for capture in self.captures],
            "timing": {"kind": type(self.timing).__name__} | asdict(self.timing),
            "controller": asdict(self.controller),
            "physics": asdict(self.physics),
            "disturbances": {"seed": self.disturbance.seed} | asdict(self.disturbance.ranges),
        }

    def save(self, path: str | Path) -> None:
        """Write the recording as a NumPy archive `path`, and the summary as JSON next to it.

        The summary has the same name with the suffix `.json`. Raises a `FileError` if a file cannot
        be written; then neither is.
        """
        stream = io.BytesIO()
        np.savez_compressed(stream, **self.recording.arrays())  # type: ignore[arg-type]
        with written_together():
            write_whole(path, stream.getvalue())
            summary = json.dumps(self.summary(), indent=1) + "\n"
            write_whole(Path(path).with_suffix(".json"), summary)


@checked(
    {
        **ARGUMENTS,
        "timing": TIMING,
        "physics": OrNone(InstanceOf(Physics)),
        "simulation": OrNone(InstanceOf(Simulation)),
    }
)
def execute(
    graph: StanceGraph,
    plan: Plan,
    timing: Limits | Durations | None = None,
    physics: Physics | None = None,
    progress: Callable[[int], None] | None = None,
    simulation: Simulation | None = None,
) -> Execution:
    """Execute a plan in MuJoCo.

    Parameters
    ----------
    graph
        The stance graph of the plan's robot and map.
    plan
        The plan.
    timing
        `Limits` for a time-optimal execution, by default `Limits()`, or fixed `Durations`.
    physics
        Parameters of grasps and failures.
    progress
        A function that is called after each step with the number of steps so far; a step that
        failed counts.
    simulation
        A simulation of the plan's robot, map and obstacles, with another controller or
        disturbance, or to be used again. The argument `physics` is then ignored.

    Returns
    -------
    Execution
        The measurements; a failure is reported there and is not an exception.

    Raises
    ------
    PlanError
        If the plan has no step, or a step cannot be followed inside the joint limits.
    TimingError
        If durations violate a limit.
    RobotError
        If the robot's masses are not known, see `RobotSpec.dynamics_of`.
    """
    timing = timing or Limits()
    start = time.perf_counter()
    used = simulation.physics if simulation is not None else physics or Physics()
    steps = step_trajectories(graph, plan, timing, used.timestep)
    ready = time.perf_counter()
    world = plan.world
    simulation = simulation or Simulation(graph.grasp_map, world.robot, used, world.obstacles)
    simulation.reset(*plan.configuration(0), steps[0].grasps[0].tolist())
    parts: list[SimulatedInterval] = []
    for index, trajectory in enumerate(steps):
        parts.append(simulation.execute(trajectory, index))
        if progress is not None:
            progress(index + 1)
        if parts[-1].failure is not None:
            break
    else:
        parts.append(simulation.stand_still(steps[-1], FINAL_REST, len(steps) - 1))
    done = parts[-1].after(*parts[:-1])
    return Execution(
        plan=plan,
        timing=timing,
        controller=simulation.controller,
        physics=simulation.physics,
        disturbance=simulation.disturbance,
        recording=done.recording,
        peaks=done.peaks,
        captures=done.captures,
        failure=done.failure,
        simulated_time=simulation.time,
        trajectory_computing_time=ready - start,
        simulation_computing_time=time.perf_counter() - ready,
    )
