"""The description of a robot: a body with N limbs, as everything else reads it.

The default robots have the manufacturer's UR5e kinematics and the body of the published two-limb
model, see `envs_assets/ur5e.json`. Robots from URDF and MJCF files are read in `from_file`.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from mlivr_gym.arguments import ANY_NUMBER, FileName, Reader, WithError, checked
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import RobotError, path_shown, shortened
from mlivr_gym.files import load, write_whole
from mlivr_gym.robot.cargo import CARGO, Cargo
from mlivr_gym.robot.fields import RobotFields
from mlivr_gym.robot.limb import with_failed_joint
from mlivr_gym.robot.mounts import Mount
from mlivr_gym.robot.sizes import MOST_LIMBS
from mlivr_gym.schema import FieldPath, Integer, Struct

SUFFIXES = (".urdf", ".xml", ".mjcf")
"""Endings of the files that `from_file` reads."""


@dataclass(frozen=True)
class RobotSpec(RobotFields):
    """A body with `limbs` limbs, by default equal ones at equal angles about the body's z axis.

    Their first joint axes are then radial, that of limb 0 along the body's +x axis; see `mounts`.

    Examples
    --------
    >>> robot = RobotSpec(limbs=3)
    >>> robot.mount_positions.shape, robot.torque_limits.shape
    ((3, 3), (3, 6))
    """

    @classmethod
    def from_dict(cls, data: Any, name: str = "robot") -> RobotSpec:
        """Build a robot from plain data, the inverse of `to_dict`.

        Fields that are missing keep their defaults; unknown ones are refused. The name is used when
        the data name none. Raises a `RobotError` if a field is unknown or its value faulty; the
        message names it.
        """
        given = {"name": name} | data if isinstance(data, dict) else data
        return ROBOT.read(given, FieldPath("", RobotError))

    @classmethod
    def load(cls, path: str | Path) -> RobotSpec:
        """Read a robot from a JSON, URDF or MJCF file; one without a name is called like it.

        Raises a `RobotError` if the file cannot be read or a field is faulty.
        """
        path = FileName().read(path, FieldPath("path", RobotError))
        if Path(path).suffix.lower() in SUFFIXES:
            return cls.from_urdf(path)
        return load(path, "robot", RobotError, lambda data: cls.from_dict(data, Path(path).stem))

    @classmethod
    def from_urdf(cls, path: str | Path, **options: Any) -> RobotSpec:
        """Read a robot from a URDF file.

        The options are arguments of `mlivr_gym.robot.from_file.read_robot`, such as `limbs`,
        `tool_frame` or `speed_limits`, and further fields of a robot. Raises a `RobotError` if the
        file cannot be read, or describes a robot that is not supported.
        """
        from mlivr_gym.robot.from_file import read_robot

        file = read_robot(path, **options)
        place = FieldPath(f"robot {path_shown(path)}", RobotError)
        return place.build(cls.from_dict, file.fields)

    from_mjcf = from_urdf
    """Read a robot from an MJCF file; arguments and errors are those of `from_urdf`."""

    def save(self, path: str | Path) -> None:
        """Write the robot as JSON, to be read by `load`.

        Raises a `FileError` if the file cannot be written.
        """
        write_whole(path, json.dumps(self.to_dict(), indent=1) + "\n")

    def carrying(self, cargo: Cargo | dict[str, Any] | None) -> RobotSpec:
        """Return the robot with cargo, given as itself or as plain data; itself without."""
        if cargo is None:
            return self
        return replace(self, cargo=CARGO.read(cargo, FieldPath("cargo", RobotError)))

    @checked(
        {"limb": Integer(0, MOST_LIMBS), "joint": Integer(1, 7), "angle": ANY_NUMBER}, RobotError
    )
    def with_failed_joint(self, limb: int, joint: int, angle: float) -> RobotSpec:
        """Return the robot with a joint of a seven-joint limb locked at an angle.

        That joint is locked in place of the one that was. Where these differ its links are
        others, so its collision shapes are the default ones and its masses are not known. Limbs are
        counted from 0, joints of the arm from 1; the angle is in the terms of the limb's
        `joint_limits` [rad].

        Raises a `RobotError` if the limb cannot move without that joint. A limb of six joints never
        can, nor one of seven of which another has failed.
        """
        mounts, last = list(self._places), self.limbs - 1
        if limb > last:
            raise RobotError(f"limb is {limb}; it must be a whole number from 0 to {last}")
        whole = mounts[limb].limb or self.limb
        try:
            failed = with_failed_joint(whole, joint, angle)
        except RobotError as fault:
            raise RobotError(f"limb {limb} {fault}") from None
        if failed == whole:
            return self
        mounts[limb] = (
            replace(self._with_shared(mounts[limb]), limb=failed)
            if joint == whole.locked_joint
            else Mount(mounts[limb].position, mounts[limb].rotation, failed)
        )
        return replace(self, name=f"{self.name}-limb{limb}-joint{joint}", mounts=tuple(mounts))


ROBOT = Struct.of(RobotSpec)
"""Fields of a `RobotSpec`."""

MLIVR2 = RobotSpec(name="mlivr2")
"""Two UR5e on opposite faces of a 0.2 m cube of 20 kg."""

EVEN = {f"mlivr{n}": replace(MLIVR2, name=f"mlivr{n}", limbs=n) for n in (2, 3, 4)}
"""Robots with two, three and four UR5e on that cube."""

ROBOTS = (
    *EVEN, "mlivr2-ur3e", "mlivr2-ur10e", "mlivr2-iiwa", "mlivr2-unequal", "ssrms2",
)  # fmt: skip
"""Names of the robots that ship; the others are files in `envs_assets`."""


@cache
def _shipped(name: str) -> RobotSpec:
    return EVEN.get(name) or RobotSpec.load(asset_path(f"{name}.json"))


_PLACE = FieldPath("robot", RobotError)


def robot_spec(
    robot: str | Path | RobotSpec | dict[str, Any], place: FieldPath = _PLACE
) -> RobotSpec:
    """Return a robot by name, from a file, from plain data, or as it is.

    Given is the name of a robot that ships, the path of a JSON, URDF (`.urdf`) or MJCF file
    (`.xml`, `.mjcf`), plain data (`RobotSpec.to_dict`), or a robot; `place` is where it stands.
    Raises a `RobotError` if the name is unknown and no such file exists, or the description is
    faulty.

    Examples
    --------
    >>> robot_spec("mlivr3").limbs
    3
    """
    if isinstance(robot, RobotSpec):
        return robot
    if isinstance(robot, dict):
        return place.build(RobotSpec.from_dict, robot)
    if isinstance(robot, str) and robot in ROBOTS:
        return _shipped(robot)
    if isinstance(robot, (str, os.PathLike)) and os.path.isfile(robot):
        return RobotSpec.load(os.fspath(robot))
    raise RobotError(
        f"unknown robot {shortened(robot)}; valid names are {', '.join(ROBOTS)}, "
        "or give the path of a JSON, URDF or MJCF file"
    )


ROBOT_OR_NAME = WithError(RobotError, Reader(robot_spec))
"""A robot as `robot_spec` takes it."""
