"""Feedforward of a trajectory: joint torques of the inverse dynamics, and grasp deflections.

The wrenches of the compliant grasps deflect them; the joints of the support limbs compensate the
deflection, so that the base stays on its path.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from mlivr_gym.arrays import Array
from mlivr_gym.motion.trajectory import FREE, Trajectory
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.inverse_dynamics import compute_inverse_dynamics

SAMPLES = 400
"""Number of intervals of a step on whose ends the inverse dynamics is evaluated; cubic splines
interpolate between them."""


def feedforward(robot: RobotSpec, physics: Physics, trajectory: Trajectory) -> tuple[Array, Array]:
    """Return feedforward torques [N m] and corrections of the joint angles [rad] along a step.

    Both have the shape (k, N, 6) of the trajectory. The torques are the inverse dynamics of the
    trajectory (feedforward of the computed torque, evaluated along the reference). The corrections
    map the deflection of each grasp to the joints by the pseudoinverse of the gripper's Jacobian.
    """
    coarse = trajectory.every(float(trajectory.times[-1]) / SAMPLES)
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
