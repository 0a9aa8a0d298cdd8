"""What a motion needs by the dynamics of the robot: torques of joints and wrenches of grasps.

With the robot in free fall, what accelerates it is the wrench of the grasps that hold: the base
rows of the inverse dynamics give that wrench, and the transposed Jacobians of the grasps what
torque the joints have to add.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.scene import compiled, robot_alone


class Needed(NamedTuple):
    """What motions need at k configurations, of which n limbs hold."""

    torques: Array
    """Of the joints, shape (k, N, 6) [N m]."""
    wrenches: Array
    """Forces and torques of the grasps on the robot, in world axes, shape (k, n, 6) [N, N m]."""
    yields: Array
    """Change of the joints of a limb that holds by a small displacement of its gripper, in world
    axes, shape (k, n, 6, 6)."""


@lru_cache(maxsize=8)
def robot_model(robot: RobotSpec) -> mujoco.MjModel:
    """The robot alone, floating, as MuJoCo has it."""
    return compiled(robot_alone(robot))


def needed(
    robot: RobotSpec, holding: Sequence[int], positions: Array, speeds: Array, accelerations: Array
) -> Needed:
    """What motions need.

    Where several limbs hold, they share the wrench such that the sum of its squares is least.

    Args:
        robot: The robot.
        holding: Limbs that hold, n of them.
        positions: Base position, base quaternion and joints, shape (k, 7 + 6 N) [m, rad].
        speeds: Linear velocity of the base in the world, angular in the base's axes, and of the
            joints, shape (k, 6 + 6 N) [m/s, rad/s].
        accelerations: Their derivatives, shape (k, 6 + 6 N) [m/s^2, rad/s^2].
    """
    model, count = robot_model(robot), len(positions)
    data = mujoco.MjData(model)
    sites = [model.site(f"limb{i}/grasp").id for i in holding]
    forces = np.empty((count, model.nv))
    jacobians = np.empty((count, len(sites), 6, model.nv))
    for k in range(count):
        data.qpos[:], data.qvel[:], data.qacc[:] = positions[k], speeds[k], accelerations[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, forces[k])
        for n, site in enumerate(sites):
            mujoco.mj_jacSite(model, data, jacobians[k, n, :3], jacobians[k, n, 3:], site)
    # The rotors' inertia is no part of the bodies'.
    forces += model.dof_armature * accelerations
    stacked = jacobians.reshape(count, -1, model.nv)
    wrench = np.linalg.pinv(stacked[:, :, :6].swapaxes(1, 2)) @ forces[:, :6, None]
    torques = (forces[:, :, None] - stacked.swapaxes(1, 2) @ wrench)[:, 6:, 0]
    yields = [
        np.linalg.pinv(jacobians[:, n, :, 6 + 6 * limb : 12 + 6 * limb])
        for n, limb in enumerate(holding)
    ]
    return Needed(
        torques.reshape(count, robot.limbs, 6),
        wrench.reshape(count, len(sites), 6),
        np.stack(yields, axis=1),
    )
