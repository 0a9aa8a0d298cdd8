"""Arms as the library ssik describes them, and their solutions by it and by this package."""

import tempfile
from pathlib import Path

import numpy as np
from branches import arm_of, solutions
from scipy.spatial.transform import Rotation
from ssik.solvers.jointlock import seven_r

from mlivr_gym.robot.from_file import read_robot

HELD_ANGLE = 0.8
"""Angle of a joint that is locked [rad]."""

LIMIT = 6.2
"""Joint limit of every arm that is written as a file [rad]."""


def mjcf_of(arm):
    """An arm as an MJCF file, whose joints are named joint1 and so on."""

    def told(vector):
        return " ".join(repr(float(entry)) for entry in vector)

    joints = arm.kinbody.joints
    end = joints[-1].T_right
    quaternion = Rotation.from_matrix(end[:3, :3]).as_quat(scalar_first=True)
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>'
    text = f'<site name="tool0" pos="{told(end[:3, 3])}" quat="{told(quaternion)}"/>'
    for k in reversed(range(len(joints))):
        text = (
            f'<body name="link{k + 1}" pos="{told(joints[k].T_left[:3, 3])}">{inertial}'
            f'<joint name="joint{k + 1}" axis="{told(joints[k].axis)}" range="{-LIMIT} {LIMIT}" '
            f'actuatorfrcrange="-100 100"/><geom type="sphere" size="0.01"/>{text}</body>'
        )
    speeds = " ".join(["2"] * len(joints))
    return (
        f'<mujoco model="arm"><compiler angle="radian"/><custom><numeric name="speed_limits" '
        f'data="{speeds}"/></custom><worldbody><body name="base">{inertial}{text}</body>'
        "</worldbody></mujoco>"
    )


def read_arm(arm, held):
    """The robot of two arms, of which one joint is locked."""
    options = {} if held is None else {"locked_joint": f"joint{held}", "locked_angle": HELD_ANGLE}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "arm.xml")
        path.write_text(mjcf_of(arm), encoding="utf-8")
        return read_robot(path, **options)


def solutions_of_ssik(arm, held, pose):
    """The angles of all joints that ssik finds at a pose, shape (number, joints) [rad]."""
    if held is None:
        found = arm.solve(pose, respect_limits=False, allow_refinement=True)
    else:
        found, _ = seven_r.solve(
            arm.kinbody, pose, lock_idx=held - 1, lock_samples=[HELD_ANGLE], allow_refinement=True
        )
    return np.array([one.q for one in found]).reshape(-1, arm.dof)


def solutions_of_file(limb, held, pose):
    """The angles of all joints on the branches of a limb, shape (number, joints) [rad]."""
    _, found = solutions(arm_of(limb), pose[:3, 3], pose[:3, :3])
    found = found[np.isfinite(found[:, 0])]
    return found if held is None else np.insert(found, held - 1, HELD_ANGLE, axis=1)


def apart(some, others):
    """How far each solution is from the nearest of others, half turns at most [rad]."""
    turned = np.abs(np.angle(np.exp(1j * (some[:, None] - others[None])))).max(axis=-1)
    return turned.min(axis=1, initial=np.pi)
