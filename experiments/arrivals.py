"""Ways in which a gripper may arrive at its point, to see what makes torques at the capture.

`arriving` changes the approach of a step: the gripper ends beside its point, or comes on at
constant speed and stops at once. What differs between steps is measured by `executed`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from task_space_swing import follow

from mlivr_gym.arrays import Array
from mlivr_gym.motion.clocks import quintic
from mlivr_gym.motion.regrasp import PHASES, RegraspPath
from mlivr_gym.motion.trajectory import Trajectory, trajectory
from mlivr_gym.simulation.phase_torques import CAPTURE_TIME, largest, phase_torques
from mlivr_gym.simulation.recording import Capture, Recording
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.simulation.timing import timed_path


@dataclass(frozen=True)
class Arrival:
    """How a step is carried out.

    Attributes:
        setup: Controller, pace and figures of grasps.
        offset: How far beside its point the gripper is told to go, along the rail [m].
        constant_speed: Whether it comes on at constant speed.
        velocity_reference: Whether the controller is told velocities, or brakes all motion.
    """

    setup: Setup
    offset: float = 0.0
    constant_speed: bool = False
    velocity_reference: bool = True


@dataclass(frozen=True)
class Measured:
    """A step that was carried out by itself, from rest, with the time after its capture.

    Attributes:
        recording: Measurements.
        captures: How the gripper grasped its point; none if it missed.
        failure: Why it ended early, in words, or None.
        base_error: Largest distance of the base from its path [m].
    """

    recording: Recording
    captures: tuple[Capture, ...]
    failure: str | None
    base_error: float

    def figures(self) -> dict[str, Any]:
        """Torques phase by phase, as plain data."""
        torques = phase_torques(self.recording, self.captures)
        return {
            "largest_in": largest(torques, torques[0].step).part,
            "parts": {
                entry.part: {"peak_N_m": entry.peak, "mean_N_m": entry.mean} for entry in torques
            },
            "captured": bool(self.captures),
            "capture_distance_mm": [1e3 * capture.distance for capture in self.captures],
            "base_error_mm": 1e3 * self.base_error,
            "failure": self.failure,
        }


def arriving(path: RegraspPath, planned: Trajectory, arrival: Arrival) -> Trajectory:
    """The trajectory of a step with another approach, or without velocities.

    Args:
        path: The step.
        planned: Its trajectory.
        arrival: What is to be different.
    """
    if not arrival.velocity_reference:
        still = np.zeros_like(planned.joint_velocities)
        return replace(planned, joint_velocities=still, joint_accelerations=still)
    if not arrival.offset and not arrival.constant_speed:
        return planned
    step, graph = path.regrasp, path.graph
    grasp = graph.solver.grasps[step.to_point]
    inside = planned.phase == PHASES.index("approach")
    times = planned.times[inside]
    # The sample before is the last of the swing.
    share = (times - times[0] + planned.period) / (times[-1] - times[0] + planned.period)
    eased = quintic(1.0)(share)
    height = 1.0 - (share if arrival.constant_speed else eased)
    rail = graph.grasp_map.rotations[step.to_point][:, 0]
    flange = (
        grasp["flange"]["position"]
        + graph.robot.lift * height[:, None] * grasp["normal"]
        + arrival.offset * eased[:, None] * rail
    )
    tool, still = grasp["flange"]["rotation"][None], path.base(np.ones(1))
    start = planned.joint_positions[np.flatnonzero(inside)[0] - 1, step.limb]
    joints = planned.joint_positions.copy()
    joints[inside, step.limb] = follow(
        path, step.branches[graph.limbs], (flange, tool), still, start
    )
    speeds: Array = np.gradient(joints, planned.times, axis=0)
    changes: Array = np.gradient(speeds, planned.times, axis=0)
    return replace(
        planned, joint_positions=joints, joint_velocities=speeds, joint_accelerations=changes
    )


def executed(path: RegraspPath, arrival: Arrival, simulation: Simulation) -> Measured:
    """Carry a step out by itself, from rest in its stance, and hold still after its capture.

    Contacts are off: what a swing comes too close to is told by `task_space_swing.attempts`, and a
    swing that would touch something is to be compared to its end.

    Args:
        path: The step.
        arrival: How it is carried out.
        simulation: A simulation with the arrival's setup.
    """
    step = path.regrasp
    simulation.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    timed = timed_path(path, arrival.setup.timing)
    followed = arriving(path, trajectory(timed, simulation.physics.timestep), arrival)
    first = followed.base_positions[0], followed.base_quaternions[0], followed.joint_positions[0]
    simulation.reset(*first, step.before)
    done = simulation.execute(followed)
    if done.capture is None:
        assert done.failure is not None
        return Measured(done.recording, (), done.failure.kind, done.peaks.base_error)
    rest = simulation.rest(followed, CAPTURE_TIME)
    recording = Recording.join([done.recording, rest.recording])
    why = None if rest.failure is None else rest.failure.kind
    return Measured(recording, (done.capture,), why, done.peaks.base_error)
