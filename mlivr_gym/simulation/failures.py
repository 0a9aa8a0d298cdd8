"""Tells at which time step a simulation failed, and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.recording import Failure

AT_LIMIT = 0.999
"""A torque above this share of its limit counts as at the limit."""


class Measured(NamedTuple):
    """Every one of n successive time steps.

    Where nothing else is said, names, units and shapes are those of `Recording`.
    """

    times: Array
    joints: Array
    speeds: Array
    """Joint velocities, shape (n, N, 6) [rad/s]."""
    torques: Array
    base: Array
    """Base position and quaternion, shape (n, 7)."""
    base_errors: Array
    base_angle_errors: Array
    forces: Array
    grasp_torques: Array
    velocity: Array
    """Velocity of the centre of mass, shape (n, 3) [m/s]."""
    angular_momentum: Array
    contacts: IntArray
    finite: BoolArray
    """Whether the state is finite, shape (n,)."""


class FailureWatch:
    """Looks for the first failure of one step of a walk."""

    def __init__(self, physics: Physics, robot: RobotSpec, step: int) -> None:
        """Watch step `step` of a robot's walk."""
        self.physics, self.limits, self.step = physics, robot.limb.limits, step
        self._torques: Array = np.array(robot.limb_dynamics.torque_limits)
        self._run: IntArray | None = None

    def first(
        self, measured: Measured, phase: str, held: Sequence[bool]
    ) -> tuple[int, Failure] | None:
        """The first time step, by index, at which something failed, and what; None if nothing did.

        Args:
            measured: Time steps that follow those of the last call.
            phase: Their phase.
            held: Which limbs hold.
        """
        found = [
            *self._diverged(measured), *self._collision(measured), *self._lost_hold(measured, held),
            *self._saturation(measured), *self._joint_limit(measured),
        ]  # fmt: skip
        if not found:
            return None
        index, kind, limb, message, values = min(found, key=lambda entry: entry[0])
        return index, Failure(
            kind, float(measured.times[index]), self.step, phase, limb, message, values
        )

    def _diverged(self, measured: Measured) -> list[_Found]:
        if measured.finite.all():
            return []
        index = int(np.argmin(measured.finite))
        return [(index, "divergence", -1, "the simulation diverged", {})]

    def _collision(self, measured: Measured) -> list[_Found]:
        touching = np.flatnonzero(measured.contacts > 0)
        if not len(touching):
            return []
        return [(int(touching[0]), "collision", -1, "the robot touches something", {})]

    def _lost_hold(self, measured: Measured, held: Sequence[bool]) -> list[_Found]:
        found: list[_Found] = []
        for limb in np.flatnonzero(held).tolist():
            for name, unit, wrench, most in (
                ("force", "N", measured.forces, self.physics.hold_force),
                ("torque", "N m", measured.grasp_torques, self.physics.hold_torque),
            ):
                size = np.linalg.norm(wrench[:, limb], axis=1)
                over = np.flatnonzero(size > most)
                if len(over):
                    value = float(size[over[0]])
                    message = (
                        f"limb {limb} lost its hold: {name} of {value:.1f} {unit}; "
                        f"it holds {most:g} {unit}"
                    )
                    key = f"{name}_{unit.replace(' ', '_')}"
                    values = {key: value, f"allowed_{key}": most}
                    found.append((int(over[0]), "lost hold", limb, message, values))
        return found

    def _saturation(self, measured: Measured) -> list[_Found]:
        limits = self._torques
        at_limit = np.abs(measured.torques) >= AT_LIMIT * limits
        before = np.zeros(at_limit.shape[1:], dtype=np.int64) if self._run is None else self._run
        # Length of the run at the limit that ends at each time step.
        index = np.arange(1, len(at_limit) + 1)[:, None, None]
        start = np.maximum.accumulate(np.where(at_limit, 0, index), axis=0)
        run = np.where(start == 0, index + before, index - start)
        self._run = run[-1]
        allowed = self.physics.saturation_time
        over = np.argwhere(run * self.physics.timestep > allowed)
        if not len(over):
            return []
        k, limb, joint = over[0].tolist()
        message = (
            f"joint {joint + 1} of limb {limb} has been at its torque limit of "
            f"{limits[joint]:g} N m for longer than {allowed:g} s"
        )
        values = {
            "joint": float(joint + 1),
            "torque_N_m": float(measured.torques[k, limb, joint]),
            "allowed_time_s": allowed,
        }
        return [(k, "saturation", limb, message, values)]

    def _joint_limit(self, measured: Measured) -> list[_Found]:
        excess = np.maximum(
            self.limits[:, 0] - measured.joints, measured.joints - self.limits[:, 1]
        )
        over = np.argwhere(excess > self.physics.limit_margin)
        if not len(over):
            return []
        k, limb, joint = over[0].tolist()
        angle = float(measured.joints[k, limb, joint])
        message = (
            f"joint {joint + 1} of limb {limb} is at {np.rad2deg(angle):.1f} deg, "
            "outside its limits"
        )
        return [(k, "joint limit", limb, message, {"joint": float(joint + 1), "angle_rad": angle})]


_Found = tuple[int, str, int, str, dict[str, float]]
