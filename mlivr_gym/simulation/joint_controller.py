"""The joint controller: sampled PD control with feedforward, and guidance of the approach.

In every period the controller reads the encoders and commands each joint the torque

    tau = kp (q_ref - q) + kd (qdot_ref - qdot) + tau_ff,

saturated at the torque limit and held until the next period. `tau_ff` is the inverse dynamics of
the trajectory, see `feedforward`. `q_ref` is the trajectory plus an offset. At the beginning
of a step `align_references` sets the offset such that the references equal the encoder readings;
limbs that hold the same robot then do not work against each other. During departure and swing the
offset decays, so that errors do not accumulate over steps: that of the free limb, and the part of
the others that a motion of the base takes back, see `compatible_motions`. The rest of it would load
grasps against each other. During a guided approach the offset of the swing limb follows what a
sensor on the gripper measures of the point.

A reading that is late by `delay` makes a velocity gain unstable in a direction in which the inertia
is small. What multiplies kp (q_ref - q) + kd (qdot_ref - qdot) is then, in place of the identity,
the matrix

    (I + T kd A)^-1,    T = delay / `DELAY_SHARE`,

where A is the inverse inertia at the joints, see `inverse_inertia`, with T times its damping as the
inertia that a grasp adds to its gripper (an implicit step of length T). In each direction velocity
gain times delay is at most `DELAY_SHARE` of the inertia, and where that is large the gain is kd.

A support limb carries the whole robot, about 30 kg m^2 about its joints, and is damped by its
grasp. A free limb ends in a wrist of little more than its rotor inertia, 0.1 kg m^2. A sampled
derivative gain must stay below inertia over period, which is 50 N m s/rad for that wrist at 500 Hz.
Support limbs and free limbs therefore have different gains.

On a single support limb the robot oscillates slowly. Guiding the free limb pushes the base in the
opposite direction and excites this motion; shoulder and elbow of the support limb damp it. The
gripper waits until it is at rest relative to the points held, since a grasp that captures a moving
gripper loads it at once through its damper.

The wrenches of the compliant grasps deflect them; the joints of the support limbs compensate the
deflection, so that the base stays on its path.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.motion.trajectory import FREE, Trajectory
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.dynamics import SimulatedRobot
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.inverse_dynamics import (
    compatible_motions,
    compute_inverse_dynamics,
    inverse_inertia,
)
from mlivr_gym.simulation.parameters import ControllerParameters, Physics

DELAY_SHARE = 0.25
"""Bound of velocity gain times delay over inertia; an inertia alone is unstable above pi / 2."""

FEEDFORWARD_SAMPLES = 400
"""Number of intervals of a step on whose ends the inverse dynamics is evaluated; cubic splines
interpolate between them."""


class Reference(NamedTuple):
    """What all joints shall do at k times, ordered by limb: the input of the controller."""

    positions: Array
    """Joint angles, shape (k, 6 N) [rad]."""
    speeds: Array
    """Joint velocities, shape (k, 6 N) [rad/s]."""
    torques: Array
    """Feedforward torques, shape (k, 6 N) [N m]."""

    def at(self, indices: IntArray, sense: float = 1.0) -> Reference:
        """Return the reference at some indices; `sense` scales velocities, 0 for a rest there."""
        return Reference(
            self.positions[indices], sense * self.speeds[indices], self.torques[indices]
        )

    @classmethod
    def of(
        cls,
        trajectory: Trajectory,
        robot: RobotSpec,
        physics: Physics,
        controller: ControllerParameters,
    ) -> Reference:
        """Return the reference of a trajectory, with feedforward if the controller has it."""
        count = len(trajectory.times)
        positions, speeds = trajectory.joint_positions, trajectory.joint_velocities
        torques = np.zeros_like(positions)
        if controller.feedforward:
            torques, corrections = feedforward(robot, physics, trajectory)
            positions = positions + corrections
            speeds = speeds + np.gradient(corrections, trajectory.times, axis=0)
        return cls(*(array.reshape(count, -1) for array in (positions, speeds, torques)))


def feedforward(robot: RobotSpec, physics: Physics, trajectory: Trajectory) -> tuple[Array, Array]:
    """Return feedforward torques [N m] and corrections of the joint angles [rad] along a step.

    Both have the shape (k, N, 6) of the trajectory. The torques are the inverse dynamics of the
    trajectory (feedforward of the computed torque, evaluated along the reference). The corrections
    map the deflection of each grasp to the joints by the pseudoinverse of the gripper's Jacobian.
    """
    coarse = trajectory.every(float(trajectory.times[-1]) / FEEDFORWARD_SAMPLES)
    count, limbs = coarse.grasps.shape
    times, holding = coarse.times, np.flatnonzero(coarse.grasps[1] != FREE)

    def stacked(base: Array, of_joints: Array) -> Array:
        return np.column_stack([base, of_joints.reshape(count, -1)])

    base = np.column_stack([coarse.base_positions, coarse.base_quaternions])
    dynamics = compute_inverse_dynamics(
        robot,
        holding.tolist(),
        stacked(base, coarse.joint_positions),
        stacked(coarse.base_velocities, coarse.joint_velocities)[None],
        stacked(coarse.base_accelerations, coarse.joint_accelerations)[None],
    )
    deflections = _deflections(physics, dynamics.wrenches[0], float(times[1] - times[0]))
    corrections = np.zeros((count, limbs, 6))
    corrections[:, holding] = (np.linalg.pinv(dynamics.jacobians) @ deflections[..., None])[..., 0]
    rough = np.column_stack([dynamics.torques.reshape(count, -1), corrections.reshape(count, -1)])
    fine = CubicSpline(times, rough)(trajectory.times)
    both = fine.reshape(len(fine), 2, limbs, 6)
    return both[:, 0], both[:, 1]


def _deflections(physics: Physics, wrenches: Array, period: float) -> Array:
    """Return the deflections [m, rad] of initially relaxed grasps under wrenches, (k, n, 6).

    Each axis of a grasp is a spring parallel to a damper (Kelvin-Voigt model). It follows its load
    as a first-order lag with the time constant damping over stiffness, discretised for a load that
    is linear between two samples.
    """
    deflections = np.empty_like(wrenches)
    for rows, stiffness, damping in (
        (slice(0, 3), physics.grasp_stiffness, physics.grasp_damping),
        (slice(3, 6), physics.grasp_rotational_stiffness, physics.grasp_rotational_damping),
    ):
        constant = damping / stiffness
        decay = float(np.exp(-period / constant))
        mean = (1.0 - decay) * constant / period
        loads = -wrenches[..., rows] / stiffness
        deflections[..., rows], _ = lfilter(
            [1.0 - mean, mean - decay], [1.0, -decay], loads, axis=0, zi=(mean - 1.0) * loads[:1]
        )
    return deflections


class JointController:
    """Sampled control of the joints of a simulated robot.

    `offset` is added to the joint angles of every reference, shape (6 N,) [rad].
    """

    def __init__(self, simulated: SimulatedRobot) -> None:
        """Look up the motors of the joints, which have the same names, and start afresh."""
        model, self._data, self._robot, physics, controller, disturbance = simulated
        self._model, self._controller, self._ranges = model, controller, disturbance.ranges
        self._bias = disturbance.encoder_bias.ravel()
        self._rng = np.random.default_rng([disturbance.seed, 1])
        self._damping = np.repeat([physics.grasp_damping, physics.grasp_rotational_damping], 3)
        count, time_step = len(self._bias), model.opt.timestep
        self._motors: Array = np.array(
            [model.actuator(model.joint(k + 1).name).id for k in range(count)]
        )
        self._period = max(round(controller.period / time_step), 1)
        self._delay = round(disturbance.ranges.delay / time_step)
        self._known_delay = round(controller.delay / time_step)
        self.reset()

    def reset(self) -> None:
        """Set the offset of the references to zero and forget past readings and references."""
        count = len(self._bias)
        self.offset = np.zeros(count)
        self._past: deque[tuple[Array, Array]] = deque(maxlen=self._delay + 1)
        self._wanted: deque[tuple[Array, Array]] = deque(maxlen=self._known_delay + 1)
        self._ticks = 0

    def align_references(self, positions: Array) -> None:
        """Set the offset such that the references `positions` equal the encoder readings [rad]."""
        self.offset = self.readings - positions

    @property
    def readings(self) -> Array:
        """Present encoder readings without noise, shape (6 N,) [rad]."""
        readings: Array = self._data.qpos[7:] + self._bias
        return readings

    @property
    def speeds(self) -> Array:
        """Velocities of all joints at the last reading, shape (6 N,) [rad/s]."""
        return self._past[-1][1]

    def _offsets(self, count: int, held: Sequence[bool], recovering: bool) -> Array:
        """Return the offset at each of the next time steps, shape (1 or count, 6 N) [rad].

        What decays of it is what the limbs that hold can take back together, by moving the base.
        """
        if not recovering:
            return self.offset[None]
        decay = self._model.opt.timestep / self._controller.recovery
        free = compatible_motions(self._robot, np.flatnonzero(held).tolist(), self.readings)
        decaying = free @ self.offset
        lost = 1.0 - np.exp(-decay * np.arange(1, count + 1))
        offsets: Array = self.offset - lost[:, None] * decaying
        self.offset = offsets[-1].copy()
        return offsets

    def _share(self, kd: Array, held: Sequence[bool]) -> Array:
        """Return the matrix by which gains are reduced for the delay."""
        time, identity = self._controller.delay / DELAY_SHARE, np.eye(len(kd))
        if not time:
            return identity
        holding = np.flatnonzero(held).tolist()
        inverse = inverse_inertia(self._robot, holding, self.readings, time * self._damping)
        reduced = identity + time * kd[:, None] * inverse
        return np.linalg.inv(reduced).astype(np.float64)

    def run(
        self, reference: Reference, held: Sequence[bool], recovering: bool = False
    ) -> tuple[Array, Array]:
        """Follow a reference of k samples, one time step for each.

        Whether each limb holds a point chooses its gains; with `recovering` the offset of the
        references decays. Returned are, for each time step, the state before it (time, positions
        and velocities of MuJoCo in one row), and the sensor data that belong to that state.
        """
        model, data, controller = self._model, self._data, self._controller
        count, joint_count = reference.positions.shape
        states = np.empty((count, 1 + model.nq + model.nv))
        sensors = np.empty((count, model.nsensordata))
        noise = (
            self._ranges.encoder_noise * self._rng.standard_normal((count, joint_count))
            + self._bias
        )
        speed_noise = self._ranges.speed_noise * self._rng.standard_normal((count, joint_count))
        kp = np.ravel([controller.kp_hold if holds else controller.kp_free for holds in held])
        kd = np.ravel([controller.kd_hold if holds else controller.kd_free for holds in held])
        targets = reference.positions + self._offsets(count, held, recovering)
        share = self._share(kd, held)
        q, v, qpos, qvel, ctrl = data.qpos[7:], data.qvel[6:], data.qpos, data.qvel, data.ctrl
        positions, speeds = states[:, 1 : 1 + model.nq], states[:, 1 + model.nq :]
        for k in range(count):
            states[k, 0], positions[k], speeds[k] = data.time, qpos, qvel
            self._past.append((q + noise[k], v + speed_noise[k]))
            self._wanted.append((targets[k], reference.speeds[k]))
            if self._ticks % self._period == 0:
                (position, speed), (target, wanted) = self._past[0], self._wanted[0]
                error = kp * (target - position) + kd * (wanted - speed)
                ctrl[self._motors] = share @ error + reference.torques[k]
            self._ticks += 1
            mujoco.mj_step(model, data)
            sensors[k] = data.sensordata
        return states, sensors
