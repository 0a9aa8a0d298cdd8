"""Detection of failures: the time step at which a simulated step failed, and the reason."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.instruments import Measurements
from mlivr_gym.simulation.recording import Failure, Recording
from mlivr_gym.world.boxes import BOX

SATURATION_SHARE = 0.999
"""A joint torque above this share of its limit counts as saturated."""


class FailureMonitor:
    """Detects the first failure of a step: in its motion, in a wait, or in a further approach."""

    def __init__(self, physics: Physics, robot: RobotSpec, step: int) -> None:
        """Monitor a step of `robot`; `step` is its index, for the failures."""
        self.physics, self.limits, self.step = physics, robot.joint_limits, step
        self._torques: Array = robot.torque_limits
        self._saturated: IntArray = np.zeros((robot.limbs, 6), dtype=np.int64)

    def first_failure(
        self, measurements: Measurements, phase: str, held: Sequence[bool]
    ) -> tuple[int, Failure] | None:
        """Return the index of the first time step with a failure, and the failure, or None.

        The time steps follow those of the previous call; `phase` is the name of theirs, and `held`
        whether each limb holds a point.
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
        angles, limits = recording.joint_positions, self.limits
        excess = np.maximum(limits[..., 0] - angles, angles - limits[..., 1])
        for k, limb, joint in np.argwhere(excess > self.physics.joint_limit_tolerance)[:1].tolist():
            angle = float(angles[k, limb, joint])
            message = (
                f"joint {joint + 1} of limb {limb} is at {np.rad2deg(angle):.1f} deg, "
                "outside its limits"
            )
            yield k, "joint limit", limb, message, {"joint": joint + 1.0, "angle_rad": angle}


def with_contact_names(failure: Failure, model: mujoco.MjModel, data: mujoco.MjData) -> Failure:
    """Return a collision failure with the names of the two geoms in contact."""
    if failure.kind != "collision" or not data.ncon:
        return failure
    contact = data.contact[int(np.argmin(data.contact.dist))]
    names = [model.geom(int(geom)).name for geom in contact.geom]
    robot = next(name for name in names if not name.startswith(BOX))
    limb = int(robot[4 : robot.index("/")]) if robot.startswith("limb") else -1
    message = f"{names[0]} and {names[1]} touch, {-1e3 * contact.dist:.2f} mm deep"
    return replace(failure, limb=limb, message=message, values={"depth_m": float(-contact.dist)})


_Event = tuple[int, str, int, str, dict[str, float]]
"""Index of a time step, and kind, limb, message and values of the failure."""
