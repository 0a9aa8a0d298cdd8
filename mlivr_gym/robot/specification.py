"""The description of a robot: a body with N limbs, as everything else reads it.

The default robots have the manufacturer's UR5e kinematics and the body of the published two-limb
model, see `envs_assets/ur5e.json`. Robots from URDF and MJCF files are read in `from_file`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import ANY_NUMBER, FileName, Reader, WithError, checked
from mlivr_gym.arrays import Array
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import RobotError, path_shown, shortened
from mlivr_gym.files import load, write_whole
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.default_shapes import default_capsules
from mlivr_gym.robot.fields import RobotFields
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.limb_dynamics import ARMS, LimbDynamics, arm_dynamics, arm_of, gripper_link
from mlivr_gym.robot.links import RobotLink, limb_links
from mlivr_gym.robot.mounts import Mount, are_even, even_mounts
from mlivr_gym.robot.rigid import RigidBody, box_inertia, combined
from mlivr_gym.robot.sizes import MOST_LIMBS
from mlivr_gym.robot.validators import edges_of
from mlivr_gym.schema import FieldPath, Integer, Struct
from mlivr_gym.values import MIN_SIZE, as_triple

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

    def __post_init__(self) -> None:
        """Check every figure."""
        super().__post_init__()
        if self.cargo is not None:
            self.cargo.check_room(self.cargo_frame, self.mounted)

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

        return self._exported(as_mjcf, path)

    def to_urdf(self, path: str | Path | None = None) -> str:
        """Return the robot as URDF, written to a file if `path` is given; errors as in `to_mjcf`.

        Its capsules are those of URDF 1.2.
        """
        from mlivr_gym.robot.export import as_urdf

        return self._exported(as_urdf, path)

    def _exported(self, write: Callable[..., str], path: str | Path | None) -> str:
        for limb in range(self.limbs):
            self.dynamics_of(limb)
        text = write(self.name, self.links(), self.tool_length, self.to_dict())
        if path is not None:
            write_whole(path, text)
        return text

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
        mounts, last = list(self._places), self.limbs - 1
        if limb > last:
            raise RobotError(f"limb is {limb}; it must be a whole number from 0 to {last}")
        whole = mounts[limb].limb or self.limb
        try:
            failed = whole.with_failed_joint(joint, angle)
        except RobotError as fault:
            raise RobotError(f"limb {limb} {fault}") from None
        if failed == whole:
            return self
        mounts[limb] = (
            replace(self._with_shared(mounts[limb]), limb=failed)
            if joint == whole.held_joint
            else Mount(mounts[limb].position, mounts[limb].rotation, failed)
        )
        return replace(self, name=f"{self.name}-limb{limb}-joint{joint}", mounts=tuple(mounts))

    @property
    def _places(self) -> tuple[Mount, ...]:
        """Each limb where it is mounted, with what it does not share with the others."""
        return self.mounts or even_mounts(self.limbs, self.mount_radius)

    def _with_shared(self, mount: Mount) -> Mount:
        """Return a mount with what its limb shares with the other limbs."""
        if mount.limb is not None:
            return mount
        return replace(
            mount, limb=self.limb, capsules=mount.capsules or self.capsules,
            dynamics=mount.dynamics or self.dynamics, visuals=mount.visuals or self.visuals,
        )  # fmt: skip

    @cached_property
    def mounted(self) -> tuple[Mount, ...]:
        """Each limb with its place, its kinematics, its capsules and its dynamics, N of them.

        Where the first joint of a limb is held, its place is that of the first joint that moves.
        `Mount.dynamics` is None where it is neither given nor that of an arm that ships.
        """
        return tuple(map(self._completed, self._places))

    def _completed(self, mount: Mount) -> Mount:
        """Return a mount with all that it has by default."""
        whole = self._with_shared(mount)
        assert whole.limb is not None
        base, name = whole.frame @ whole.limb.base_in_mount, arm_of(whole.limb)
        return replace(
            whole, position=base[:3, 3].tolist(), rotation=base[:3, :3].tolist(),
            capsules=whole.capsules or default_capsules(whole.limb, self.tool_length),
            dynamics=whole.dynamics or (arm_dynamics(name) if name else None),
        )  # fmt: skip

    @cached_property
    def every_limb(self) -> tuple[Limb, ...]:
        """Kinematics of each limb, N of them."""
        return tuple(mount.limb or self.limb for mount in self._places)

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether plans are the same after a turn by one limb about the body's z axis.

        Its limbs are equal and evenly mounted, that of limb 0 along the body's x axis, and the body
        of more than two limbs is a cube. Cargo must lie on the axis of two limbs.
        """
        if self.cargo is not None and (self.limbs > 2 or self.cargo_frame[:2, 3].any()):
            return False
        if self.limbs > 2 and len(set(self.body_edges.tolist())) > 1:
            return False
        return self.mounts is None or are_even(self.mounted)

    def is_apart(self, first: str, second: str) -> bool:
        """Return whether the shapes of two links of a limb never meet, see `RobotSpec.apart`."""
        return any({first, second} == set(pair) for pair in self.apart)

    @property
    def named_joints(self) -> tuple[tuple[str, ...], ...]:
        """Names of the joints that move, N times six: those of the file the robot is read from.

        Joint k of limb i of another robot is `"limb{i}/joint{k}"`.
        """
        return self.joint_names or tuple(
            tuple(f"limb{i}/joint{k}" for k in range(1, 7)) for i in range(self.limbs)
        )

    @property
    def mount_rotations(self) -> Array:
        """Limb base axes in the body frame, shape (N, 3, 3); z is the axis of the first joint."""
        return np.array([mount.rotation for mount in self.mounted])

    @property
    def mount_positions(self) -> Array:
        """Limb base origins in the body frame [m], shape (N, 3)."""
        return np.array([mount.position for mount in self.mounted])

    @property
    def mount_directions(self) -> Array:
        """Where the shoulders lie across the body's z axis, from their middle [m], shape (N, 2).

        What is below a nanometre counts as 0: rounding must not choose a direction.
        """
        lengths = np.array([limb.shoulder_height for limb in self.every_limb])
        shoulders = self.mount_positions + lengths[:, None] * self.mount_rotations[:, :, 2]
        across: Array = (shoulders - shoulders.mean(axis=0))[:, :2]
        return np.where(np.abs(across) < MIN_SIZE, 0.0, across)

    @property
    def joint_limits(self) -> Array:
        """Joint limits of every limb [rad], shape (N, 6, 2)."""
        return np.array([limb.limits for limb in self.every_limb])

    @property
    def body_edges(self) -> Array:
        """Edges of the body along x, y and z [m], shape (3,)."""
        return edges_of(self.body_size)

    @property
    def body_solid(self) -> RigidBody:
        """Mass, centre and inertia of the body with cargo and locked limb, in the body frame."""
        inertia = self.body_inertia or box_inertia(self.body_mass, self.body_edges)
        body = RigidBody(self.body_mass, self.body_centre, inertia)
        if self.cargo is None:
            return body
        bag = self.cargo.solid.moved(self.cargo_frame)
        return combined([body, bag, *self.cargo.limb_solids(self.gripper_mass, self.tool_length)])

    @property
    def cargo_frame(self) -> Array:
        """Frame of the middle of the cargo in the body frame, shape (4, 4); of the body if none."""
        if self.cargo is None:
            return np.eye(4)
        return self.cargo.frame_on(self.body_edges, self.tool_length)

    @property
    def reach(self) -> float:
        """An upper bound of the distance of a grasp from the body's origin [m]."""
        reaches = [float(np.linalg.norm(one.position)) for one in self._places]
        limbs = zip(reaches, self.every_limb, strict=True)
        return max(away + limb.reach for away, limb in limbs) + self.tool_length

    @property
    def extent(self) -> float:
        """An upper bound of the distance of any part of the robot from the body's middle [m]."""
        parts = [self.reach, 0.5 * float(np.linalg.norm(self.body_edges))]
        if self.cargo is not None:
            # The capsules that cover the cargo protrude by less than a quarter of its edges.
            frame = self.cargo_frame
            corner = np.abs(frame[:3, :3].T @ frame[:3, 3]) + 0.75 * self.cargo.edges
            parts.append(float(np.linalg.norm(corner)))
            for _, ends, radius in self.cargo.limb_capsules:
                parts.append(float(np.linalg.norm(ends, axis=1).max()) + radius)
        for place, mount, limb in zip(self._places, self.mounted, self.every_limb, strict=True):
            # In the order of `LINKS`, of which the gripper is on the flange.
            origins = (*limb.link_distances, limb.reach)
            for shape in mount.capsules or ():
                end = max(float(np.linalg.norm(end)) for end in (shape.start, shape.end))
                away = float(np.linalg.norm(place.position)) + origins[LINKS.index(shape.link)]
                parts.append(away + end + shape.radius)
        return max(parts)

    def dynamics_of(self, limb: int) -> LimbDynamics:
        """Return the masses, inertias and joint limits of a limb, by its number from 0.

        Raises a `RobotError` if they are not given and the limb's lengths are those of no arm that
        ships: another arm's figures would be wrong without notice.
        """
        dynamics = self.mounted[limb].dynamics
        if dynamics is None:
            raise RobotError(
                f"robot {self.name!r} cannot be simulated: its limbs' links are "
                f"those of none of {', '.join(ARMS)}, whose masses, inertias and torque limits "
                "are known; give its `dynamics`, or the name of one of these arms as `dynamics` "
                f"to take that arm's figures (source of the robot: {self.source or 'not told'})"
            )
        return dynamics

    @property
    def torque_limits(self) -> Array:
        """Largest torque of every joint [N m], shape (N, 6), see `dynamics_of`."""
        return np.array([self.dynamics_of(i).torque_limits for i in range(self.limbs)])

    @property
    def speed_limits(self) -> Array:
        """Largest speed of every joint [rad/s], shape (N, 6), see `dynamics_of`."""
        return np.array([self.dynamics_of(i).speed_limits for i in range(self.limbs)])

    @property
    def dynamics_source(self) -> str:
        """Whose masses, inertias, torque and speed limits a simulation takes, for each limb."""
        known = {arm_dynamics(name): f"those of the {name}" for name in ARMS} | {None: "not known"}
        told = [known.get(mount.dynamics, "given with the robot") for mount in self.mounted]
        return told[0] if len(set(told)) == 1 else "; ".join(told)

    def links(self) -> list[RobotLink]:
        """Return the body and the links of all limbs, each after the one that carries it.

        Limbs whose masses are not known have those of the UR5e, which a picture does not need.
        """
        held: tuple[Capsule, ...] = ()
        boxes = [("body", np.eye(4), self.body_edges)]
        if self.cargo is not None:
            boxes.append(("cargo", self.cargo_frame, self.cargo.edges))
            held = tuple(
                Capsule("base", as_triple(start), as_triple(end), radius)
                for _, (start, end), radius in self.cargo.limb_capsules
            )
        out = [RobotLink("base", "", np.eye(4), self.body_solid, "cargo/limb", held, boxes=boxes)]
        gripper = gripper_link(self.gripper_mass, self.tool_length)
        for i, mount in enumerate(self.mounted):
            dynamics = mount.dynamics or arm_dynamics("ur5e")
            out += limb_links(f"limb{i}", mount, dynamics, gripper, self.named_joints[i])
        return out


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
