"""Measurements from the states and sensor data of a simulation, and the first failure in them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.motion.joint_path import PHASES
from mlivr_gym.motion.trajectory import Trajectory
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.dynamics import AXES
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.parameters import Physics
from mlivr_gym.simulation.recording import Failure, Peaks, Recording
from mlivr_gym.world.boxes import BOX

DIVERGENCE_LIMIT = mujoco.mjMAXVAL
"""A state with a larger value, or with NaN, has diverged; the bound is MuJoCo's own."""

RECORD_PERIOD = 0.02
"""Spacing of the recorded samples [s]."""

SATURATION_SHARE = 0.999
"""A joint torque above this share of its limit counts as saturated."""


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
    ) -> tuple[Recording, BoolArray]:
        """Return what is measured at n successive time steps, and whether each state is finite.

        `states` are n rows of `JointController.run` before each, `sensors` the data of each. Errors
        of the base are measured from the planned trajectory, on whose time grid the first has an
        index; `elapsed` time steps were before it since the reset. `step` is that of the recording.
        """
        count, samples = len(states), slice(first, first + len(states))
        times = np.arange(elapsed, elapsed + count, dtype=np.float64) * self.model.opt.timestep
        # MuJoCo resets a state that diverged, and its clock with it.
        on_time = np.abs(states[:, 0] - times) < 0.5 * self.model.opt.timestep
        finite: BoolArray = np.asarray((np.abs(states) < DIVERGENCE_LIMIT).all(axis=1) & on_time)
        # Values of a diverged state do not matter: a failure is reported at the first one.
        positions = np.where(finite[:, None], states, 0.0)[:, 1 : 1 + self.model.nq]
        base, joints = np.split(positions, [7], axis=1)
        cosine = np.abs((base[:, 3:] * trajectory.base_quaternions[samples]).sum(axis=1))
        cosine /= np.maximum(np.linalg.norm(base[:, 3:], axis=1), 1e-9)
        forces, torques = np.split(sensors[:, self._wrenches], [3], axis=2)
        recording = Recording(
            times=times,
            step=np.full(count, step),
            phase=np.full(count, int(trajectory.phase[first + 1])),
            joint_positions=joints.reshape(count, self._limbs, 6),
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
        return recording, finite

    def _on_module(self, forces: Array, torques: Array) -> dict[str, Array]:
        """Return force and torque on the module of grasp forces and torques, shape (n, N, 3)."""
        turn = Rotation.from_quat(self.model.body_quat[self._anchors], scalar_first=True)
        forces, torques = (
            np.einsum("iab,nib->nia", turn.as_matrix(), one) for one in (forces, torques)
        )
        about_origin = torques + np.cross(self.model.body_pos[self._anchors], forces)
        return {"module_forces": -forces.sum(axis=1), "module_torques": -about_origin.sum(axis=1)}

    def recorded(self, whole: Recording) -> tuple[Recording, Peaks]:
        """Return the samples of all time steps that are kept, and the peaks over all."""
        stride = max(round(RECORD_PERIOD / self.model.opt.timestep), 1)
        start = round(whole.times[0] / self.model.opt.timestep)
        return whole.part(slice(-start % stride, None, stride)), Peaks.of(whole)


_Event = tuple[int, str, int, str, dict[str, float]]
"""Index of a time step, and kind, limb, message and values of the failure."""


class FailureMonitor:
    """Detects the first failure of a step: in its motion, in a wait, or in a further approach."""

    def __init__(self, physics: Physics, robot: RobotSpec) -> None:
        """Monitor a step of a robot."""
        self.physics, self.limits = physics, robot.joint_limits
        self._torques: Array = robot.torque_limits
        self._saturated: IntArray = np.zeros((robot.limbs, 6), dtype=np.int64)

    def first_failure(self, recording: Recording, finite: BoolArray) -> tuple[int, Failure] | None:
        """Return the index of the first time step with a failure, and the failure, or None.

        The time steps are of one phase, follow those of the previous call, and have a state each
        that may be `finite`.
        """
        events: list[_Event] = []
        for kind, fails, message in (
            ("divergence", ~finite, "the simulation diverged"),
            ("collision", recording.contacts > 0, "the robot touches something"),
        ):
            if fails.any():
                events.append((int(np.argmax(fails)), kind, -1, message, {}))
        events += [*self._lost_holds(recording), *self._joint_failures(recording)]
        if not events:
            return None
        index, kind, limb, message, values = min(events, key=lambda entry: entry[0])
        time, step = float(recording.times[index]), int(recording.step[index])
        phase = PHASES[recording.phase[index]]
        return index, Failure(kind, time, step, phase, limb, message, values)

    def _lost_holds(self, recording: Recording) -> Iterator[_Event]:
        """Yield a failure for each grasp that is loaded beyond its strength."""
        for limb in range(recording.grasp_forces.shape[1]):
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
