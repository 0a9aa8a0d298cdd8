"""Reads measurements from the states and sensor data of a simulation."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.simulation.dynamics import AXES
from mlivr_gym.simulation.failures import Measured
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.recording import Peaks, Recording

HUGE = mujoco.mjMAXVAL
"""A state in which something is larger has diverged, as MuJoCo counts; so has one with NaN."""

RECORD_PERIOD = 0.02
"""Spacing of the samples that are kept [s]."""


class Instruments:
    """Where a model keeps what is measured, and how it is read.

    Attributes:
        model: The model of `dynamics.dynamics_spec`.
        mass: Mass of the robot [kg].
        base: Address of the base pose in the positions.
        joints: Addresses of the joint angles in the positions, shape (6 N,).
    """

    def __init__(self, model: mujoco.MjModel, limbs: int) -> None:
        """Look up the addresses of a robot with N limbs."""
        self.model, self._limbs = model, limbs
        self.mass = float(model.body_mass.sum())
        names = joint_names(limbs)
        self.base = int(model.joint("base").qposadr[0])
        self.joints: IntArray = np.array([int(model.joint(name).qposadr[0]) for name in names])
        self._speeds = np.array([int(model.joint(name).dofadr[0]) for name in names])
        self._torques = np.array([self._sensor(name) for name in names])
        self._wrenches = np.array(
            [[self._sensor(f"limb{i}/grasp/{axis}") for axis in AXES] for i in range(limbs)]
        )
        self._contact, self._velocity, self._momentum = (
            self._sensor(name) for name in ("contact", "velocity", "angular_momentum")
        )

    def _sensor(self, name: str) -> int:
        return int(self.model.sensor(name).adr[0])

    def measured(
        self, states: Array, sensors: Array, times: Array, trajectory: Trajectory, first: int
    ) -> Measured:
        """What n successive time steps measure.

        Args:
            states: Full states before each of them, n rows.
            sensors: Sensor data at each of them, n rows.
            times: Their times [s], shape (n,).
            trajectory: The trajectory that is followed.
            first: Index of the first of them on its time grid.
        """
        count = len(states)
        # MuJoCo resets a state that diverged, and its clock with it.
        on_time = np.abs(states[:, 0] - times) < 0.5 * self.model.opt.timestep
        finite: BoolArray = np.asarray((np.abs(states) < HUGE).all(axis=1) & on_time)
        # What a diverged state holds is not looked at; a failure is reported at the first of them.
        qpos, qvel = np.split(
            np.where(finite[:, None], states, 0.0)[:, 1 : 1 + self.model.nq + self.model.nv],
            [self.model.nq],
            1,
        )
        base = qpos[:, self.base : self.base + 7]
        there = slice(first, first + count)
        cosine = np.abs((base[:, 3:] * trajectory.base_quaternions[there]).sum(axis=1))
        cosine /= np.maximum(np.linalg.norm(base[:, 3:], axis=1), 1e-9)
        return Measured(
            times=times,
            joints=qpos[:, self.joints].reshape(count, self._limbs, 6),
            speeds=qvel[:, self._speeds].reshape(count, self._limbs, 6),
            torques=sensors[:, self._torques].reshape(count, self._limbs, 6),
            base=base,
            base_errors=np.linalg.norm(base[:, :3] - trajectory.base_positions[there], axis=1),
            base_angle_errors=2.0 * np.arccos(np.minimum(cosine, 1.0)),
            forces=sensors[:, self._wrenches[:, :3]],
            grasp_torques=sensors[:, self._wrenches[:, 3:]],
            velocity=sensors[:, self._velocity : self._velocity + 3],
            angular_momentum=sensors[:, self._momentum : self._momentum + 3],
            contacts=sensors[:, self._contact].astype(np.int64),
            finite=finite,
        )

    def recorded(
        self, measured: Measured, ended: int, step: int, phase: int
    ) -> tuple[Recording, Peaks]:
        """Samples every `RECORD_PERIOD` of the first `ended` time steps, and the peaks of all."""
        whole = measured._replace(
            **{name: array[:ended] for name, array in measured._asdict().items()}
        )
        recording = Recording(
            times=whole.times,
            step=np.full(ended, step),
            phase=np.full(ended, phase),
            joint_positions=whole.joints,
            joint_torques=whole.torques,
            base_positions=whole.base[:, :3],
            base_quaternions=whole.base[:, 3:],
            base_errors=whole.base_errors,
            base_angle_errors=whole.base_angle_errors,
            grasp_forces=whole.forces,
            grasp_torques=whole.grasp_torques,
            momenta=self.mass * whole.velocity,
            angular_momenta=whole.angular_momentum,
            contacts=whole.contacts,
        )
        peaks = Peaks(
            joint_torque=np.abs(whole.torques).max(axis=0),
            torque_rms=float(recording.torque_rms.max()),
            grasp_force=np.linalg.norm(whole.forces, axis=2).max(axis=0),
            grasp_torque=np.linalg.norm(whole.grasp_torques, axis=2).max(axis=0),
            base_error=float(whole.base_errors.max()),
            base_angle_error=float(whole.base_angle_errors.max()),
            joint_speed=float(np.abs(whole.speeds).max()),
        )
        timestep = self.model.opt.timestep
        stride = max(round(RECORD_PERIOD / timestep), 1)
        start = round(whole.times[0] / timestep)
        return recording.every(stride, -start % stride), peaks


def joint_names(limbs: int) -> list[str]:
    """Names of all joints of a robot, limb by limb."""
    return [f"limb{i}/joint{k}" for i in range(limbs) for k in range(1, 7)]
