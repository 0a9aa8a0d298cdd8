"""Robots from URDF and MJCF files.

A file is either one arm, of which several are mounted evenly round a body, or a whole robot, whose
body and limbs are found from the tree of its links. Lengths, limits, masses, inertias and collision
shapes come from the file; whatever it does not say is named in `RobotSpec.source`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from mlivr_gym.arguments import FileName, Reader, Validators, checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError, RobotError, path_shown
from mlivr_gym.robot.build_checks import check_build
from mlivr_gym.robot.capsules import CAPSULE, Capsule
from mlivr_gym.robot.derived import DerivedFigures
from mlivr_gym.robot.description import ROTORS, WINDOWS, Description, read_description
from mlivr_gym.robot.file_arms import arms_of, with_held_joints
from mlivr_gym.robot.file_body import FileBody, body_of
from mlivr_gym.robot.file_limb import FileLimb, LimbOptions, limb_of
from mlivr_gym.robot.link_frames import link_frames
from mlivr_gym.robot.mounts import MOST_CAPSULES, Mount
from mlivr_gym.robot.planning_lengths import CHARACTERISTIC_LENGTH, HEIGHTS, SPAN
from mlivr_gym.robot.validators import MOST_LIMBS, OneOrEach, SizeOrEdges
from mlivr_gym.schema import NAME, Choice, FieldPath, Integer, ListOf, OrNone, Tuples
from mlivr_gym.values import MAX_REMARK_LENGTH, MAX_ROBOT_LENGTH, Triple

UR5E_ARM = 0.425 + 0.3922
"""Length of the UR5e's upper arm and forearm [m], to which the default base heights belong."""

UPPER_ARM_GAP = 0.03
"""Distance of an upper arm from the body [m]: more than the clearance that plans keep."""

R = TypeVar("R", bound=DerivedFigures)

LENGTH = OrNone(Tuples((), 0.0, MAX_ROBOT_LENGTH, "m"))
"""Validator of a length [m] that may be None."""


def _capsules(value: object, place: FieldPath) -> tuple[Capsule, ...] | str:
    if isinstance(value, str):
        return Choice(("ur5e",)).read(value, place)
    return ListOf(CAPSULE, most=MOST_CAPSULES).read(value, place)


VALIDATORS: Validators = {
    "path": FileName(),
    "limbs": OrNone(Integer(2, MOST_LIMBS)),
    "tips": OrNone(ListOf(NAME, 1)),
    "tool_frame": OrNone(OneOrEach(NAME)),
    "tool_length": LENGTH,
    "mount_radius": LENGTH,
    "body_size": OrNone(SizeOrEdges()),
    "speed_limits": OrNone(OneOrEach(Tuples((), 1e-3, 1e3, "rad/s"))),
    "torque_limits": OrNone(OneOrEach(Tuples((), 1e-3, 1e6, "N m"))),
    "rotor_inertia": OrNone(Tuples((), 0.0, 1e3, "kg m^2")),
    "held_joint": OrNone(OneOrEach(OrNone(NAME))),
    "held_angle": OrNone(OneOrEach(OrNone(Tuples()))),
    "capsules": OrNone(Reader(_capsules)),
    "package_dirs": ListOf(FileName()),
}
"""Validators of the arguments of `read_robot`."""


@dataclass(frozen=True)
class RobotFile:
    """A robot as a file describes it."""

    fields: dict[str, Any]
    """Fields of `RobotSpec`."""
    file_limbs: tuple[FileLimb, ...]
    """Each limb as the file has it, N of them; equal limbs of one arm share it."""

    @property
    def joint_names(self) -> tuple[tuple[str, ...], ...]:
        """Names of the joints that move in the file, N of six."""
        return tuple(limb.joint_names for limb in self.file_limbs)

    @property
    def signs(self) -> Array:
        """1 or -1 for each joint, shape (N, 6).

        An angle of the robot is `sign * angle of the file + offset`.
        """
        return np.array([limb.signs for limb in self.file_limbs])

    @property
    def offsets(self) -> Array:
        """The offsets [rad], shape (N, 6)."""
        return np.array([limb.offsets for limb in self.file_limbs])

    @property
    def capsule_excess(self) -> tuple[dict[str, float], ...]:
        """How far capsules reach beyond the shapes of each link at most [m], by limb and link."""
        return tuple(limb.excess for limb in self.file_limbs)

    @property
    def position_error(self) -> float:
        """Largest distance of a flange from that of the file over random joint angles [m].

        It is above 0 because axes that are nearly parallel or perpendicular in the file are exactly
        so in the family.
        """
        return max(limb.position_error for limb in self.file_limbs)

    def from_file_angles(self, angles: Array) -> Array:
        """Return joint angles of the robot from those of the file [rad], shape (..., N, 6)."""
        return np.asarray(angles) * self.signs + self.offsets

    def to_file_angles(self, angles: Array) -> Array:
        """Return joint angles of the file from those of the robot [rad], shape (..., N, 6)."""
        return (np.asarray(angles) - self.offsets) * self.signs

    def exact_file_angles(self, angles: Array) -> Array:
        """Return the angles of the file at which its flanges are where the robot has them [rad].

        They differ from those of `to_file_angles` where axes that are parallel or perpendicular in
        the family are nearly so in the file, as those of a calibrated arm. Joint angles of the
        robot and of the file have shape (..., N, 6) [rad]; flanges are exact to 1e-11 m and rad.
        Raises a `RobotError` if a limb has no such angles within 0.1 rad, too close to a singular
        posture.
        """
        given = np.asarray(angles, dtype=np.float64)
        out = self.to_file_angles(given)
        for place in np.ndindex(out.shape[:-1]):
            limb = self.file_limbs[place[-1]]
            target = link_frames(limb.limb, given[place])[6]
            out[place] = limb.chain.solved(target, out[place], limb.joint_names)
        return out


