"""What a caller says of a robot from a URDF or MJCF file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from mlivr_gym.arguments import FileName, Reader
from mlivr_gym.robot.capsules import SHAPES, Capsule
from mlivr_gym.robot.sizes import MOST_LIMBS
from mlivr_gym.robot.validators import EDGES, LENGTH, OneOrList
from mlivr_gym.schema import (
    NAME,
    Choice,
    FieldPath,
    Integer,
    ListOf,
    OrNone,
    Struct,
    Tuples,
    Validator,
)
from mlivr_gym.values import Triple


def _capsules(value: object, place: FieldPath) -> tuple[Capsule, ...] | str:
    simple = Choice(("ur5e",))
    return (simple if isinstance(value, str) else SHAPES).read(value, place)


def _each(kind: Validator[Any]) -> OneOrList:
    """Return the validator of one value for all, or of a list with one for each."""
    return OneOrList(kind, ListOf(kind))


@dataclass(frozen=True)
class FileOptions:
    """What a caller says of a robot from a URDF or MJCF file; None for what the file says.

    Where a list may be given it has an entry for each limb or joint, in the order of the file.
    """

    limbs: Annotated[int | None, OrNone(Integer(2, MOST_LIMBS))] = None
    """Number of limbs, if the file is one arm; by default 2. Of a whole robot it must be the number
    that the file has."""
    tips: Annotated[tuple[str, ...] | None, OrNone(ListOf(NAME, 1))] = None
    """For each limb the name of its last link, or of a site on it; None for every chain of joints
    that begins at the body."""
    tool_frame: Annotated[str | tuple[str, ...] | None, OrNone(_each(NAME))] = None
    """Name of the link or site at which a limb grasps, or a list; None for a customary name such as
    `tool0`, or the last link."""
    tool_length: Annotated[float | None, OrNone(LENGTH)] = None
    """Length of a gripper that is added at the tool frame [m]; None for the gripper of the file,
    or, if it has none, for the default gripper of 0.05 m."""
    mount_radius: Annotated[float | None, OrNone(LENGTH)] = None
    """Distance of an arm's base from the body's z axis [m], if the file is one arm; by default half
    the body's longest edge, and more if its upper arm could not turn there."""
    body_size: Annotated[float | Triple | None, OrNone(EDGES)] = None
    """Edge of the body, or its three edges [m]; None for 0.2 m, or for the box round the shapes of
    a whole robot's body."""
    up: Annotated[Triple | None, OrNone(Tuples((3,)))] = None
    """Direction in the axes of the body's root link that points away from the points that a whole
    robot holds, such as (-1, 0, 0) for a torso whose arms reach forward; None for its z axis. It is
    the body's z axis, the body's x axis is the link's z axis or as close to that as can be, and the
    body's middle is that of the second joints."""
    speed_limits: Annotated[
        float | tuple[float, ...] | None, OrNone(_each(Tuples((), 1e-3, 1e3, "rad/s")))
    ] = None
    """Largest speed of every joint, or a list [rad/s]. MJCF has no field for them but a `<numeric>`
    of this name."""
    torque_limits: Annotated[
        float | tuple[float, ...] | None, OrNone(_each(Tuples((), 1e-3, 1e6, "N m")))
    ] = None
    """Largest torque of every joint, or a list [N m]."""
    rotor_inertia: Annotated[float | None, OrNone(Tuples((), 0.0, 1e3, "kg m^2"))] = None
    """Inertia of a joint's rotor, reflected through its gear [kg m^2]; None for the `armature` of
    the file, or `ROTOR_INERTIA` where it has none."""
    locked_joint: Annotated[str | tuple[str | None, ...] | None, OrNone(_each(OrNone(NAME)))] = None
    """Name of the joint that does not move in an arm of seven, or a list; None for the third joint,
    and for a limb of six joints."""
    locked_angle: Annotated[
        float | tuple[float | None, ...] | None, OrNone(_each(OrNone(Tuples())))
    ] = None
    """Angle at which it is locked, or a list [rad]; None for 0, and for a limb of six joints."""
    capsules: Annotated[tuple[Capsule, ...] | str | None, OrNone(Reader(_capsules))] = None
    """Collision shapes of a limb in its link frames; None for capsules fitted to the collision
    shapes of the file. `"ur5e"` stands for those that a limb has by default, simple ones along its
    links."""
    package_dirs: Annotated[tuple[str | Path, ...], ListOf(FileName())] = ()
    """Folders in which the packages of `package://` names lie, in addition to those above the file.
    """


FILE_OPTIONS = Struct.of(FileOptions)
"""Fields of a `FileOptions`."""
