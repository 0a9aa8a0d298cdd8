"""Guidance of the approach by a sensor on the gripper (position-based visual servoing).

The sensor measures the pose of the point relative to the gripper, with noise. A low-pass filter of
the error, a proportional gain and the inverse Jacobian of the limb move the joint references.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.controller import ControllerParameters
from mlivr_gym.simulation.disturbances import Disturbance
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.grippers import Grippers, displacement
from mlivr_gym.simulation.inverse_dynamics import robot_model
from mlivr_gym.simulation.joint_controller import JointController

CLOSE_POSITION, CLOSE_ANGLE = 0.001, float(np.deg2rad(0.4))
"""Errors in position [m] and angle [rad] below which the gripper is close to its point."""

REST_SPEEDS = 0.004, 0.01
"""Linear and angular speed below which the gripper counts as at rest [m/s, rad/s]."""

PATIENCE = 6.0
"""Longest time for which a gripper waits at the end of its approach until it is close and at rest,
in time constants of the guidance."""

FILTER_MEMORY = 0.8
"""Weight of the previous error in the low-pass filter, at each reading of the sensor."""

MAX_CHANGE = 0.01
"""Upper bound of the change of a joint reference at one reading [rad]."""


class Guidance:
    """Guidance of one limb to one point."""

    def __init__(
        self,
        robot: RobotSpec,
        parameters: ControllerParameters,
        disturbance: Disturbance,
        grippers: Grippers,
        controller: JointController,
    ) -> None:
        """Prepare the guidance of the limbs of a simulated robot."""
        self._parameters, self._grippers, self._controller = parameters, grippers, controller
        self._model = robot_model(robot)
        self._planned = mujoco.MjData(self._model)
        self._noise = np.repeat(
            [disturbance.ranges.sensor_position, disturbance.ranges.sensor_angle], 3
        )
        self._rng = np.random.default_rng([disturbance.seed, 2])
        self._filtered: Array | None = None

    def start(self, limb: int, point: int) -> None:
        """Start to guide a limb to a point, given by its index."""
        self._limb, self._point, self._filtered = limb, point, None

    @property
    def is_close(self) -> bool:
        """Whether the measured error is small and the gripper is at rest.

        A grasp stops a gripper at once through its damper. The motion of the gripper relative to
        the points held therefore counts, which includes the slow oscillation of the robot on its
        support limbs.
        """
        if self._filtered is None:
            return False
        away, turned = np.linalg.norm(self._filtered[:3]), np.linalg.norm(self._filtered[3:])
        moves, turns = self._grippers.relative_speed(self._limb, self._controller.speeds)
        found = np.array([away, turned, moves, turns])
        return bool((found < (CLOSE_POSITION, CLOSE_ANGLE, *REST_SPEEDS)).all())

    def correct(self, trajectory: Trajectory, k: int) -> None:
        """Read the sensor at index `k` of the time grid and move the limb's joint references."""
        error = self._error(trajectory, k) + self._noise * self._rng.standard_normal(6)
        filtered = (
            error
            if self._filtered is None
            else FILTER_MEMORY * self._filtered + (1.0 - FILTER_MEMORY) * error
        )
        self._filtered = filtered
        fraction = self._parameters.guidance * self._parameters.sensor_period
        first = 6 * self._limb
        jacobian = self._grippers.jacobian(self._limb)[:, 6 + first : 12 + first]
        change = fraction * np.linalg.lstsq(jacobian, filtered)[0]
        change *= min(1.0, MAX_CHANGE / max(float(np.abs(change).max()), 1e-12))
        self._controller.offset[first : first + 6] += change

    def _error(self, trajectory: Trajectory, k: int) -> Array:
        """Return displacement and rotation from the gripper to its reference, (6,) [m, rad]."""
        data, site = self._planned, self._model.site(f"limb{self._limb}/grasp").id
        data.qpos[:] = np.concatenate([part.ravel() for part in trajectory.configuration(k)])
        mujoco.mj_kinematics(self._model, data)
        reference = self._grippers.displaced_pose(
            self._point, data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
        )
        return displacement(self._grippers.pose(self._limb), reference)
