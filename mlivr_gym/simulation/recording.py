"""Records of a simulation: measurements, captures and failures, and the intervals they are of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.motion.timed_configurations import TimedConfigurations

FAILURES = (
    "missed grasp", "refused grasp", "blocked path", "saturation", "collision", "lost hold",
    "joint limit", "divergence", "no swing",
)  # fmt: skip
"""Kinds of failure.

* `"missed grasp"`: at the end of the approach the gripper is too far from its point, or turned.
* `"refused grasp"`: the gripper is at its point, but nothing can be grasped there.
* `"blocked path"`: the limb turned back, since something new was seen on its path, or since it
  would touch something with the robot as far off its trajectory as it is.
* `"saturation"`: the torque of a joint was at its limit for too long.
* `"collision"`: two shapes touch.
* `"lost hold"`: a grasp was loaded with more than it holds.
* `"joint limit"`: a joint left its limits.
* `"divergence"`: the state is no longer finite.
* `"no swing"`: nothing was simulated, because no swing or no trajectory of the step was found; only
  steps that are chosen one by one, see `step_executor`, fail in this way.
"""


@dataclass(frozen=True)
class Failure:
    """The failure that ended an execution."""

    kind: str
    """Kind of failure, one of `FAILURES`."""
    time: float
    """Time of the failure [s]."""
    step: int
    """Index of the step."""
    phase: str
    """Name of the phase, one of `joint_path.PHASES`."""
    limb: int
    """Index of the limb concerned, -1 if none is."""
    message: str
    """The failure in one sentence with its numbers."""
    values: dict[str, float]
    """Measured and allowed values by name, with units in the names."""

    def to_dict(self) -> dict[str, Any]:
        """Return the failure as plain data for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Capture:
    """The capture of a point by a limb: a grasp that was established in simulation."""

    time: float
    """Time of the capture [s]."""
    step: int
    """Index of the step."""
    limb: int
    """Index of the limb."""
    point: str
    """Id of the point."""
    distance: float
    """Distance between gripper and point just before [m]."""
    angle: float
    """Angle between gripper and grasp just before, modulo half turns about the normal [rad]."""


@dataclass(frozen=True)
class Recording(TimedConfigurations):
    """Measurements of a simulation at k times since its reset."""

    joint_torques: Array
    """Motor torques, shape (k, N, 6) [N m]."""
    base_errors: Array
    """Distance of the base from its planned position, shape (k,) [m]."""
    base_angle_errors: Array
    """Angle of the base from its planned orientation, shape (k,) [rad]."""
    grasp_forces: Array
    """Force of each grasp on its gripper, in the axes of the anchor (`dynamics`), shape (k, N, 3)
    [N]; 0 while the limb holds nothing."""
    grasp_torques: Array
    """Torque of each grasp on its gripper, in the same axes, shape (k, N, 3) [N m]."""
    module_forces: Array
    """Force of all grasps together on the module, in the world, shape (k, 3) [N]."""
    module_torques: Array
    """Torque of all grasps together on the module about the origin of the world, shape (k, 3)
    [N m]."""
    momenta: Array
    """Linear momentum of the robot, shape (k, 3) [kg m/s]."""
    angular_momenta: Array
    """Angular momentum about the centre of mass, shape (k, 3) [kg m^2/s]."""
    contacts: IntArray
    """Number of contacts of the robot, of which a grasp is none, shape (k,)."""

    @property
    def torque_rms(self) -> Array:
        """Root mean square over all joint torques, shape (k,) [N m]; the paper's last figure."""
        rms: Array = np.sqrt((self.joint_torques**2).mean(axis=(1, 2)))
        return rms


@dataclass(frozen=True)
class Peaks:
    """Maxima over all time steps, including those between the samples of a recording."""

    joint_torque: Array
    """Torque of each joint, shape (N, 6) [N m]."""
    torque_rms: float
    """Root mean square over all joint torques [N m]."""
    grasp_force: Array
    """Force of each grasp, shape (N,) [N]."""
    grasp_torque: Array
    """Torque of each grasp, shape (N,) [N m]."""
    base_error: float
    """Distance between the base and its trajectory [m]."""
    base_angle_error: float
    """Angle between the base and its trajectory [rad]."""

    @classmethod
    def of(cls, recording: Recording) -> Peaks:
        """Return the peaks of a recording of every time step."""
        return cls(
            joint_torque=np.abs(recording.joint_torques).max(axis=0),
            torque_rms=float(recording.torque_rms.max()),
            grasp_force=np.linalg.norm(recording.grasp_forces, axis=2).max(axis=0),
            grasp_torque=np.linalg.norm(recording.grasp_torques, axis=2).max(axis=0),
            base_error=float(recording.base_errors.max()),
            base_angle_error=float(recording.base_angle_errors.max()),
        )

    @classmethod
    def join(cls, parts: Sequence[Peaks]) -> Peaks:
        """Return the maxima over several peaks."""
        values: dict[str, Any] = {}
        for field in fields(cls):
            largest = np.max([getattr(part, field.name) for part in parts], axis=0)
            values[field.name] = largest if largest.ndim else float(largest)
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """Return the peaks as plain data for JSON."""
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in asdict(self).items()
        }


class SimulatedInterval(NamedTuple):
    """Measurements of an interval of the simulation: a regrasp, or a time of standing still."""

    recording: Recording
    """Samples of the measurements."""
    peaks: Peaks
    """Maxima over all time steps."""
    captures: tuple[Capture, ...] = ()
    """The capture of the point; empty if it was not captured, several after several regrasps."""
    failure: Failure | None = None
    """The failure of the step, or None."""
    has_turned_back: bool = False
    """Whether the limb turned back, since its path was blocked; the failure may be on its way."""

    def after(self, *before: SimulatedInterval) -> SimulatedInterval:
        """Return this interval with the measurements of those before it in front of its own."""
        parts = (*before, self)
        return self._replace(
            recording=Recording.join([part.recording for part in parts]),
            peaks=Peaks.join([part.peaks for part in parts]),
            captures=tuple(capture for part in parts for capture in part.captures),
        )
