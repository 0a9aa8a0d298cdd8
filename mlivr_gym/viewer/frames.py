"""Frames that the viewer plays: timed configurations of a plan or of an execution."""

from __future__ import annotations

from dataclasses import fields
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import PlanError
from mlivr_gym.motion.path_segments import path_segments
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.regrasp import PHASES, RegraspPath, planned_regrasp
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.motion.timed_configurations import TimedConfigurations
from mlivr_gym.motion.trajectory import TimedPath, Trajectory, trajectory
from mlivr_gym.simulation.recording import Recording
from mlivr_gym.stances.stance_graph import StanceGraph

STEP_TIME = 5.0
"""Duration of a played step of a plan [s], since a plan has no time scaling."""

FRAME_TIME = 0.05
"""Minimum time between two frames [s]."""

AT_REST = len(PHASES)
"""Phase of a frame in which the robot rests in a stance."""


class Frames(TimedConfigurations):
    """A sequence of k timed configurations.

    A robot at rest has the number of its stance as step, and the phase `AT_REST`.
    """

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.times)

    @property
    def duration(self) -> float:
        """Time of the last frame [s]."""
        return float(self.times[-1])

    def at(self, time: float) -> int:
        """Return the index of the last frame at or before a time [s]."""
        return max(int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1, 0)

    def starts(self) -> Array:
        """Return the start times of the steps and the end time, shape (steps + 1,) [s]."""
        first = np.flatnonzero(np.diff(self.step, prepend=-1))
        starts: Array = np.unique(np.append(self.times[first], self.duration))
        return starts

    def describe(self, k: int, plan: Plan) -> str:
        """Describe a frame: number of the step, limb, its two points and the phase."""
        if not plan.steps:
            return "the start is at the goal"
        number, phase = int(self.step[k]), int(self.phase[k])
        if phase == AT_REST:
            return f"stance {number} of {len(plan.steps)}"
        step = plan.steps[number]
        return (
            f"step {number + 1} of {len(plan.steps)}: limb {step.limb} "
            f"{step.from_point} → {step.to_point}, {PHASES[phase]}"
        )


def plan_frames(graph: StanceGraph, plan: Plan) -> Frames:
    """Return the frames of a plan at `STEP_TIME` a step.

    If a step cannot be reconstructed in this graph, the frames are the stances alone.
    """
    try:
        walked = _walked(graph, plan)
    except PlanError:
        return stance_frames(plan)
    step, phase = walked.step.copy(), walked.phase.copy()
    step[-1], phase[[0, -1]] = len(plan.steps), AT_REST
    bases = walked.base_positions, walked.base_quaternions
    return Frames(walked.times, step, phase, *bases, walked.joint_positions)


def _walked(graph: StanceGraph, plan: Plan) -> Trajectory:
    """Return the trajectory of a plan whose steps all take `STEP_TIME`, regardless of limits."""
    parts = []
    for index in range(len(plan.steps)):
        path = RegraspPath(graph, planned_regrasp(graph, plan, index))
        segments = path_segments(path)
        scalings = Durations.of_step(STEP_TIME).time_scalings(segments)
        parts.append(trajectory(TimedPath(path, segments, scalings), FRAME_TIME))
    return reduce(lambda before, after: after.after(before), parts)


def stance_frames(plan: Plan) -> Frames:
    """Return the stances of a plan as frames at intervals of `STEP_TIME`."""
    motion, number = plan.motion, np.arange(len(plan.stances))
    bases, resting = (motion.base_positions, motion.base_quaternions), np.full_like(number, AT_REST)
    times = STEP_TIME * number.astype(np.float64)
    return Frames(times, number, resting, *bases, motion.joint_positions)


def recording_frames(recording: Recording) -> Frames:
    """Return the frames of an execution, at the times of its recording."""
    shown = {field.name: getattr(recording, field.name) for field in fields(Frames)}
    return Frames(**shown | {"times": recording.times - recording.times[0]})


def load_recording(path: str | Path, plan: Plan) -> Recording:
    """Read the recording that `mlivr-gym simulate` has written for a plan.

    Raises a `PlanError` if the file cannot be read, or belongs to another robot or a longer plan.
    """
    try:
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as data:
            arrays: dict[str, Any] = {field.name: data[field.name] for field in fields(Recording)}
    except Exception as error:  # NumPy, zipfile and zlib raise errors of many kinds
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise PlanError(f"cannot read simulation {str(path)!r}: {reason}") from None
    count, limbs = len(arrays["times"]), plan.world.robot.limbs
    shapes = {"joint_positions": (count, limbs, 6), "grasp_forces": (count, limbs, 3)}
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise PlanError(
                f"simulation {str(path)!r} does not belong to the plan: {name} has shape "
                f"{arrays[name].shape}, not {shape}"
            )
    if not count or int(arrays["step"].max()) >= len(plan.steps):
        raise PlanError(
            f"simulation {str(path)!r} does not belong to the plan, which has "
            f"{len(plan.steps)} steps"
        )
    return Recording(**arrays)
