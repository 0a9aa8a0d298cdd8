"""What a motion needs by the dynamics of the robot: torques of joints and wrenches of grasps.

With the robot in free fall, what accelerates it is the wrench of the grasps that hold: the base
rows of the inverse dynamics give that wrench, and the transposed Jacobians of the grasps what
torque the joints have to add.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.scene import compiled, robot_alone


class Needed(NamedTuple):
    """What m motions through the same k configurations need, of which n limbs hold."""

    torques: Array
    """Of the joints, shape (m, k, N, 6) [N m]."""
    wrenches: Array
    """Forces and torques of the grasps on the robot, in world axes, shape (m, k, n, 6) [N, N m]."""
    jacobians: Array
    """Of the grippers of the limbs that hold by their joints, in world axes, shape (k, n, 6, 6)."""


@lru_cache(maxsize=8)
def robot_model(robot: RobotSpec) -> mujoco.MjModel:
    """The robot alone, floating, as MuJoCo has it."""
    return compiled(robot_alone(robot))


def needed(
    robot: RobotSpec, holding: Sequence[int], positions: Array, speeds: Array, accelerations: Array
) -> Needed:
    """What motions need.

    Where several limbs hold, they share the wrench such that the sum of its squares is least.

    Parameters
    ----------
    robot
        The robot.
    holding
        Limbs that hold, n of them.
    positions
        Base position, base quaternion and joints, shape (k, 7 + 6 N) [m, rad].
    speeds
        Of each motion, linear velocity of the base in the world, angular in the base's
        axes, and of the joints, shape (m, k, 6 + 6 N) [m/s, rad/s].
    accelerations
        Their derivatives, shape (m, k, 6 + 6 N) [m/s^2, rad/s^2].
    """
    model, count = robot_model(robot), len(positions)
    data = mujoco.MjData(model)
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
    shares = np.linalg.solve(base.swapaxes(1, 2) @ base, forces[:, :, :6, None])
    wrench = (base @ shares)[..., 0]
    torques = forces[..., 6:] - (wrench[:, :, None] @ stacked[..., 6:])[:, :, 0]
    joints = [jacobians[:, n, :, 6 + 6 * i : 12 + 6 * i] for n, i in enumerate(holding)]
    return Needed(
        torques.reshape(*torques.shape[:2], robot.limbs, 6),
        wrench.reshape(*wrench.shape[:2], len(sites), 6),
        np.stack(joints, axis=1),
    )
