"""Dynamics of the robot on its grasps: torques and wrenches of a motion, and inertia at the joints.

The robot floats without gravity, so the wrenches of the grasps alone accelerate it. The base rows
of the inverse dynamics (recursive Newton-Euler, MuJoCo's `mj_rne`) give the resultant wrench; the
joint rows minus the transposed Jacobians of the grasps times their wrenches give the joint torques.
Limbs that hold can only move together, see `compatible_motions`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from threading import get_ident
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.scene import compile_spec, robot_alone


class InverseDynamics(NamedTuple):
    """Inverse dynamics of m motions through the same k configurations on n support limbs."""

    torques: Array
    """Joint torques, shape (m, k, N, 6) [N m]."""
    wrenches: Array
    """Force and torque of each grasp on the robot, in world axes, shape (m, k, n, 6) [N, N m]."""
    jacobians: Array
    """Jacobian of each support gripper by the joints of its limb, in world axes, shape (k, n, 6,
    6)."""


@lru_cache(maxsize=8)
def robot_model(robot: RobotSpec) -> mujoco.MjModel:
    """Return the MuJoCo model of the robot alone, floating freely."""
    return compile_spec(robot_alone(robot))


def _model_and_data(robot: RobotSpec) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the model of the robot alone, and data of this thread as they are after a reset."""
    model, data = robot_model(robot), _data(robot, get_ident())
    mujoco.mj_resetData(model, data)
    return model, data


@lru_cache(maxsize=16)
def _data(robot: RobotSpec, thread: int) -> mujoco.MjData:
    """Return data of a thread; making them takes longer than what is done with them."""
    return mujoco.MjData(robot_model(robot))


def compute_inverse_dynamics(
    robot: RobotSpec, holding: Sequence[int], positions: Array, speeds: Array, accelerations: Array
) -> InverseDynamics:
    """Compute the inverse dynamics of m motions through the same k configurations.

    Several support limbs share the resultant wrench such that the sum of squares of all force and
    torque components is minimal; `holding` are their indices. Positions are base position, base
    quaternion w, x, y, z and joint angles, shape (k, 7 + 6 N) [m, rad]. Velocities of each motion,
    shape (m, k, 6 + 6 N), are linear of the base in the world frame, angular in the body frame, and
    of the joints [m/s, rad/s]; accelerations are their derivatives.
    """
    (model, data), count = _model_and_data(robot), len(positions)
    sites = [model.site(f"limb{i}/grasp").id for i in holding]
    forces = np.empty(speeds.shape)
    jacobians = np.empty((count, len(sites), 6, model.nv))
    for k in range(count):
        data.qpos[:] = positions[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for n, site in enumerate(sites):
            mujoco.mj_jacSite(model, data, jacobians[k, n, :3], jacobians[k, n, 3:], site)
        for motion, force in enumerate(forces[:, k]):
            data.qvel[:], data.qacc[:] = speeds[motion, k], accelerations[motion, k]
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 1, force)
    # The rotors' inertia is no part of the bodies'.
    forces += model.dof_armature * accelerations
    stacked = jacobians.reshape(count, -1, model.nv)
    base = stacked[:, :, :6]
    # A gripper that holds can put any wrench on the base, so the rows of these are independent.
    multipliers = np.linalg.solve(base.swapaxes(1, 2) @ base, forces[:, :, :6, None])
    wrench = (base @ multipliers)[..., 0]
    torques = forces[..., 6:] - (wrench[:, :, None] @ stacked[..., 6:])[:, :, 0]
    by_limb = [jacobians[:, n, :, 6 + 6 * i : 12 + 6 * i] for n, i in enumerate(holding)]
    return InverseDynamics(
        torques.reshape(*torques.shape[:2], robot.limbs, 6),
        wrench.reshape(*wrench.shape[:2], len(sites), 6),
        np.stack(by_limb, axis=1),
    )


def gripper_jacobian(model: mujoco.MjModel, data: mujoco.MjData, limb: int) -> Array:
    """Return the Jacobian of a gripper by base and joints, world axes, shape (6, 6 + 6 N)."""
    both = np.empty((6, model.nv))
    mujoco.mj_jacSite(model, data, both[:3], both[3:], model.site(f"limb{limb}/grasp").id)
    return both


def inverse_inertia(
    robot: RobotSpec, holding: Sequence[int], joints: Array, at_grasps: Array
) -> Array:
    """Return the inverse inertia at the joints of a robot that holds points, (6 N, 6 N).

    It maps joint torques to joint accelerations at rest [1/(kg m^2)]. Each gripper of the limbs
    `holding` carries an inertia that it has to move, for each axis of translation [kg] and rotation
    [kg m^2], shape (6,). Joint angles have shape (6 N,) [rad].
    """
    model, data = _model_and_data(robot)
    data.qpos[7:] = joints
    mujoco.mj_forward(model, data)
    inverse = np.empty((model.nv, model.nv))
    mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
    jacobians = [gripper_jacobian(model, data, limb) for limb in holding]
    stacked = np.array(jacobians).reshape(-1, model.nv)
    by_wrench = inverse @ stacked.T
    compliance = stacked @ by_wrench + np.diag(np.tile(1.0 / at_grasps, len(holding)))
    inverse -= by_wrench @ np.linalg.solve(compliance, by_wrench.T)
    return inverse[6:, 6:]


def compatible_motions(robot: RobotSpec, holding: Sequence[int], joints: Array) -> Array:
    """Return the projector on the joint motions that the grasps allow, shape (6 N, 6 N).

    Limbs that hold move together, as one motion of the base makes them; the others move at will.
    `holding` has one limb or more, and joint angles have shape (6 N,) [rad].
    """
    model, data = _model_and_data(robot)
    data.qpos[7:] = joints
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    by_base = np.zeros((len(joints), 6))
    free = np.ones(len(joints))
    for limb in holding:
        jacobian, of_limb = gripper_jacobian(model, data, limb), slice(6 * limb, 6 * limb + 6)
        by_base[of_limb] = -np.linalg.solve(jacobian[:, 6:][:, of_limb], jacobian[:, :6])
        free[of_limb] = 0.0
    basis, _ = np.linalg.qr(by_base)
    projector: Array = np.diag(free) + basis @ basis.T
    return projector