def robot_of_file(
    path: str | Path, make: Callable[[dict[str, Any]], R], options: dict[str, Any]
) -> R:
    """Return the robot of a file, which `make` makes from its fields, checked.

    `options` are arguments of `read_robot`. Raises a `RobotError` if the file cannot be read, or
    describes a robot that is not supported.
    """
    file = read_robot(path, **options)
    try:
        robot = make(file.fields)
        check_build(robot)
    except MlivrError as fault:
        raise RobotError(f"robot {path_shown(path)}: {fault}") from None
    return robot


@checked(VALIDATORS, RobotError)
def read_robot(
    path: str | Path,
    *,
    limbs: int | None = None,
    tips: Sequence[str] | None = None,
    tool_frame: str | Sequence[str] | None = None,
    tool_length: float | None = None,
    mount_radius: float | None = None,
    body_size: float | Triple | None = None,
    speed_limits: float | Sequence[float] | None = None,
    torque_limits: float | Sequence[float] | None = None,
    rotor_inertia: float | None = None,
    held_joint: str | Sequence[str | None] | None = None,
    held_angle: float | Sequence[float | None] | None = None,
    capsules: Sequence[Capsule] | str | None = None,
    package_dirs: Sequence[str | Path] = (),
    **fields: Any,
) -> RobotFile:
    """Read a robot from a URDF or MJCF file.

    Parameters
    ----------
    path
        The file: `.urdf` or MJCF.
    limbs
        Number of limbs, if the file is one arm; by default 2. Of a whole robot it must be the
        number that the file has.
    tips
        For each limb the name of its last link, or of a site on it; None for every chain of joints
        that begins at the body.
    tool_frame
        Name of the link or site at which a limb grasps, or a list with that of each limb; None for
        a customary name such as `tool0`, or the last link.
    tool_length
        Length of a gripper that is added at the tool frame [m]; None for the gripper of the file,
        or, if it has none, for the default gripper of 0.05 m.
    mount_radius
        Distance of an arm's base from the body's z axis [m], if the file is one arm; by default
        half the body's longest edge, and more if its upper arm could not turn there.
    body_size
        Edge of the body, or its three edges [m]; None for 0.2 m, or for the box round the shapes
        of a whole robot's body.
    speed_limits
        Largest speed of every joint, or of each in the order of the file [rad/s]; None for those
        of the file. MJCF has no field for them but a `<numeric>` of this name.
    torque_limits
        Largest torque of every joint, or of each in the order of the file [N m]; None for those of
        the file.
    rotor_inertia
        Inertia of a joint's rotor, reflected through its gear [kg m^2]; None for the `armature` of
        the file, or 0.1 where it has none, as MuJoCo Menagerie gives UR arms.
    held_joint
        Name of the joint that does not move in an arm of seven, or a list with that of each limb;
        None for the third joint, and for a limb of six joints.
    held_angle
        Angle at which it is held, of every limb or of each [rad]; None for 0, and for a limb of
        six joints.
    capsules
        Collision shapes of a limb in its link frames; None for capsules fitted to the collision
        shapes of the file. `"ur5e"` stands for those of the UR5e stretched to the limb's lengths,
        or, for an arm of another family, for capsules along its links.
    package_dirs
        Folders in which the packages of `package://` names lie, in addition to those above the
        file.
    **fields
        Further fields of `RobotSpec`, such as `name`, `heights` or `span`. Where `heights`, `span`
        and `characteristic_length` are not given, those of the default robot grow with the arm.

    Returns
    -------
    RobotFile
        The fields of the robot, the map of its joints and the excess of its shapes.

    Raises
    ------
    RobotError
        If the file cannot be read, or describes a robot that is not supported; the message names
        the joint or link, its value and what would be valid.

    Examples
    --------
    >>> file = read_robot("my_arm.urdf", limbs=3, tool_frame="tool0")  # doctest: +SKIP
    >>> file.capsule_excess[0]["forearm"]  # doctest: +SKIP
    """
    options = LimbOptions(tool_length, rotor_inertia, capsules)
    try:
        file = read_description(path, package_dirs, speed_limits, torque_limits)
        arms = arms_of(file, tips, tool_frame)
        angles = cast("tuple[float | None, ...] | None", held_angle)  # as `OneOrEach` reads it
        arms = with_held_joints(file, arms, held_joint, angles)
        if len(arms) == 1:
            return _of_one_arm(file, limb_of(file, arms, 0, options), fields, {
                "limbs": 2 if limbs is None else limbs,
                "body_size": 0.2 if body_size is None else body_size,
                "mount_radius": mount_radius,
            })  # fmt: skip
        if limbs not in (None, len(arms)):
            raise RobotError(f"limbs is {limbs}; the file has {len(arms)} limbs")
        if mount_radius is not None:
            raise RobotError(
                f"mount_radius is {mount_radius}; the file is a whole robot of {len(arms)} limbs, "
                "whose mounts it names"
            )
        each = tuple(limb_of(file, arms, k, options) for k in range(len(arms)))
        # A limb's flange may lie anywhere on the axis of its last joint: all tools are made equal.
        shortest = min(limb.tool_length for limb in each)
        each = tuple(limb.with_tool_length(shortest) for limb in each)
        return _of_whole_robot(file, body_of(file, arms, each, body_size), fields)
    except MlivrError as fault:
        raise RobotError(f"robot {path_shown(path)}: {fault}") from None


