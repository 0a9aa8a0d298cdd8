"""An arm of any six joints, which is solved numerically."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.joint_chain import (
    ALIGNED,
    EXACT,
    JointChain,
    RecognisedArm,
    are_parallel,
    flange_fault,
    foot,
    rounded,
    sign_of,
    tool_x,
)
from mlivr_gym.robot.link_frames import rigid
from mlivr_gym.robot.numeric_limb import NumericLimb

JOINTS = 6
"""Number of joints of such an arm."""


def any_six_joints(chain: JointChain) -> RecognisedArm | str:
    """Return the arm, or why it cannot be solved.

    The frame of each link lies at the file's zero, its origin as near to the one before as it may.
    """
    count = len(chain.names)
    if count != JOINTS:
        return f"it has {count} {'joint' if count == 1 else 'joints'}, not {JOINTS}"
    if are_parallel(chain, 4, 5):
        return f"the axes of joints {chain.names[4]!r} and {chain.names[5]!r} are parallel"
    wrist = foot(chain, 5, 4)
    off = flange_fault(chain, wrist)
    if off:
        return off
    signs = np.ones(JOINTS)
    shoulder = foot(chain, 0, 1) if not are_parallel(chain, 0, 1) else chain.anchors[0]
    signs[0] = sign_of(
        float((shoulder - chain.base[:3, 3]) @ chain.axes[0]),
        float(chain.base[:3, 2] @ chain.axes[0]),
    )
    out = float((chain.flange[:3, 3] - wrist) @ chain.axes[5])
    signs[5] = sign_of(out, float(chain.flange[:3, 2] @ chain.axes[5]))
    axes = signs[:, None] * chain.axes
    mount = _frame(tool_x(chain.base, axes[0]), axes[0], shoulder)
    base = float((chain.base[:3, 3] - shoulder) @ axes[0])
    mount[:3, 3] = shoulder + base * axes[0]
    frames = [mount, _frame(mount[:3, 0], axes[0], shoulder)]
    for k in range(1, 5):
        before = frames[-1]
        share = (before[:3, 3] - chain.anchors[k]) @ axes[k]
        origin = chain.anchors[k] + share * axes[k]
        if k == 1 and not are_parallel(chain, 0, 1):
            origin = foot(chain, 1, 0)
        x = np.cross(axes[k - 1], axes[k])
        size = float(np.linalg.norm(x))
        frames.append(_frame(x / size if size > ALIGNED else before[:3, 0], axes[k], origin))
    frames.append(_frame(tool_x(chain.flange, axes[5]), axes[5], chain.flange[:3, 3]))
    origins, quaternions = [], []
    for before, after in itertools.pairwise(frames):
        step = np.linalg.inv(before) @ after
        step[np.abs(step) < EXACT] = 0.0
        origins.append(tuple(rounded(part) for part in step[:3, 3]))
        quaternions.append(_quaternion(step[:3, :3]))
    fields: dict[str, Any] = {"origins": tuple(origins), "quaternions": tuple(quaternions)}
    try:
        NumericLimb(**fields, joint_limits=((-np.pi, np.pi),) * JOINTS)
    except RobotError as fault:
        return str(fault)
    return RecognisedArm(NumericLimb, fields, signs, np.zeros(JOINTS), mount)


def _frame(x: Array, z: Array, origin: Array) -> Array:
    """Return the frame of an origin, its z axis, and an x axis that is made to be across it."""
    across = x - (x @ z) * z
    across = across / np.linalg.norm(across)
    return rigid(np.stack([across, np.cross(z, across), z], axis=1), origin)


def _quaternion(rotation: Array) -> tuple[float, ...]:
    """Return the quaternion w, x, y, z of a rotation."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True)
    w, x, y, z = (turn + 0.0).tolist()
    return w, x, y, z
