"""The joints of a limb exactly as a file has them, which may deviate from its family a little.

The axes of a calibrated arm are neither quite parallel nor quite perpendicular. Plans are made with
the exact axes of its family, whose branches have a closed form. Where its flange is to be on a
branch, the arm of the file has angles close to those of the family, which Newton's method finds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.file_arms import FileArm, tool_frame_of
from mlivr_gym.robot.link_frames import inverse

STEPS = 12
"""Largest number of Newton's steps; three are usual."""

ACCURACY = 1e-11
"""Distance [m] and angle [rad] of a flange from where it is to be that counts as 0."""

FARTHEST = 0.1
"""Largest difference of an angle from that of the family [rad]; more is another solution."""


class FileChain(NamedTuple):
    """Joints of a limb that move, which MuJoCo moves as the file has them."""

    model: Any
    """The `mujoco.MjModel` of the file."""
    data: Any
    """Scratch, a `mujoco.MjData` of its own; a joint that is held has its angle there."""
    arm: FileArm
    """The joints."""
    base: Array
    """Base frame of the limb in the world, shape (4, 4)."""
    flange: Array
    """The flange, its axes those that the family has, in the tool frame of the file, (4, 4)."""

    def at(self, angles: Array) -> tuple[Array, Array, Array]:
        """Return axes and anchors [m], (6, 3) each, and flange (4, 4) at angles of the file [rad].

        All are in the base frame of the limb.
        """
        joints = list(self.arm.joints)
        self.data.qpos[self.model.jnt_qposadr[joints]] = angles
        mujoco.mj_kinematics(self.model, self.data)
        turn, anchors = self.base[:3, :3], self.data.xanchor[joints] - self.base[:3, 3]
        flange = inverse(self.base) @ tool_frame_of(self.data, self.arm) @ self.flange
        return self.data.xaxis[joints] @ turn, anchors @ turn, flange

    def solved(self, target: Array, angles: Array, names: Sequence[str]) -> Array:
        """Return the angles at which the flange is in a frame (4, 4), close to given ones (6,).

        Raises a `RobotError` with the names of the joints if there are none so close.
        """
        found = np.array(angles, dtype=np.float64)
        for _ in range(STEPS):
            axes, anchors, flange = self.at(found)
            turn = Rotation.from_matrix(target[:3, :3] @ flange[:3, :3].T).as_rotvec()
            error = np.concatenate([target[:3, 3] - flange[:3, 3], turn])
            if np.abs(error).max() <= ACCURACY:
                return found
            velocities = np.cross(axes, flange[:3, 3] - anchors)
            found += np.linalg.lstsq(np.hstack([velocities, axes]).T, error)[0]
            if not np.abs(found - angles).max() <= FARTHEST:
                break
        raise RobotError(
            f"the limb of joints {names[0]!r} to {names[-1]!r} does not bring its flange where the "
            f"plan has it within {FARTHEST:g} rad of the plan's angles; they are too close to a "
            "singular posture"
        )
