"""What a trajectory needs by the dynamics of the robot, to be fed forward to the controller.

The wrench of the grasps also bends them, which the joints of the limbs that hold make up for.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from mlivr_gym.arrays import Array
from mlivr_gym.motion.trajectory import FREE, Trajectory
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.inverse_dynamics import needed

SAMPLES = 400
"""Times in a step at which torques are worked out; cubic splines lie in between."""


def feedforward(robot: RobotSpec, physics: Physics, trajectory: Trajectory) -> tuple[Array, Array]:
    """Joint torques [N m] and changes of the joint positions [rad] along one step's trajectory.

    Both are of shape (k, N, 6).
    """
    coarse = trajectory.every(float(trajectory.times[-1]) / SAMPLES)
    count, limbs = coarse.grasps.shape
    times, holding = coarse.times, np.flatnonzero(coarse.grasps[1] != FREE)

    def beside(base: Array, joints: Array) -> Array:
        return np.column_stack([base, joints.reshape(count, -1)])

    base = np.column_stack([coarse.base_positions, coarse.base_quaternions])
    asked = needed(
        robot,
        holding.tolist(),
        beside(base, coarse.joint_positions),
        beside(coarse.base_velocities, coarse.joint_velocities)[None],
        beside(coarse.base_accelerations, coarse.joint_accelerations)[None],
    )
    bends = _bends(physics, asked.wrenches[0], float(times[1] - times[0]))
    shifts = np.zeros((count, limbs, 6))
    shifts[:, holding] = (np.linalg.pinv(asked.jacobians) @ bends[..., None])[..., 0]
    rough = np.column_stack([asked.torques.reshape(count, -1), shifts.reshape(count, -1)])
    fine = CubicSpline(times, rough)(trajectory.times)
    both = fine.reshape(len(fine), 2, limbs, 6)
    return both[:, 0], both[:, 1]


def _bends(physics: Physics, wrenches: Array, period: float) -> Array:
    """How far wrenches, shape (k, n, 6), bend grasps that start at rest [m, rad]."""
    bends = np.empty_like(wrenches)
    for rows, stiffness, damping in (
        (slice(0, 3), physics.grasp_stiffness, physics.grasp_damping),
        (slice(3, 6), physics.grasp_rotational_stiffness, physics.grasp_rotational_damping),
    ):
        # A spring beside a damper follows its load with the time constant damping / stiffness; the
        # load is taken to be linear between two times.
        constant = damping / stiffness
        kept = float(np.exp(-period / constant))
        mean = (1.0 - kept) * constant / period
        loads = -wrenches[..., rows] / stiffness
        bends[..., rows], _ = lfilter(
            [1.0 - mean, mean - kept], [1.0, -kept], loads, axis=0, zi=(mean - 1.0) * loads[:1]
        )
    return bends
