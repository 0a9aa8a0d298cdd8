"""Measurements from the states and sensor data of a simulation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.simulation.dynamics import AXES
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.recording import Peaks, Recording

DIVERGENCE_LIMIT = mujoco.mjMAXVAL
"""A state with a larger value, or with NaN, has diverged; the bound is MuJoCo's own."""

RECORD_PERIOD = 0.02
"""Spacing of the recorded samples [s]."""


class Measurements(NamedTuple):
    """Measurements at n successive time steps."""

    recording: Recording
    """The recorded quantities."""
    speeds: Array
    """Joint velocities, shape (n, N, 6) [rad/s]."""
    finite: BoolArray
    """Whether the state is finite, shape (n,)."""


class Instruments:
    """What turns states and sensor data of a model of `dynamics.dynamics_spec` into measurements.

    `mass` is that of the robot [kg].
    """

    def __init__(self, model: mujoco.MjModel, limbs: int) -> None:
        """Look up where the sensors of a robot with N limbs write their data."""
        self.model, self._limbs = model, limbs
        self.mass = float(model.body_mass.sum())
        # The model has the free joint of the base, then those of the limbs in their order.
        joints = [self._sensor(model.joint(1 + k).name) for k in range(6 * limbs)]
        self._torques = np.array(joints).reshape(limbs, 6)
        self._wrenches = np.array(
            [[self._sensor(f"limb{i}/grasp/{axis}") for axis in AXES] for i in range(limbs)]
        )
        self._anchors = [model.body(f"limb{i}/anchor").id for i in range(limbs)]
        self._contact, self._velocity, self._momentum = (
            self._sensor(name) for name in ("contact", "velocity", "angular_momentum")
        )

    def _sensor(self, name: str) -> int:
        """Return the address of a sensor in the sensor data."""
        return int(self.model.sensor(name).adr[0])

    def measure(
        self,
        states: Array,
        sensors: Array,
        trajectory: Trajectory,
        first: int,
        elapsed: int,
        step: int,
    ) -> Measurements:
        """Return the measurements at n successive time steps of a step of the recording.

        `states` are n rows of `JointController.run` before each, `sensors` the data of each. Errors
        of the base are measured from the planned trajectory, on whose time grid the first has an
        index; `elapsed` time steps were before it since the reset.
        """
        count, samples = len(states), slice(first, first + len(states))
        times = np.arange(elapsed, elapsed + count, dtype=np.float64) * self.model.opt.timestep
        # MuJoCo resets a state that diverged, and its clock with it.
        on_time = np.abs(states[:, 0] - times) < 0.5 * self.model.opt.timestep
        finite: BoolArray = np.asarray((np.abs(states) < DIVERGENCE_LIMIT).all(axis=1) & on_time)
        # Values of a diverged state do not matter: a failure is reported at the first one.
        qpos, qvel = np.split(
            np.where(finite[:, None], states, 0.0)[:, 1 : 1 + self.model.nq + self.model.nv],
            [self.model.nq],
            1,
        )
        base = qpos[:, :7]
        cosine = np.abs((base[:, 3:] * trajectory.base_quaternions[samples]).sum(axis=1))
        cosine /= np.maximum(np.linalg.norm(base[:, 3:], axis=1), 1e-9)
        forces, torques = np.split(sensors[:, self._wrenches], [3], axis=2)
        recording = Recording(
            times=times,
            step=np.full(count, step),
            phase=np.full(count, int(trajectory.phase[first + 1])),
            joint_positions=qpos[:, 7:].reshape(count, self._limbs, 6),
            joint_torques=sensors[:, self._torques],
            base_positions=base[:, :3],
            base_quaternions=base[:, 3:],
            base_errors=np.linalg.norm(base[:, :3] - trajectory.base_positions[samples], axis=1),
            base_angle_errors=2.0 * np.arccos(np.minimum(cosine, 1.0)),
            grasp_forces=forces,
            grasp_torques=torques,
            **self._on_module(forces, torques),
            momenta=self.mass * sensors[:, self._velocity : self._velocity + 3],
            angular_momenta=sensors[:, self._momentum : self._momentum + 3],
            contacts=sensors[:, self._contact].astype(np.int64),
        )
        return Measurements(recording, qvel[:, 6:].reshape(count, self._limbs, 6), finite)

    def _on_module(self, forces: Array, torques: Array) -> dict[str, Array]:
        """Return force and torque on the module of grasp forces and torques, shape (n, N, 3)."""
        turn = Rotation.from_quat(self.model.body_quat[self._anchors], scalar_first=True)
        forces, torques = (
            np.einsum("iab,nib->nia", turn.as_matrix(), one) for one in (forces, torques)
        )
        about_origin = torques + np.cross(self.model.body_pos[self._anchors], forces)
        return {"module_forces": -forces.sum(axis=1), "module_torques": -about_origin.sum(axis=1)}

    def recorded(self, measurements: Measurements, ended: int) -> tuple[Recording, Peaks]:
        """Return samples and peaks of the first `ended` time steps.

        The samples are `RECORD_PERIOD` apart; the peaks are those over all time steps.
        """
        whole = measurements.recording.part(slice(ended))
        stride = max(round(RECORD_PERIOD / self.model.opt.timestep), 1)
        start = round(whole.times[0] / self.model.opt.timestep)
        peaks = Peaks.of(whole, measurements.speeds[:ended])
        return whole.part(slice(-start % stride, None, stride)), peaks
