"""The description of a robot: a body with N limbs, as everything else reads it.

The default robots have the manufacturer's UR5e kinematics and the body of the published two-limb
model, see `envs_assets/ur5e.json`. Robots from URDF and MJCF files are read in `from_file`.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from mlivr_gym.arguments import ANY_NUMBER, FileName, Reader, WithError, checked
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import RobotError, path_shown, shortened
from mlivr_gym.files import load, write_whole
from mlivr_gym.robot.capsules import check_moving
from mlivr_gym.robot.cargo import CARGO, Cargo
from mlivr_gym.robot.cargo_checks import check_cargo
from mlivr_gym.robot.colours import LIMB_COLOURS as LIMB_COLOURS
from mlivr_gym.robot.derived import DerivedFigures
from mlivr_gym.robot.limb import FARTHEST_TURN, Limb
from mlivr_gym.robot.limb_dynamics import (
    GIVEN_LIMB,
    LIMB_DYNAMICS,
    MASSES,
    GivenInertia,
    LimbDynamics,
    Named,
    arm_dynamics,
    check_inertia,
)
from mlivr_gym.robot.mounts import (
    MOUNT,
    GivenCapsules,
    Mount,
    plain_without_looks,
    without_none,
)
from mlivr_gym.robot.planning_lengths import CHARACTERISTIC_LENGTH, HEIGHTS, SPAN, geometric_order
from mlivr_gym.robot.sizes import MOST_LIMBS
from mlivr_gym.robot.validators import APART, MOST_FOLDS, MOST_POSES, PairOf, SizeOrEdges
from mlivr_gym.robot.visuals import MOST_VISUALS, VISUAL, Visual
from mlivr_gym.schema import NAME, FieldPath, Integer, ListOf, OrNone, Struct, Text, Tuples
from mlivr_gym.values import MAX_REMARK_LENGTH, MAX_ROBOT_LENGTH, MIN_SIZE, Triple

FOLDS_OF_LIMB: tuple[tuple[float, ...], ...] = ((),)
"""Stands for `Limb.default_folds`."""

SUFFIXES = (".urdf", ".xml", ".mjcf")
"""Endings of the files that `from_file` reads."""

PHYSICAL = ("dynamics", "body_centre", "body_inertia", "source", "visuals", "joint_names")
"""Fields of a robot on which no plan depends."""


@dataclass(frozen=True)
class RobotSpec(DerivedFigures):
    """A body with `limbs` limbs, by default equal ones at equal angles about the body's z axis.

    Their first joint axes are then radial, that of limb 0 along the body's +x axis; see `mounts`.

    Examples
    --------
    >>> robot = RobotSpec(limbs=3)
    >>> robot.mount_positions.shape, robot.torque_limits.shape
    ((3, 3), (3, 6))
    """

    name: Annotated[str, NAME] = "robot"
    """Short name."""
    limbs: Annotated[int, Integer(2, MOST_LIMBS)] = 2
    """Number of limbs N, at least 2; with `mounts` it is their number."""
    limb: Annotated[Limb, GIVEN_LIMB] = field(default_factory=Limb)
    """Kinematics of one limb."""
    mount_radius: Annotated[float, SIZE] = 0.1
    """Distance of a limb's base from the body's z axis [m]."""
    tool_length: Annotated[float, SIZE] = 0.05
    """Distance from the flange to the grasp along the flange normal [m]."""
    characteristic_length: Annotated[float, Tuples((), MIN_SIZE, MAX_ROBOT_LENGTH, "m")] = (
        CHARACTERISTIC_LENGTH
    )
    """l_c, which makes lengths and angles comparable in the Jacobian [m]."""
    grasp_separation: Annotated[float, SIZE] = 0.1
    """Smallest distance of two points held at once [m] (gripper width)."""
    span: Annotated[float, Tuples((), MIN_SIZE, MAX_ROBOT_LENGTH, "m")] = SPAN
    """Largest distance of two points that a stance may hold [m]."""
    heights: Annotated[
        tuple[float, ...],
        Tuples((None,), -MAX_ROBOT_LENGTH, MAX_ROBOT_LENGTH, "m", (1, MOST_POSES)),
    ] = HEIGHTS
    """Candidate heights of the base over the grasps' centroid [m], in any order; they are stored
    lowest first."""
    rolls: Annotated[
        tuple[float, ...], Tuples((None,), -FARTHEST_TURN, FARTHEST_TURN, "rad", (1, MOST_POSES))
    ] = tuple(np.deg2rad([0.0, -15.0, 15.0, -30.0, 30.0]).tolist())
    """Candidate rolls about the line from the grasps' centroid to that of limb 0, with more than
    two limbs to the nearest grasp [rad], in any order; stored in `geometric_order`."""
    lift: Annotated[float, SIZE] = 0.1
    """Distance by which a gripper departs along the surface normal before it swings [m]."""
    folds: Annotated[
        tuple[tuple[float, ...], ...],
        Tuples((None, 5), -FARTHEST_TURN, FARTHEST_TURN, "rad", (1, MOST_FOLDS)),
    ] = FOLDS_OF_LIMB
    """Angles of joints 1 to 5 [rad] at which a free limb may stay folded while the base moves, at
    most four, the preferred first; those outside the windows of the joints are left out. By default
    `default_folds` of the limb."""
    capsules: GivenCapsules = None
    """Collision shapes of a limb; by default those of the UR5e, or of
    another arm simple ones along its links, and a gripper from the flange to the grasp."""
    body_size: Annotated[float | Triple, SizeOrEdges()] = 0.2
    """Edge of the body, a cube, or its three edges along x, y and z [m]."""
    body_mass: Annotated[float, Tuples((), *MASSES, "kg")] = 20.0
    """Mass of the body [kg]."""
    gripper_mass: Annotated[float, Tuples((), 0.0, MASSES[1], "kg")] = 0.5
    """Mass of a gripper [kg]; 0 if the last link of the limb includes it."""
    dynamics: Annotated[LimbDynamics | None, OrNone(Named(LIMB_DYNAMICS, arm_dynamics))] = None
    """Masses, inertias, and limits of torque and speed of a limb, or the name of one of `ARMS`;
    None for those of the arm that has the limb's lengths."""
    mounts: Annotated[tuple[Mount, ...] | None, OrNone(ListOf(MOUNT, 2, MOST_LIMBS))] = None
    """Place of each limb, and its own kinematics if limbs differ; None for equal limbs at equal
    angles, see `mlivr_gym.robot.mounts.Mount`."""
    apart: Annotated[tuple[tuple[str, str], ...], ListOf(PairOf(APART), 0, len(APART))] = ()
    """Pairs of links of one limb, of `APART`, whose true shapes never meet although their capsules
    may: these pairs are not compared."""
    body_centre: Annotated[Triple, Tuples((3,), most=MAX_ROBOT_LENGTH, unit="m")] = (0.0, 0.0, 0.0)
    """Centre of mass of the body in its frame [m]."""
    body_inertia: GivenInertia = None
    """Inertia about that centre, xx, yy, zz, xy, xz, yz [kg m^2]; None for that of a box."""
    source: Annotated[str, Text(0, MAX_REMARK_LENGTH)] = ""
    """Where the figures come from, for readers."""
    visuals: Annotated[tuple[Visual, ...] | None, OrNone(ListOf(VISUAL, most=MOST_VISUALS))] = None
    """Meshes that show a limb in pictures; None for those that ship, or for its capsules."""
    cargo: Annotated[Cargo | None, OrNone(CARGO)] = None
    """Load that is fixed to the body; None for none."""
    joint_names: Annotated[
        tuple[tuple[str, ...], ...] | None, OrNone(ListOf(ListOf(NAME, 6, 6), 2, MOST_LIMBS))
    ] = None
    """Names of the joints of each limb that move, six of them; None for `named_joints`."""

    def __post_init__(self) -> None:
        """Check every figure."""
        if self.folds is FOLDS_OF_LIMB:
            limb = ROBOT.validators["limb"].read(self.limb, FieldPath("limb", RobotError))
            object.__setattr__(self, "folds", limb.default_folds)
        if self.mounts is not None and isinstance(self.mounts, list | tuple):
            object.__setattr__(self, "limbs", len(self.mounts))
        ROBOT.check(self, FieldPath("", RobotError))
        object.__setattr__(self, "heights", tuple(sorted(self.heights)))
        object.__setattr__(self, "rolls", geometric_order(self.rolls))
        if self.body_inertia is not None:
            check_inertia(self.body_inertia, FieldPath("body_inertia", RobotError))
        check_moving(self.capsules, FieldPath("", RobotError))
        check_cargo(self)
        self._check_names()
        if self.span <= self.grasp_separation:
            raise RobotError(
                f"span is {self.span!r}; it must exceed grasp_separation {self.grasp_separation!r}"
            )

    def _check_names(self) -> None:
        """Refuse names of joints that are not those of the limbs, or not different."""
        names = [name for limb in self.joint_names or () for name in limb]
        if self.joint_names is not None and len(self.joint_names) != self.limbs:
            raise RobotError(
                f"joint_names is of {len(self.joint_names)} limbs; the robot has {self.limbs}"
            )
        for k, name in enumerate(names):
            if name in names[:k]:
                raise RobotError(f"joint_names has {name!r} twice; names must differ")

    @property
    def fingerprint(self) -> str:
        """Hash of what plans depend on: the description without its name and `PHYSICAL` fields."""
        data = {name: value for name, value in self.to_dict().items() if name not in PHYSICAL}
        data = {name: value for name, value in data.items() if value or name != "apart"}
        if data.pop("mounts") is not None:
            data["mounts"] = list(map(plain_without_looks, self.mounts or ()))
        text = json.dumps(data | {"name": ""}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def to_dict(self) -> dict[str, Any]:
        """Return the description as plain data for JSON.

        What a robot has only if it was read from a file, or is loaded, is left out where it is
        None.
        """
        return without_none(asdict(self))

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
        name = Path(path).stem
        if Path(path).suffix.lower() in SUFFIXES:
            return cls.from_urdf(path)
        return load(path, "robot", RobotError, lambda data: cls.from_dict(data, name))

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

    @checked(
        {"limb": Integer(0, MOST_LIMBS), "joint": Integer(1, 7), "angle": ANY_NUMBER}, RobotError
    )
    def with_failed_joint(self, limb: int, joint: int, angle: float) -> RobotSpec:
        """Return the robot with a joint of a seven-joint limb locked at an angle.

        The limb holds that joint in place of the one that it held. Where these differ its links are
        others, so its collision shapes are the default ones and its masses are not known. Limbs are
        counted from 0, joints of the arm from 1; the angle is in the terms of the limb's
        `joint_limits` [rad].

        Raises a `RobotError` if the limb cannot move without that joint. A limb of six joints never
        can, nor one of seven of which another has failed.
        """
        from mlivr_gym.robot.failed_joints import fields_with_failed_joint

        return replace(self, **fields_with_failed_joint(self, limb, joint, angle))

    def save(self, path: str | Path) -> None:
        """Write the robot as JSON, to be read by `load`; `robot.schema.json` lists its fields.

        Raises a `FileError` if the file cannot be written.
        """
        write_whole(path, json.dumps(self.to_dict(), indent=1) + "\n")

    def to_mjcf(self, path: str | Path | None = None) -> str:
        """Return the robot as MJCF, written to a file if `path` is given.

        Raises a `RobotError` if its masses are not known, and a `FileError` if the file cannot be
        written.
        """
        from mlivr_gym.robot.export import as_mjcf

        return as_mjcf(self, path)

    def to_urdf(self, path: str | Path | None = None) -> str:
        """Return the robot as URDF, written to a file if `path` is given; errors as in `to_mjcf`.

        Its capsules are those of URDF 1.2.
        """
        from mlivr_gym.robot.export import as_urdf

        return as_urdf(self, path)


SIZE = Tuples((), 0.0, MAX_ROBOT_LENGTH, "m")
"""A length that may be zero."""

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
    """Return a robot that ships, by one of `ROBOTS`."""
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
