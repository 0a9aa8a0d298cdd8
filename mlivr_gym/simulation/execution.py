"""Executes plans in MuJoCo, step by step, and tells what was measured."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arguments import Of, checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import PlanError
from mlivr_gym.files import write_whole
from mlivr_gym.motion.arguments import WALK
from mlivr_gym.motion.clocks import Durations
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.schema import Maybe
from mlivr_gym.simulation.controller import Controller
from mlivr_gym.simulation.disturbances import Disturbance
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.limits import Limits
from mlivr_gym.simulation.recording import Capture, Failure, Peaks, Recording
from mlivr_gym.simulation.simulator import ExecutedStep, Simulation
from mlivr_gym.simulation.timing import TIMING, step_trajectory
from mlivr_gym.stances.stance_graph import StanceGraph

FINAL_HOLD = 2.0
"""How long the last grasp is held at the end of a walk [s]."""


@dataclass(frozen=True)
class Execution:
    """A plan that was executed, or as far as it went.

    Attributes
    ----------
    plan
        The plan.
    timing
        How fast it was to be carried out.
    controller
        The controller of the joints.
    physics
        Figures of grasps and failures.
    disturbance
        How robot and module differed from what the controller knows.
    recording
        Measurements.
    peaks
        Largest values at any time step.
    captures
        How each limb grasped its point.
    failure
        Why the walk ended before its end, or None.
    simulated_time
        Time that passed in the simulation [s].
    preparation_time
        Time spent on trajectories [s].
    simulation_time
        Time spent on simulation [s].
    """

    plan: Plan
    timing: Limits | Durations
    controller: Controller
    physics: Physics
    disturbance: Disturbance
    recording: Recording
    peaks: Peaks
    captures: tuple[Capture, ...]
    failure: Failure | None
    simulated_time: float
    preparation_time: float
    simulation_time: float

    @property
    def step_times(self) -> Array:
        """How long each step took that ended with a grasp, shape (k,) [s]."""
        times: Array = np.diff([0.0, *(capture.time for capture in self.captures)])
        return times

    def summary(self) -> dict[str, Any]:
        """What was measured, without the arrays, as plain data for JSON."""
        distances = [capture.distance for capture in self.captures]
        momenta = np.linalg.norm(self.recording.momenta, axis=1)
        return {
            "success": self.failure is None,
            "failure": None if self.failure is None else self.failure.to_dict(),
            "steps": len(self.plan.steps),
            "steps_done": len(self.captures),
            "step_times_s": self.step_times.tolist(),
            "tries": [capture.tries for capture in self.captures],
            "simulated_time_s": self.simulated_time,
            "preparation_time_s": self.preparation_time,
            "simulation_time_s": self.simulation_time,
            "torque_rms_mean_N_m": float(self.recording.torque_rms.mean()),
            "largest_capture_distance_m": max(distances, default=None),
            "largest_momentum_kg_m_s": float(momenta.max()),
            "peaks": self.peaks.to_dict(),
            "captures": [asdict(capture) for capture in self.captures],
            "timing": {"kind": type(self.timing).__name__} | asdict(self.timing),
            "controller": asdict(self.controller),
            "physics": asdict(self.physics),
            "disturbances": {"seed": self.disturbance.seed} | asdict(self.disturbance.sizes),
        }

    def save(self, path: str | Path) -> None:
        """Write the measurements as a NumPy archive `path`, and `summary` as JSON beside it.

        Raises
        ------
        FileError
            If a file cannot be written.
        """
        stream = io.BytesIO()
        np.savez_compressed(stream, **self.recording.arrays())  # type: ignore[arg-type]
        write_whole(path, stream.getvalue())
        write_whole(Path(path).with_suffix(".json"), json.dumps(self.summary(), indent=1) + "\n")


@checked(
    {**WALK, "timing": TIMING, "physics": Maybe(Of(Physics)), "simulation": Maybe(Of(Simulation))}
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
        How fast: as `Limits` allow, by default the default ones, or in given `Durations`.
    physics
        Figures of grasps and failures.
    progress
        Called with the number of steps done.
    simulation
        A simulation of the plan's robot, map and obstacles, for another controller or
        disturbance, or to use it again; its `physics` are used then.

    Raises
    ------
    PlanError
        If the plan has no step, or a step cannot be followed inside the joint limits.
    TimingError
        If durations break a limit.
    RobotError
        If the robot's masses are not known, see `RobotSpec.limb_dynamics`.

    Example:
        >>> execution = execute(graph, plan)
        >>> execution.failure is None, execution.peaks.grasp_force.max()
    """
    timing = timing or Limits()
    start = time.perf_counter()
    used = simulation.physics if simulation is not None else physics or Physics()
    walk = timed_walk(graph, plan, timing, used.timestep)
    ready = time.perf_counter()
    world = plan.world
    simulation = simulation or Simulation(graph.grasp_map, world.robot, used, world.obstacles)
    done = execute_walk(simulation, walk, progress)
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
        preparation_time=ready - start,
        simulation_time=time.perf_counter() - ready,
    )


class TimedWalk(NamedTuple):
    """A plan with a clock, all that a simulation needs of it."""

    start: tuple[Array, Array, Array]
    """Base position [m], base quaternion and joint angles (N, 6) [rad] at the start."""
    points: tuple[int, ...]
    """Point index each limb holds there."""
    steps: tuple[Trajectory, ...]
    """The trajectory of each step, on the simulation's time grid."""


def timed_walk(
    graph: StanceGraph, plan: Plan, timing: Limits | Durations, period: float
) -> TimedWalk:
    """A plan with a clock, on a time grid [s].

    Raises
    ------
    PlanError
        If the plan has no step, or a step cannot be followed inside the joint limits.
    TimingError
        If durations break a limit.
    """
    if not plan.steps:
        raise PlanError("the plan has no step: it starts at its goal")
    steps = (
        step_trajectory(graph, plan, index, timing, period) for index in range(len(plan.steps))
    )
    return TimedWalk(plan.configuration(0), graph.indices(plan.stances[0]), tuple(steps))


def execute_walk(
    simulation: Simulation, walk: TimedWalk, progress: Callable[[int], None] | None = None
) -> list[ExecutedStep]:
    """What came of each step up to the end or to the one that fails, and of the last hold."""
    simulation.reset(*walk.start, walk.points)
    done: list[ExecutedStep] = []
    for index, trajectory in enumerate(walk.steps):
        done.append(simulation.execute(trajectory, index))
        if progress is not None:
            progress(index + 1)
        if done[-1].failure is not None:
            return done
    done.append(simulation.hold(walk.steps[-1], FINAL_HOLD, len(walk.steps) - 1))
    return done
