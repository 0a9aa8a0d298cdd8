"""Speeds, torques and grasp wrenches of a trajectory by Pinocchio, from its positions alone."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from pinocchio_robots import pinocchio_robot
from scipy.spatial.transform import Rotation


class Loads(NamedTuple):
    """At the inner k samples of a trajectory, by central differences of its positions."""

    speeds: np.ndarray
    """Of the joints, shape (k, N, 6) [rad/s]."""
    torques: np.ndarray
    """Of the joints, shape (k, N, 6) [N m]."""
    wrenches: np.ndarray
    """Force and torque of the n grasps, of least squares, shape (k, n, 6) [N, N m]."""
    grippers: np.ndarray
    """Speeds of the grippers, shape (k, N) [m/s]."""
    momenta: np.ndarray
    """Linear momentum of the robot, shape (k, 3) [N s]."""


def loads_of(robot, walk, holding):
    """The loads of a trajectory, of which the limbs `holding` hold their points."""
    model = pinocchio_robot(robot)
    model.gravity.linear[:] = 0.0
    data, period, count = model.createData(), walk.times[1] - walk.times[0], len(walk.times)
    grasps = [model.getFrameId(f"grasp{i}") for i in range(robot.limbs)]
    turns = Rotation.from_quat(walk.base_quaternions, scalar_first=True)
    joints = walk.joint_positions.reshape(count, -1)
    positions = np.column_stack([walk.base_positions, turns.as_quat(), joints])
    back = turns[:-1].inv()
    shifts, rotations = back.apply(np.diff(walk.base_positions, axis=0)), (back * turns[1:])
    moved = np.column_stack([shifts, rotations.as_rotvec(), np.diff(joints, axis=0)])
    rates = moved / period  # between samples, in the axes of the base
    speeds, changes = 0.5 * (rates[1:] + rates[:-1]), np.diff(rates, axis=0) / period
    torques, wrenches, grippers, momenta = [], [], [], []
    for q, v, a in zip(positions[1:-1], speeds, changes, strict=True):
        needed = pin.rnea(model, data, q, v, a)
        momenta.append(pin.computeCentroidalMomentum(model, data, q, v).linear.copy())
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        jacobians = [
            pin.getFrameJacobian(model, data, one, pin.LOCAL_WORLD_ALIGNED) for one in grasps
        ]
        held = np.concatenate([jacobians[i] for i in holding])
        wrench = np.linalg.lstsq(held[:, :6].T, needed[:6], rcond=None)[0]
        torques.append(needed[6:] - held[:, 6:].T @ wrench)
        wrenches.append(wrench)
        grippers.append([np.linalg.norm(jacobian[:3] @ v) for jacobian in jacobians])
    shape = count - 2, robot.limbs, 6
    return Loads(
        speeds[:, 6:].reshape(shape),
        np.reshape(torques, shape),
        np.reshape(wrenches, (count - 2, -1, 6)),
        np.array(grippers),
        np.array(momenta),
    )
