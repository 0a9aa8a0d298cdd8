"""What a trajectory needs by the dynamics of the robot, to be fed forward to the PD controller.

With the robot in free fall, what accelerates it is the wrench of the grasps that hold: the base
rows of the inverse dynamics give that wrench, and the transposed Jacobians of the grasps what
torque the joints have to add. The same wrench bends the grasps, which the joints of the limbs that
hold make up for.
"""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.motion.trajectory import FREE, Trajectory
from mlivr_gym.simulation.dynamics import Physics

SAMPLES = 1000
"""Times in a step at which torques are worked out; they are interpolated in between."""


def feedforward(
    model: mujoco.MjModel, physics: Physics, trajectory: Trajectory
) -> tuple[Array, Array]:
    """Joint torques [N m] and changes of the joint positions [rad] along a trajectory.

    Both are of shape (k, N, 6). Where several limbs hold, they share the wrench such that the sum
    of its squares is least.

    Args:
        model: The dynamic model of the robot, its free joint first.
        physics: Figures of the grasps.
        trajectory: Of one step.
    """
    coarse = trajectory.every(float(trajectory.times[-1]) / SAMPLES)
    count, limbs = coarse.grasps.shape
    holding = np.flatnonzero(coarse.grasps[1] != FREE)
    positions = np.column_stack(
        [coarse.base_positions, coarse.base_quaternions, coarse.joint_positions.reshape(count, -1)]
    )
    times = coarse.times
    # The free joint's velocities: linear in the world, angular in the body's frame.
    spin = _angular_velocity(coarse.base_quaternions, times)
    joints = np.gradient(coarse.joint_positions.reshape(count, -1), times, axis=0)
    speeds = np.column_stack([np.gradient(coarse.base_positions, times, axis=0), spin, joints])
    accelerations = np.gradient(speeds, times, axis=0)
    order = [
        int(model.joint(f"limb{i}/joint{k}").dofadr[0]) for i in range(limbs) for k in range(1, 7)
    ]
    dofs = np.concatenate([np.arange(6), order])
    sites = [model.site(f"limb{i}/grasp").id for i in holding]
    data = mujoco.MjData(model)
    forces, jacobians = np.empty((count, model.nv)), np.empty((count, len(sites), 6, model.nv))
    for k in range(count):
        data.qpos[np.append(np.arange(7), dofs[6:] + 1)] = positions[k]
        data.qvel[dofs], data.qacc[dofs] = speeds[k], accelerations[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, forces[k])
        for n, site in enumerate(sites):
            mujoco.mj_jacSite(model, data, jacobians[k, n, :3], jacobians[k, n, 3:], site)
    stacked = jacobians.reshape(count, -1, model.nv)
    wrench = np.linalg.pinv(stacked[:, :, :6].swapaxes(1, 2)) @ forces[:, :6, None]
    torques = (forces[:, :, None] - stacked.swapaxes(1, 2) @ wrench)[:, order, 0]
    bends = _bends(physics, wrench.reshape(count, len(sites), 6), float(times[1] - times[0]))
    shifts = np.zeros((count, limbs, 6))
    for n, limb in enumerate(holding):
        shifts[:, limb] = (
            np.linalg.pinv(jacobians[:, n][:, :, order[6 * limb : 6 * limb + 6]])
            @ bends[:, n, :, None]
        )[..., 0]
    place = np.interp(trajectory.times, times, np.arange(count))
    before = np.minimum(place.astype(np.int64), count - 2)
    share = (place - before)[:, None]
    rough = np.column_stack([torques, shifts.reshape(count, -1)])
    fine = (1.0 - share) * rough[before] + share * rough[before + 1]
    both = fine.reshape(len(fine), 2, limbs, 6)
    return both[:, 0], both[:, 1]


def _bends(physics: Physics, wrenches: Array, period: float) -> Array:
    """How far wrenches, shape (k, n, 6), bend grasps that start at rest [m, rad]."""
    bends = np.empty_like(wrenches)
    for rows, stiffness, damping in (
        (slice(0, 3), physics.grasp_stiffness, physics.grasp_damping),
        (slice(3, 6), physics.grasp_rotational_stiffness, physics.grasp_rotational_damping),
    ):
        # A spring beside a damper follows its load with the time constant damping / stiffness.
        kept = float(np.exp(-period * stiffness / damping))
        bends[..., rows] = lfilter(
            [1.0 - kept], [1.0, -kept], -wrenches[..., rows] / stiffness, axis=0
        )
    return bends


def _angular_velocity(quaternions: Array, times: Array) -> Array:
    """In the body's frame, shape (k, 3) [rad/s]."""
    rotations = Rotation.from_quat(quaternions, scalar_first=True)
    turned = (rotations[:-1].inv() * rotations[1:]).as_rotvec() / np.diff(times)[:, None]
    # Each rate belongs to the middle of its interval; the motion starts and ends at rest.
    inner = 0.5 * (turned[:-1] + turned[1:])
    return np.concatenate([turned[:1], inner, turned[-1:]])
