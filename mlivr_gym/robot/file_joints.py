"""The joints of a limb in the terms of the file that it is read from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.schema import FieldPath, OrNone, Struct, Tuples
from mlivr_gym.values import MAX_ROBOT_LENGTH, Triple

FARTHEST_TURN = 100.0
"""Largest joint limit or angle [rad], 16 turns; a UR joint has one in each direction."""

LinkQuaternion = tuple[float, float, float, float]
"""A unit quaternion w, x, y, z."""

UNIT_LENGTH = 1e-6
"""How far a quaternion's length may be from 1."""


def axes_of(quaternion: LinkQuaternion) -> Array:
    """Return the rotation matrix of a unit quaternion w, x, y, z, shape (3, 3)."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def rolled(quaternion: LinkQuaternion, angle: float) -> LinkQuaternion:
    """Return a quaternion turned about its own z axis [rad]."""
    w, x, y, z = quaternion
    c, s = float(np.cos(0.5 * angle)), float(np.sin(0.5 * angle))
    return w * c - z * s, x * c + y * s, y * c - x * s, w * s + z * c


@dataclass(frozen=True)
class FileJoints:
    """The joints of a limb as the file has them that it is read from: signs, zeros and frames.

    All angles of the limb are those of the file. Its closed form has others, and only the files
    that solve the inverse kinematics know them: an angle of the form is `sign * angle + zero`.
    """

    signs: Annotated[tuple[float, ...], Tuples((None,), -1.0, 1.0, "", (6, 7))]
    """1 or -1 for each joint, the held one among them."""
    zeros: Annotated[
        tuple[float, ...], Tuples((None,), -FARTHEST_TURN, FARTHEST_TURN, "rad", (6, 7))
    ]
    """Angle of the form where that of the file is 0, for each joint [rad]."""
    origins: Annotated[
        tuple[Triple, ...] | None, OrNone(Tuples((6, 3), most=MAX_ROBOT_LENGTH, unit="m"))
    ] = None
    """Origin of each link's frame in that of the link before it, at angles of 0, if the joints are
    only nearly where the form has them [m]; None if they are there."""
    quaternions: Annotated[tuple[LinkQuaternion, ...] | None, OrNone(Tuples((6, 4), most=1.1))] = (
        None
    )
    """Orientations of these frames, quaternions w, x, y, z."""

    def check(self, place: FieldPath, joints: int) -> None:
        """Refuse joints that are not those of an arm of so many, by a `RobotError`."""
        if not len(self.signs) == len(self.zeros) == joints:
            raise place.fault(
                f"has {len(self.signs)} signs and {len(self.zeros)} zeros; the arm has {joints} "
                "joints"
            )
        if set(self.signs) - {1.0, -1.0}:
            raise place.field("signs").fault(f"is {list(self.signs)}; each must be 1 or -1")
        if (self.origins is None) != (self.quaternions is None):
            raise place.fault("must have both origins and quaternions, or neither")
        sizes = np.linalg.norm(np.array(self.quaternions or ((1.0, 0.0, 0.0, 0.0),)), axis=1)
        if np.abs(sizes - 1.0).max() > UNIT_LENGTH:
            raise place.field("quaternions").fault("must have length 1, each of them")

    def with_flange_moved(self, shift: float) -> FileJoints:
        """Return the joints with their flange farther out on the last axis [m]."""
        if self.origins is None or self.quaternions is None:
            return self
        x, y, z = (np.array(self.origins[5]) + shift * axes_of(self.quaternions[5])[:, 2]).tolist()
        return replace(self, origins=(*self.origins[:5], (x, y, z)))


FILE_JOINTS = Struct.of(FileJoints)
"""Fields of a `FileJoints`."""

GivenJoints = Annotated[FileJoints | None, OrNone(FILE_JOINTS)]
"""Joints of a file, or None."""
