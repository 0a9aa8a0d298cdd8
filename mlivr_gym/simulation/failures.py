"""Tells at which time step a simulation failed, and why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.instruments import Measured
from mlivr_gym.simulation.recording import Failure, Recording

AT_LIMIT = 0.999
"""A torque above this share of its limit counts as at the limit."""


class FailureWatch:
    """Looks for the first failure of one step of a walk."""

    def __init__(self, physics: Physics, robot: RobotSpec, step: int) -> None:
        """Watch step `step` of a robot's walk."""
        self.physics, self.limits, self.step = physics, robot.joint_limits, step
        self._torques: Array = robot.torque_limits
        self._run: IntArray = np.zeros((robot.limbs, 6), dtype=np.int64)

    def first(
        self, measured: Measured, phase: str, held: Sequence[bool]
    ) -> tuple[int, Failure] | None:
        """The first time step, by index, at which something failed, and what; None if nothing did.

        Parameters
        ----------
        measured
            Time steps that follow those of the last call.
        phase
            Their phase.
        held
            Which limbs hold.
        """
        recording, finite = measured.recording, measured.finite
        touching = recording.contacts > 0
        found: list[_Found] = []
        if not finite.all():
            found.append((int(np.argmin(finite)), "divergence", -1, "the simulation diverged", {}))
        if touching.any():
            index, told = int(np.argmax(touching)), "the robot touches something"
            found.append((index, "collision", -1, told, {}))
        found += [*self._overloaded(recording, held), *self._out_of_range(recording)]
        if not found:
            return None
        index, kind, limb, message, values = min(found, key=lambda entry: entry[0])
        time = float(recording.times[index])
        return index, Failure(kind, time, self.step, phase, limb, message, values)

    def _overloaded(self, recording: Recording, held: Sequence[bool]) -> Iterator[_Found]:
        """Grasps that do not hold."""
        for limb in np.flatnonzero(held).tolist():
            for name, unit, wrench, most in (
                ("force", "N", recording.grasp_forces, self.physics.hold_force),
                ("torque", "N m", recording.grasp_torques, self.physics.hold_torque),
            ):
                size = np.linalg.norm(wrench[:, limb], axis=1)
                if (size > most).any():
                    index = int(np.argmax(size > most))
                    value, key = float(size[index]), f"{name}_{unit.replace(' ', '_')}"
                    message = (
                        f"limb {limb} lost its hold: {name} of {value:.1f} {unit}; "
                        f"it holds {most:g} {unit}"
                    )
                    values = {key: value, f"allowed_{key}": most}
                    yield index, "lost hold", limb, message, values

    def _out_of_range(self, recording: Recording) -> Iterator[_Found]:
        """Joints at their torque limits for too long, or outside their position limits."""
        at_limit = np.abs(recording.joint_torques) >= AT_LIMIT * self._torques
        # Length of the run at the limit that ends at each time step.
        index = np.arange(1, len(at_limit) + 1)[:, None, None]
        start = np.maximum.accumulate(np.where(at_limit, 0, index), axis=0)
        run = np.where(start == 0, index + self._run, index - start)
        self._run = run[-1]
        allowed = self.physics.saturation_time
        for k, limb, joint in np.argwhere(run * self.physics.timestep > allowed)[:1].tolist():
            message = (
                f"joint {joint + 1} of limb {limb} has been at its torque limit of "
                f"{self._torques[limb, joint]:g} N m for longer than {allowed:g} s"
            )
            torque = float(recording.joint_torques[k, limb, joint])
            values = {"joint": joint + 1.0, "torque_N_m": torque, "allowed_time_s": allowed}
            yield k, "saturation", limb, message, values
        joints, limits = recording.joint_positions, self.limits
        excess = np.maximum(limits[..., 0] - joints, joints - limits[..., 1])
        for k, limb, joint in np.argwhere(excess > self.physics.limit_margin)[:1].tolist():
            angle = float(joints[k, limb, joint])
            message = (
                f"joint {joint + 1} of limb {limb} is at {np.rad2deg(angle):.1f} deg, "
                "outside its limits"
            )
            yield k, "joint limit", limb, message, {"joint": joint + 1.0, "angle_rad": angle}


_Found = tuple[int, str, int, str, dict[str, float]]
