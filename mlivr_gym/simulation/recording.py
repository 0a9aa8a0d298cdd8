"""What a simulation measured, and how it ended."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray

FAILURES = (
    "missed grasp", "saturation", "collision", "lost hold", "joint limit", "divergence", "no swing",
)  # fmt: skip
"""Kinds of failure.

`"no swing"` is that of an environment's step for which no swing was found.
"""


@dataclass(frozen=True)
class Failure:
    """Why a walk ended before its end.

    Attributes
    ----------
    kind
        One of `FAILURES`.
    time
        When [s].
    step
        Index of the step.
    phase
        One of `regrasp.PHASES`.
    limb
        The limb it concerns, -1 if it concerns none.
    message
        One sentence with the numbers.
    values
        The numbers by name, what was measured and what was allowed, units in the names.
    """

    kind: str
    time: float
    step: int
    phase: str
    limb: int
    message: str
    values: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """The failure as plain data for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Capture:
    """How a limb grasped a point.

    Attributes
    ----------
    time
        When [s].
    step
        Index of the step.
    limb
        The limb.
    point
        Id of the point.
    distance
        Distance of the gripper from the point just before [m].
    angle
        Angle between them, half turns apart [rad].
    tries
        Approaches that it took.
    """

    time: float
    step: int
    limb: int
    point: str
    distance: float
    angle: float
    tries: int = 1


@dataclass(frozen=True)
class Recording:
    """Measurements at k times.

    Attributes
    ----------
    times
        Shape (k,) [s].
    step
        Index of the step, shape (k,).
    phase
        Index into `regrasp.PHASES`, shape (k,).
    joint_positions
        Shape (k, N, 6) [rad].
    joint_torques
        Shape (k, N, 6) [N m].
    base_positions
        Shape (k, 3) [m].
    base_quaternions
        Shape (k, 4), w, x, y, z.
    base_errors
        Distance of the base from its trajectory, shape (k,) [m].
    base_angle_errors
        Angle between base and trajectory, shape (k,) [rad].
    grasp_forces
        Force of each grasp on its gripper, in the frame of the grasp, shape (k, N, 3)
        [N].
    grasp_torques
        Torque of each grasp on its gripper, in the frame of the grasp, shape (k, N,
        3) [N m].
    momenta
        Linear momentum of the robot, shape (k, 3) [kg m/s].
    angular_momenta
        Angular momentum about the centre of mass, shape (k, 3) [kg m^2/s].
    contacts
        Number of contacts of the robot, shape (k,).
    """

    times: Array
    step: IntArray
    phase: IntArray
    joint_positions: Array
    joint_torques: Array
    base_positions: Array
    base_quaternions: Array
    base_errors: Array
    base_angle_errors: Array
    grasp_forces: Array
    grasp_torques: Array
    momenta: Array
    angular_momenta: Array
    contacts: IntArray

    @property
    def torque_rms(self) -> Array:
        """Root mean square over all joints, shape (k,) [N m], as in the paper's last figure."""
        rms: Array = np.sqrt((self.joint_torques**2).mean(axis=(1, 2)))
        return rms

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def part(self, chosen: slice) -> Recording:
        """Some of the samples."""
        return Recording(**{name: array[chosen] for name, array in self.arrays().items()})

    @classmethod
    def join(cls, parts: list[Recording]) -> Recording:
        """Recordings one after the other."""
        return cls(
            **{
                field.name: np.concatenate([getattr(part, field.name) for part in parts])
                for field in fields(cls)
            }
        )


@dataclass(frozen=True)
class Peaks:
    """Largest values at any time step, also between the samples of a recording.

    Attributes
    ----------
    joint_torque
        Of each joint, shape (N, 6) [N m].
    torque_rms
        Root mean square over all joints [N m].
    grasp_force
        Of each grasp, shape (N,) [N].
    grasp_torque
        Of each grasp, shape (N,) [N m].
    base_error
        Distance of the base from its trajectory [m].
    base_angle_error
        Angle of the base from its trajectory [rad].
    joint_speed
        Of any joint [rad/s].
    """

    joint_torque: Array
    torque_rms: float
    grasp_force: Array
    grasp_torque: Array
    base_error: float
    base_angle_error: float
    joint_speed: float

    @classmethod
    def of(cls, recording: Recording, speeds: Array) -> Peaks:
        """Those of every time step; `speeds` are the joints', shape (k, N, 6) [rad/s]."""
        return cls(
            joint_torque=np.abs(recording.joint_torques).max(axis=0),
            torque_rms=float(recording.torque_rms.max()),
            grasp_force=np.linalg.norm(recording.grasp_forces, axis=2).max(axis=0),
            grasp_torque=np.linalg.norm(recording.grasp_torques, axis=2).max(axis=0),
            base_error=float(recording.base_errors.max()),
            base_angle_error=float(recording.base_angle_errors.max()),
            joint_speed=float(np.abs(speeds).max()),
        )

    @classmethod
    def join(cls, parts: list[Peaks]) -> Peaks:
        """The larger of each."""
        largest = {
            field.name: np.max([getattr(part, field.name) for part in parts], axis=0)
            for field in fields(cls)
        }
        values: dict[str, Any] = {
            name: value if value.ndim else float(value) for name, value in largest.items()
        }
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """The peaks as plain data for JSON."""
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in asdict(self).items()
        }
