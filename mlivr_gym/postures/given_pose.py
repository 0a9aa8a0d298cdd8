"""Checks of a base pose and joint angles that the user gives for a stance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.contacts import Contact, contacts
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.kinematics.chain import LIMIT_TOLERANCE
from mlivr_gym.kinematics.limb import Angles, all_angles_at
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import FieldPath, Numbers
from mlivr_gym.values import MAX_LENGTH
from mlivr_gym.world.boxes import Box

JOINT_TOLERANCE = 0.02
"""Maximum deviation of given joint angles from those that hold the points [rad]."""

POSE = Numbers((7,), most=MAX_LENGTH, unit="m")
"""Validator of a base pose: position [m] and quaternion."""


def given_pose(pose: Any) -> tuple[float, ...]:
    """Check a base pose given by the user and return seven numbers, with a quaternion of length 1.

    They are x, y, z [m] and quaternion w, x, y, z in the world, also as a pair of position (3,) and
    quaternion (4,). Raises a `SettingError` if they are not seven finite numbers, or the
    quaternion's length differs from 1 by more than 1 %.
    """
    lists = (list, tuple, np.ndarray)
    pair = isinstance(pose, tuple) and len(pose) == 2
    pair = pair and all(isinstance(part, lists) and np.shape(part) != () for part in pose)
    place = FieldPath("start_pose (x, y, z [m], quaternion w, x, y, z)", SettingError)
    given = POSE.read([*pose[0], *pose[1]] if pair else pose, place)
    length = float(np.linalg.norm(given[3:]))
    if abs(length - 1.0) > 0.01:
        raise SettingError(
            f"start_pose has a quaternion {given[3:].tolist()} of length {length:.4g}; "
            f"its length must be 1"
        )
    return (*given[:3].tolist(), *(given[3:] / length).tolist())


def rotation_of(pose: Sequence[float]) -> Array:
    """Return the rotation matrix of a base pose of seven numbers, shape (3, 3)."""
    matrix: Array = scipy.spatial.transform.Rotation.from_quat(
        pose[3:], scalar_first=True
    ).as_matrix()
    return matrix


def given_joints(robot: RobotSpec, joints: Any) -> Array:
    """Check joint angles given by the user and return them by limb [rad], shape (N, 6).

    Raises a `SettingError` if they are not six finite numbers for each limb, inside the joint
    limits.
    """
    flat = isinstance(joints, list | tuple) and all(map(np.isscalar, joints))
    flat |= isinstance(joints, np.ndarray) and joints.ndim == 1
    shape = (6 * robot.limbs,) if flat else (robot.limbs, 6)
    place = FieldPath("start_joints (six angles for each limb [rad])", SettingError)
    given = Numbers(shape).read(joints, place).reshape(robot.limbs, 6)
    limits = robot.joint_limits
    outside = np.argwhere(
        (given < limits[..., 0] - LIMIT_TOLERANCE) | (given > limits[..., 1] + LIMIT_TOLERANCE)
    )
    if len(outside):
        limb, joint = outside[0]
        low, high = limits[limb, joint]
        raise SettingError(
            f"start_joints: joint {joint + 1} of limb {limb} is at {given[limb, joint]:.4f} rad, "
            f"outside its limits {low:.4f} to {high:.4f} rad"
        )
    return given


def branch_sets_of_joints(
    solver: PostureSolver, points: tuple[int, ...], posture: Postures, joints: Array
) -> tuple[int, ...]:
    """Return the branch and flip that each limb is on at joint angles (N, 6) [rad], as branch sets.

    `points` are the points of the limbs, and `posture` that of the stance at the given base pose.
    Raises a `StanceError` if the angles do not hold the points at that base pose, if a joint is
    outside its window, or if a limb may not hold on that branch.
    """
    branch_sets = []
    for limb, point in enumerate(points):
        name = solver.grasp_map.ids[point]
        solutions = branch_angles_at(solver, limb, point, posture)
        best, bit, worst = np.inf, 0, 0
        for b in range(16):
            if not np.isnan(solutions[b & 7]).any():
                error = joints[limb] - solutions[b & 7]
                error[5] -= np.pi * (b >> 3)
                error = np.abs(np.angle(np.exp(1j * error)))
                if error.max() < best:
                    best, bit, worst = float(error.max()), b, int(error.argmax())
        if best > JOINT_TOLERANCE:
            raise StanceError(
                f"start_joints of limb {limb} do not hold {name!r} at this base pose: joint "
                f"{worst + 1} is {best:.3f} rad off the nearest solution "
                f"(at most {JOINT_TOLERANCE:g} rad)"
            )
        _check_windings(solver.robot, limb, joints[limb])
        if not int(posture.branch_sets[0, limb]) >> bit & 1:
            raise StanceError(
                f"start_joints put limb {limb} on a branch on which it touches something or cannot "
                f"depart from {name!r}"
            )
        branch_sets.append(1 << bit)
    return tuple(branch_sets)


def _check_windings(robot: RobotSpec, limb: int, joints: Array) -> None:
    """Check that the joints of a limb, shape (6,) [rad], are in their windows.

    Raises a `StanceError` if a joint is outside its window.
    """
    low, high = robot.every_limb[limb].windows.T
    outside = np.flatnonzero((joints < low - JOINT_TOLERANCE) | (joints > high + JOINT_TOLERANCE))
    if len(outside):
        j = int(outside[0])
        raise StanceError(
            f"start_joints: joint {j + 1} of limb {limb} is at {joints[j]:.4f} rad, outside its "
            f"window {low[j]:.4f} to {high[j]:.4f} rad while the limb holds: rotate it by whole "
            f"turns first, or choose other window_starts for the robot"
        )


def branch_angles_at(solver: PostureSolver, limb: int, point: int, posture: Postures) -> Array:
    """Return the joint angles of each branch with which a limb holds a point at a posture [rad].

    They have shape (8, 6), with NaN for branches that do not exist.
    """
    out = Angles.rows(8)
    all_angles_at(
        solver.shapes.rows, limb, posture.base_rows[0], solver.grasps[point]["flange"], out
    )
    angles: Array = out["q"]
    return angles


def given_pose_fault(
    solver: PostureSolver, points: tuple[int, ...], posture: Postures, obstacles: Sequence[Box]
) -> str:
    """Explain why a robot cannot hold a stance at a given base pose.

    `obstacles` are boxes in addition to those of the map.
    """
    ids = solver.grasp_map.ids
    for limb, point in enumerate(points):
        if np.isnan(branch_angles_at(solver, limb, point, posture)).all():
            return f"limb {limb} does not reach point {ids[point]!r} from this base pose"
    stances: IntArray = np.array([points], dtype=np.int64)
    free = solver.at(stances, posture.base_position, posture.base_rotation, collisions=False)
    if not free.w_b[0] > 0.0:
        return (
            "at this base pose every combination of branches is singular or penetrates the robot "
            "itself"
        )
    if solver.settings.collisions:
        close = _closest(solver, points, free, obstacles)
        if close:
            return (
                f"at this base pose {close[0].first} is {close[0].distance:.3f} m from "
                f"{close[0].second}; {solver.settings.clearance:g} m are needed"
            )
    if free.branch_sets.all():
        return "at this base pose every branch on which the limbs could depart touches something"
    return (
        "at this base pose a limb could not depart along the surface normal with limb "
        f"manipulability above {solver.settings.path_floor:g} and with every joint in its window"
    )


def _closest(
    solver: PostureSolver, points: tuple[int, ...], posture: Postures, obstacles: Sequence[Box]
) -> list[Contact]:
    """Return the contacts on the branches of a posture, the closest first."""
    robot = solver.robot
    joints = np.full((robot.limbs, 6), np.nan)
    for limb, point in enumerate(points):
        joints[limb] = branch_angles_at(solver, limb, point, posture)[posture.branch[0, limb]]
    quaternion = scipy.spatial.transform.Rotation.from_matrix(posture.base_rotation[0]).as_quat(
        scalar_first=True
    )
    boxes = (*solver.grasp_map.boxes, *obstacles)
    rows = solver.grasps
    grasps = [(i, rows[p]["point"], rows[p]["normal"]) for i, p in enumerate(points)]
    here = (posture.base_position[0], quaternion, joints)
    return contacts(robot, boxes, here, solver.settings.clearance, grasps)
