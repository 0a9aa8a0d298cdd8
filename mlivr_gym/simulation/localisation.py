"""Localisation: where cameras see the robot, and joint references that bring it onto its path.

Cameras on body and grippers measure their poses in the module, with noise. From that follows what
encoders cannot tell: the constant error of each encoder, by least squares over all measurements
since the reset (kinematic calibration), and how far the gripper of a support limb is from where the
trajectory has it, since its point is displaced. The offset of the joint references that takes back
both moves the base on its trajectory nevertheless.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.motion.trajectory import FREE, Trajectory
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.disturbances import Disturbance
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.grippers import Grippers, displacement
from mlivr_gym.simulation.inverse_dynamics import gripper_jacobian, robot_model

ENCODER_ERROR = float(np.deg2rad(0.5))
"""Standard deviation of the error of an encoder that is assumed before any measurement [rad]."""

DEVIATIONS = np.repeat([0.007, np.deg2rad(0.7)], 3)
"""Standard deviations that are assumed of the pose of a gripper relative to the body [m, rad].

The first is mostly that of the angle of the body, some 0.8 m away.
"""

MEMORY = 100
"""Maximum number of measurements over which the displacement of a gripper is averaged."""


class Localisation:
    """Errors of encoders and displacements of support grippers, as measured since the reset."""

    def __init__(self, robot: RobotSpec, disturbance: Disturbance, grippers: Grippers) -> None:
        """Prepare the localisation of a simulated robot."""
        ranges, self._grippers, self._limbs = disturbance.ranges, grippers, robot.limbs
        self._noise = np.repeat([ranges.sensor_position, ranges.sensor_angle], 3)
        self._rng = np.random.default_rng([disturbance.seed, 5])
        self._model = robot_model(robot)
        self._read, self._planned = mujoco.MjData(self._model), mujoco.MjData(self._model)
        self._sites = [self._model.site(f"limb{limb}/grasp").id for limb in range(robot.limbs)]
        self.reset()

    def reset(self) -> None:
        """Forget all measurements."""
        self._information = np.tile(np.eye(6) / ENCODER_ERROR**2, (self._limbs, 1, 1))
        self._weighted = np.zeros((self._limbs, 6))
        self._points, self._counts = [FREE] * self._limbs, np.zeros(self._limbs)
        self._displacements = np.zeros((self._limbs, 6))

    @property
    def encoder_errors(self) -> Array:
        """Estimated encoder readings minus joint angles, shape (N, 6) [rad]."""
        errors = np.linalg.solve(self._information, self._weighted[..., None])[..., 0]
        return errors.astype(np.float64)

    def measure(self, base: Array, readings: Array, trajectory: Trajectory, k: int) -> None:
        """Measure the poses of body and grippers, which should be at index `k` of a trajectory.

        The base has a position and a quaternion w, x, y, z, shape (7,); `readings` of the encoders
        have shape (6 N,) [rad].
        """
        noise = self._noise * self._rng.standard_normal((1 + self._limbs, 6))
        read, planned = self._read, self._planned
        read.qpos[:7], read.qpos[7:] = base, readings
        read.qpos[:3] += noise[0, :3]
        mujoco.mju_quatIntegrate(read.qpos[3:7], noise[0, 3:], 1.0)
        planned.qpos[:] = np.concatenate([part.ravel() for part in trajectory.configuration(k)])
        for data in (read, planned):
            mujoco.mj_kinematics(self._model, data)
            mujoco.mj_comPos(self._model, data)
        for limb in range(self._limbs):
            rows = self._jacobian(read, limb) / DEVIATIONS[:, None]
            residual = (self._displacement(read, limb) + noise[1 + limb]) / DEVIATIONS
            self._information[limb] += rows.T @ rows
            self._weighted[limb] -= rows.T @ residual
            self._average(limb, self._displacement(planned, limb) + noise[1 + limb])

    def _average(self, limb: int, displaced: Array) -> None:
        """Take a displacement of a gripper into the average of the time since its grasp."""
        point = self._grippers.points[limb]
        if point != self._points[limb]:
            self._points[limb], self._counts[limb] = point, 0
        if point != FREE:
            self._counts[limb] = min(self._counts[limb] + 1, MEMORY)
            change = displaced - self._displacements[limb]
            self._displacements[limb] += change / self._counts[limb]

    def offset(self) -> Array:
        """Return the reference offset for which the base would follow its trajectory, (6 N,)."""
        offset = self.encoder_errors
        for limb, point in enumerate(self._points):
            if point != FREE:
                jacobian = self._jacobian(self._planned, limb)
                offset[limb] += np.linalg.lstsq(jacobian, self._displacements[limb])[0]
        return offset.ravel()

    def _displacement(self, data: mujoco.MjData, limb: int) -> Array:
        """Return displacement and rotation from a gripper in `data` to the simulated one, (6,)."""
        site = self._sites[limb]
        pose = data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
        return displacement(pose, self._grippers.pose(limb))

    def _jacobian(self, data: mujoco.MjData, limb: int) -> Array:
        """Return the Jacobian of a gripper by the joints of its limb, world axes, (6, 6)."""
        return gripper_jacobian(self._model, data, limb)[:, 6 + 6 * limb : 12 + 6 * limb]
