"""Dynamics of the robot along a path segment, for any time scaling.

Without gravity, joint torques and grasp wrenches at path parameter sigma of a segment are
`a(sigma) sigma'' + b(sigma) sigma'^2` and velocities are `c(sigma) sigma'`, with derivatives by
time (Bobrow, Dubowsky and Gibson, International Journal of Robotics Research 4, 1985). One pass of
inverse dynamics over the segment gives the coefficients, which are stored in units of the limits.
For a time scaling of given shape, torques and wrenches are proportional to `1 / T^2` and velocities
to `1 / T`, so the shortest duration T is one number (dynamic scaling: Hollerbach, ASME Journal of
Dynamic Systems 106, 1984).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from mlivr_gym.arrays import Array
from mlivr_gym.motion.joint_path import PHASES, JointPath, PathSegment
from mlivr_gym.simulation.inverse_dynamics import compute_inverse_dynamics
from mlivr_gym.simulation.parameters import Limits

TIME_SAMPLES = 201
"""Number of regular times at which the loads during a time scaling are evaluated."""


def sampled_times(scaling: PPoly) -> Array:
    """Return the k times at which loads during a time scaling are evaluated, shape (k,) [s].

    They are regular ones, and the breakpoints, at which the acceleration has its extremes.
    """
    times: Array = np.union1d(np.linspace(0.0, scaling.x[-1], TIME_SAMPLES), scaling.x)
    return times


class Binding(NamedTuple):
    """The limit that determines the duration of a path segment."""

    duration: float
    """Shortest duration of the segment within all limits [s]."""
    limit: str
    """The limit: `"torque"`, `"grasp_force"`, `"grasp_torque"`, `"speed"` or `"surface_speed"`, as
    in `Limits`."""
    limb: int
    """Index of the limb."""
    joint: int
    """Number of the joint, from 1; 0 if the limit belongs to the gripper."""

    @property
    def description(self) -> str:
        """The limit with its joint and limb in words."""
        where = f"joint {self.joint} of limb {self.limb}" if self.joint else f"limb {self.limb}"
        return f"{self.limit} of {where}"


@dataclass(frozen=True)
class SegmentDynamics:
    """Coefficients of loads and velocities at K values of sigma, in units of the limits."""

    holding: tuple[int, ...]
    """The n support limbs."""
    limb: int
    """The limb that moves."""
    sigmas: Array
    """Path parameter of the segment, shape (K,)."""
    load_rates: Array
    """Joint torques, each as the first component of a vector, then forces, then torques of the
    grasps, by sigma'' and by sigma'^2, shape (K, 2, 6 N + 2 n, 3)."""
    speeds: Array
    """Velocities of the joints, then of the gripper on departure or approach, by sigma', (K, 6 N +
    1)."""

    def loads(self, scaling: PPoly) -> tuple[Array, Array]:
        """Return loads and speeds at the k `sampled_times` of a time scaling.

        In units of their limits, loads are magnitudes of joint torques, grasp forces and grasp
        torques, shape (k, 6 N + 2 n), and speeds have shape (k, 6 N + 1).
        """
        times = sampled_times(scaling)
        sigma, rate, change = (scaling(times, order)[:, None] for order in range(3))
        at = np.clip(sigma[:, 0], 0.0, 1.0)
        load_rates, speeds = np.split(self._curve(at), [-self.speeds.shape[1]], axis=1)
        by_change, by_square = load_rates.reshape(len(at), 2, -1, 3).swapaxes(0, 1)
        loads = change[..., None] * by_change + (rate**2)[..., None] * by_square
        return np.linalg.norm(loads, axis=2), np.abs(rate * speeds)

    @cached_property
    def _curve(self) -> CubicSpline:
        """Cubic spline of all coefficients."""
        rates = self.load_rates.reshape(len(self.sigmas), -1)
        return CubicSpline(self.sigmas, np.column_stack([rates, self.speeds]))

    def binding(self, scaling: PPoly) -> Binding:
        """Return the shortest duration of a time scaling of this shape, and its limit."""
        load, speed = (each.max(axis=0) for each in self.loads(scaling))
        factors = np.concatenate([np.sqrt(load), speed])
        joints = [divmod(k, 6) for k in range(len(speed) - 1)]
        limits = [("torque", limb, joint + 1) for limb, joint in joints]
        limits += [(kind, i, 0) for kind in ("grasp_force", "grasp_torque") for i in self.holding]
        limits += [("speed", limb, joint + 1) for limb, joint in joints]
        limits += [("surface_speed", self.limb, 0)]
        worst = int(np.argmax(factors))
        return Binding(float(scaling.x[-1]) * float(factors[worst]), *limits[worst])


def segment_dynamics(path: JointPath, segment: PathSegment, limits: Limits) -> SegmentDynamics:
    """Compute the dynamics along a segment of a joint path, in units of the limits.

    Raises a `RobotError` if the robot's masses are not known, see `RobotSpec.dynamics_of`.
    """
    robot, holding = path.robot, path.supports
    sigmas, count = segment.sigmas, len(segment.sigmas)
    positions = np.column_stack(
        [segment.base_positions, segment.base_quaternions, segment.joints.reshape(count, -1)]
    )
    first, second = segment.curve(sigmas, 1), segment.curve(sigmas, 2)
    at_rest = np.zeros_like(first)
    dynamics_of = compute_inverse_dynamics(
        robot, holding, positions, np.stack([at_rest, first]), np.stack([first, second])
    )
    speed = limits.speed * robot.speed_limits.reshape(-1)
    torques = dynamics_of.torques / (limits.torque * robot.torque_limits)
    forces, moments = np.split(dynamics_of.wrenches, [3], axis=-1)
    loads = np.concatenate(
        [
            torques.reshape(2, count, -1, 1) * [1.0, 0.0, 0.0],
            forces / limits.grasp_force,
            moments / limits.grasp_torque,
        ],
        axis=2,
    )
    # During departure and approach the gripper moves along the surface normal by the lift.
    normal_rate = robot.lift / limits.surface_speed if PHASES[segment.phase] != "swing" else 0.0
    speeds = np.column_stack([first[:, 6:] / speed, np.full(count, normal_rate)])
    return SegmentDynamics(holding, path.limb, sigmas, loads.swapaxes(0, 1), speeds)
