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
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import PlanError
from mlivr_gym.files import write_whole, written_together
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.schema import OrNone
from mlivr_gym.simulation.controller import ControllerParameters
from mlivr_gym.simulation.disturbances import Disturbance
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.limits import Limits
from mlivr_gym.simulation.recording import Capture, Failure, Peaks, Recording
from mlivr_gym.simulation.simulated_robot import SimulatedInterval
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.simulation.timing import TIMING, step_trajectory
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

    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> from mlivr_gym.planners import Planner
    >>> graph = stance_graph()
    >>> plan = Planner(graph).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), cost="steps").unwrap()
    >>> execution = execute(graph, plan)
    >>> execution.failure is None, len(execution.captures) == len(plan.steps)
    (True, True)
    """
    timing = timing or Limits()
    start = time.perf_counter()
    used = simulation.physics if simulation is not None else physics or Physics()
    timed = timed_plan(graph, plan, timing, used.timestep)
    ready = time.perf_counter()
    world = plan.world
    simulation = simulation or Simulation(graph.grasp_map, world.robot, used, world.obstacles)
    done = execute_timed_plan(simulation, timed, progress)
    return Execution(
        plan=plan,
        timing=timing,
        controller=simulation.controller,
        physics=simulation.physics,
        disturbance=simulation.disturbance,
        recording=Recording.join([step.recording for step in done]),
        peaks=Peaks.join([step.peaks for step in done]),
        captures=tuple(step.capture for step in done if step.capture is not None),
        failure=done[-1].failure,
        simulated_time=simulation.time,
        trajectory_computing_time=ready - start,
        simulation_computing_time=time.perf_counter() - ready,
    )


class TimedPlan(NamedTuple):
    """A plan with a time scaling: everything that the simulation needs."""

    plan: Plan
    """The plan."""
    steps: tuple[Trajectory, ...]
    """Trajectory of each step on the time grid of the simulation."""


def timed_plan(
    graph: StanceGraph, plan: Plan, timing: Limits | Durations, period: float
) -> TimedPlan:
    """Compute the trajectories of all steps of a plan on a time grid with spacing `period` [s].

    Raises a `PlanError` if the plan has no step, or a step cannot be followed inside the joint
    limits, and a `TimingError` if durations violate a limit.
    """
    if not plan.steps:
        raise PlanError("the plan has no step: it starts at its goal")
    steps = (
        step_trajectory(graph, plan, index, timing, period) for index in range(len(plan.steps))
    )
    return TimedPlan(plan, tuple(steps))


def execute_timed_plan(
    simulation: Simulation, timed: TimedPlan, progress: Callable[[int], None] | None = None
) -> list[SimulatedInterval]:
    """Execute a plan up to its end or first failure; return each step and the rest at the end."""
    simulation.reset(*timed.plan.configuration(0), timed.steps[0].grasps[0].tolist())
    done: list[SimulatedInterval] = []
    for index, trajectory in enumerate(timed.steps):
        done.append(simulation.execute(trajectory, index))
        if progress is not None:
            progress(index + 1)
        if done[-1].failure is not None:
            return done
    done.append(simulation.stand_still(timed.steps[-1], FINAL_REST, len(timed.steps) - 1))
    return done
