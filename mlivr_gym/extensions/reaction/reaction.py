"""The reaction of a step: the force on the station that the planned motion needs.

Without gravity the grasps alone accelerate the robot, so that the force on the station is the
negative rate of change of the robot's linear momentum `m v`, with the velocity v of its centre of
mass. For a path and its time scaling both follow without a simulation; what the controller adds is
not part of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import trapezoid
from scipy.interpolate import CubicSpline

from mlivr_gym.arrays import Array
from mlivr_gym.motion import TimedPath
from mlivr_gym.motion.joint_path import PathSegment
from mlivr_gym.robot import RobotSpec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.inverse_dynamics import robot_model
from mlivr_gym.simulation.path_dynamics import sampled_times


class Reaction(NamedTuple):
    """Duration of a step, and the force that it exerts on the station."""

    seconds: float
    """Duration [s]."""
    impulse: float
    """Total impulse, the integral of the magnitude of the force over time [N s]."""
    peak_force: float
    """Largest magnitude of the force [N]."""


def reaction_of(timed: TimedPath) -> Reaction:
    """Return the reaction of a step with its time scalings."""
    robot, impulse, peak = timed.path.robot, 0.0, 0.0
    for segment, scaling in zip(timed.path.segments, timed.time_scalings, strict=True):
        times = sampled_times(scaling)
        sigma, rate, change = (scaling(times, order)[:, None] for order in range(3))
        curve = CubicSpline(segment.sigmas, _centres_of_mass(robot, segment))
        at = np.clip(sigma[:, 0], 0.0, 1.0)
        forces = robot_model(robot).body_mass.sum() * (
            curve(at, 2) * rate**2 + curve(at, 1) * change
        )
        magnitudes = np.linalg.norm(forces, axis=1)
        impulse += float(trapezoid(magnitudes, times))
        peak = max(peak, float(magnitudes.max()))
    return Reaction(timed.duration, impulse, peak)


def _centres_of_mass(robot: RobotSpec, segment: PathSegment) -> Array:
    """Return the robot's centre of mass at each of the k sigmas of a segment, shape (k, 3) [m]."""
    model = robot_model(robot)
    data, centres = mujoco.MjData(model), np.empty((len(segment.sigmas), 3))
    joints = segment.joints.reshape(len(centres), -1)
    positions = np.column_stack([segment.base_positions, segment.base_quaternions, joints])
    base = model.body("base").id
    for k, position in enumerate(positions):
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        centres[k] = data.subtree_com[base]
    return centres
