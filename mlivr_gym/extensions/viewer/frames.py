"""Frames that the viewer plays: timed configurations of a plan or of an execution."""

from __future__ import annotations

from dataclasses import fields
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.errors import PlanError, path_shown
from mlivr_gym.motion import PHASES, Durations, Plan, TimedConfigurations, TimedPath, Trajectory
from mlivr_gym.motion.trajectory import trajectory
from mlivr_gym.schema import FieldPath, Numbers
from mlivr_gym.stances import StanceGraph

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

    @property
    def duration(self) -> float:
        """Time of the last frame [s]."""
        return float(self.times[-1])

    def at(self, time: float) -> int:
        """Return the index of the last frame at or before a time [s]."""
        return max(int(np.searchsorted(self.times, time + 1e-9, side="right")) - 1, 0)

    def describe(self, k: int, plan: Plan) -> str:
        """Describe a frame: number of the step, limb, its two points and the phase."""
        number, phase = int(self.step[k]), int(self.phase[k])
        if phase == AT_REST:
            return f"stance {number} of {len(plan.steps)}"
        step = plan.steps[number]
        return (
            f"step {number + 1} of {len(plan.steps)}: limb {step.limb} "
            f"{step.from_point} → {step.to_point}, {PHASES[phase]}"
        )


def plan_frames(graph: StanceGraph, plan: Plan) -> Frames:
    """Return the frames of a plan at `STEP_TIME` a step."""
    walked = _walked(graph, plan)
    step, phase = walked.step.copy(), walked.phase.copy()
    step[-1], phase[[0, -1]] = len(plan.steps), AT_REST
    bases = walked.base_positions, walked.base_quaternions
    return Frames(walked.times, step, phase, *bases, walked.joint_positions)


def _walked(graph: StanceGraph, plan: Plan) -> Trajectory:
    """Return the trajectory of a plan whose steps all take `STEP_TIME`, regardless of limits."""
    parts = []
    for index in range(max(len(plan.steps), 1)):  # a plan without steps has no joint path
        path = plan.joint_path(index)
        # Accelerations scale with travel over time squared.
        shares = np.sqrt([segment.travel for segment in path.segments[1:-1]])
        timed = TimedPath(path, Durations.of_step(STEP_TIME).time_scalings(shares))
        stances = plan.stances[index : index + 2]
        parts.append(trajectory(graph.grasp_map, stances, timed, FRAME_TIME))
    return reduce(lambda before, after: after.after(before), parts)


def no_frames(limbs: int) -> Frames:
    """Return a single frame of a robot that no plan puts anywhere."""
    zero, joints = np.zeros(1, dtype=np.int64), np.zeros((1, limbs, 6))
    return Frames(np.zeros(1), zero, zero + AT_REST, np.zeros((1, 3)), np.eye(1, 4), joints)


def load_frames(path: str | Path, plan: Plan) -> Frames:
    """Read the frames of the execution of a plan that `mlivr-gym simulate` has recorded.

    Raises a `PlanError` if the file cannot be read, or belongs to another robot or a longer plan.
    """
    try:
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as data:
            arrays: dict[str, Any] = {field.name: data[field.name] for field in fields(Frames)}
    except Exception as error:  # NumPy, zipfile and zlib raise errors of many kinds
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise PlanError(f"cannot read simulation {str(path)!r}: {reason}") from None
    place, count = FieldPath(f"simulation {path_shown(path)}", PlanError), arrays["times"].size
    kinds = {
        "times": Numbers((count,)),
        "step": Numbers((count,), 0, len(plan.steps) - 1),
        "phase": Numbers((count,), 0, len(PHASES) - 1),
        "base_positions": Numbers((count, 3)),
        "base_quaternions": Numbers((count, 4)),
        "joint_positions": Numbers((count, plan.world.robot.limbs, 6)),
    }
    played = {name: kind.read(arrays[name], place.field(name)) for name, kind in kinds.items()}
    times, step, phase = (played.pop(name) for name in ("times", "step", "phase"))
    if not count or (np.diff(times) < 0.0).any():
        raise PlanError(f"simulation {path_shown(path)} has no times in order")
    return Frames(times - times[0], step.astype(np.int64), phase.astype(np.int64), **played)