def _of_one_arm(
    file: Description, limb: FileLimb, fields: dict[str, Any], build: dict[str, Any]
) -> RobotFile:
    """Return a robot of equal arms mounted evenly round a box."""
    if build["mount_radius"] is None:
        build["mount_radius"] = 0.5 * float(np.max(build["body_size"])) + _stand_off(limb)
    return RobotFile(_fields(file, (limb,), fields, build), (limb,) * build["limbs"])


def _stand_off(limb: FileLimb) -> float:
    """Return how far from the body an arm must stand for its upper arm to turn freely [m].

    What counts are the capsules about joint 2, which come equally close at every angle, and of the
    longer ones the end about it, which is never farther than where the arm points away.
    """
    lows = [0.0]
    for capsule in limb.capsules:
        ends = [float(np.hypot(end[0], end[1])) for end in (capsule.start, capsule.end)]
        if capsule.link == "upper_arm" and min(ends) < capsule.radius:
            away = max(ends) if max(ends) < capsule.radius else -min(ends)
            lows.append(away + capsule.radius + UPPER_ARM_GAP - limb.limb.d1)
    return round(max(lows), 3)


def _of_whole_robot(file: Description, body: FileBody, fields: dict[str, Any]) -> RobotFile:
    """Return the robot of a file that holds a body with several limbs."""
    limbs = body.limbs
    build: dict[str, Any] = {
        "body_size": body.edges,
        "body_mass": body.solid.mass,
        "body_centre": body.solid.centre,
        "body_inertia": body.inertia,
    }
    alike = all(limb.is_like(limbs[0]) for limb in limbs)
    if body.mount_radius is not None and alike:
        build |= {"limbs": len(limbs), "mount_radius": body.mount_radius}
    else:
        build["mounts"] = tuple(_mount(limb, alike) for limb in limbs)
    return RobotFile(_fields(file, limbs, fields, build), limbs)


def _mount(limb: FileLimb, alike: bool) -> Mount:
    """Return the mount of a limb, with the limb itself if the limbs differ."""
    x, y, z = limb.mount[:3, 3].tolist()
    a, b, c = (tuple(row) for row in limb.mount[:3, :3].tolist())
    if alike:
        return Mount((x, y, z), (a, b, c))
    return Mount(
        (x, y, z),
        (a, b, c),
        limb.limb,
        limb.described_capsules,
        limb.dynamics,
        limb.visuals or None,
    )


def _fields(
    file: Description,
    limbs: tuple[FileLimb, ...],
    fields: dict[str, Any],
    build: dict[str, Any],
) -> dict[str, Any]:
    """Return the fields of a robot; those that a caller gives come before those of the file."""
    first = limbs[0]
    scale = max(limb.limb.arm_length for limb in limbs) / UR5E_ARM
    described = {
        "name": file.name,
        "limb": first.limb,
        "capsules": first.described_capsules,
        "visuals": first.visuals or None,
        "dynamics": first.dynamics,
        "tool_length": first.tool_length,
        "gripper_mass": first.gripper_mass,
        "apart": tuple(p for p in first.apart if all(p in limb.apart for limb in limbs)),
        "source": _source(file, limbs),
        "heights": tuple(scale * height for height in HEIGHTS),
        "span": scale * SPAN,
        "characteristic_length": scale * CHARACTERISTIC_LENGTH,
    }
    written = {name: value for name, value in file.fields.items() if name not in (WINDOWS, ROTORS)}
    return described | build | written | fields


def _source(file: Description, limbs: tuple[FileLimb, ...]) -> str:
    """Return where the figures come from, in words."""
    told = [f"the file of {file.name}"]
    notes = [note for limb in limbs for note in limb.notes]
    told += [note for k, note in enumerate(notes) if note not in notes[:k]]
    fitted = max((max(limb.excess.values(), default=0.0) for limb in limbs), default=0.0)
    if fitted:
        told.append(f"capsules exceed the shapes of their links by {fitted:.3f} m at most")
    text = "; ".join(told)
    return "".join(c if c.isprintable() else " " for c in text)[:MAX_REMARK_LENGTH]
