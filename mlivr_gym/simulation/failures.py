"""Detection of failures: the time step at which a simulated step failed, and the reason."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.instruments import Measurements
from mlivr_gym.simulation.recording import Failure, Recording

SATURATION_SHARE = 0.999
"""A joint torque above this share of its limit counts as saturated."""


class FailureMonitor:
    """Detects the first failure during one run of a step: its motion, a wait, or a second try."""

    def __init__(self, physics: Physics, robot: RobotSpec, step: int) -> None:
        """Monitor step number `step` of a walk of `robot`."""
        self.physics, self.limits, self.step = physics, robot.joint_limits, step
        self._torques: Array = robot.torque_limits
        self._saturated: IntArray = np.zeros((robot.limbs, 6), dtype=np.int64)

    def first_failure(
        self, measurements: Measurements, phase: str, held: Sequence[bool]
    ) -> tuple[int, Failure] | None:
        """Return the index of the first time step with a failure, and the failure, or None.

        Parameters
        ----------
        measurements
            Measurements of the time steps that follow those of the previous call.
        phase
            Name of their phase.
        held
            Whether each limb holds a point.
        """
        recording, finite = measurements.recording, measurements.finite
        touching = recording.contacts > 0
        events: list[_Event] = []
        if not finite.all():
            events.append((int(np.argmin(finite)), "divergence", -1, "the simulation diverged", {}))
        if touching.any():
            index, message = int(np.argmax(touching)), "the robot touches something"
            events.append((index, "collision", -1, message, {}))
        events += [*self._lost_holds(recording, held), *self._joint_failures(recording)]
        if not events:
            return None
        index, kind, limb, message, values = min(events, key=lambda entry: entry[0])
        time = float(recording.times[index])
        return index, Failure(kind, time, self.step, phase, limb, message, values)

    def _lost_holds(self, recording: Recording, held: Sequence[bool]) -> Iterator[_Event]:
        """Yield a failure for each grasp that is loaded beyond its strength."""
        for limb in np.flatnonzero(held).tolist():
            for name, unit, wrench, limit in (
                ("force", "N", recording.grasp_forces, self.physics.hold_force),
                ("torque", "N m", recording.grasp_torques, self.physics.hold_torque),
            ):
                size = np.linalg.norm(wrench[:, limb], axis=1)
                if (size > limit).any():
                    index = int(np.argmax(size > limit))
                    value, key = float(size[index]), f"{name}_{unit.replace(' ', '_')}"
                    message = (
                        f"limb {limb} lost its hold: {name} of {value:.1f} {unit}; "
                        f"it holds {limit:g} {unit}"
                    )
                    values = {key: value, f"allowed_{key}": limit}
                    yield index, "lost hold", limb, message, values

    def _joint_failures(self, recording: Recording) -> Iterator[_Event]:
        """Yield failures of joints: torque saturated for too long, or angle outside its limits."""
        at_limit = np.abs(recording.joint_torques) >= SATURATION_SHARE * self._torques
        # Number of consecutive saturated time steps up to each time step.
        index = np.arange(1, len(at_limit) + 1)[:, None, None]
        start = np.maximum.accumulate(np.where(at_limit, 0, index), axis=0)
        run = np.where(start == 0, index + self._saturated, index - start)
        self._saturated = run[-1]
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


_Event = tuple[int, str, int, str, dict[str, float]]
"""Index of a time step, and kind, limb, message and values of the failure."""
