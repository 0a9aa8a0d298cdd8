"""One limb of a URDF or MJCF file."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from mlivr_gym.arguments import FileName, Reader
from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.kinematics.forms import closed_form
from mlivr_gym.robot.any_limb import AnyLimb
from mlivr_gym.robot.capsules import CAPSULE, Capsule
from mlivr_gym.robot.default_shapes import default_capsules, gripper_capsule
from mlivr_gym.robot.description import LEAST_MASS, ROTORS, Description
from mlivr_gym.robot.file_arms import FileArm
from mlivr_gym.robot.file_chain import figures_of_limb
from mlivr_gym.robot.file_parts import LimbParts, joined
from mlivr_gym.robot.file_shapes import fitted_capsules, limb_visuals, links_apart
from mlivr_gym.robot.limb_dynamics import LimbDynamics, arm_data
from mlivr_gym.robot.link_frames import inverse, rigid
from mlivr_gym.robot.mounts import MOST_CAPSULES
from mlivr_gym.robot.rigid import RigidBody, cylinder
from mlivr_gym.robot.validators import MOST_LIMBS, OneOrEach, SizeOrEdges
from mlivr_gym.robot.visuals import Visual
from mlivr_gym.schema import NAME, Choice, FieldPath, Integer, ListOf, OrNone, Struct, Tuples
from mlivr_gym.values import MAX_ROBOT_LENGTH, MIN_SIZE, Triple

ROTOR_INERTIA = 0.1
"""Inertia of a rotor where neither file nor caller gives one [kg m^2]: MuJoCo Menagerie's UR arms.
"""

GRIPPER_MASS = 0.5
"""Mass of the gripper that is added to an arm without one [kg]."""

DECIMALS = 9
"""Lengths are rounded to nanometres."""

LENGTH = OrNone(Tuples((), 0.0, MAX_ROBOT_LENGTH, "m"))
"""Validator of a length [m] that may be None."""


def _capsules(value: object, place: FieldPath) -> tuple[Capsule, ...] | str:
    if isinstance(value, str):
        return Choice(("ur5e",)).read(value, place)
    return ListOf(CAPSULE, most=MOST_CAPSULES).read(value, place)


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
    tool_frame: Annotated[tuple[str, ...] | None, OrNone(OneOrEach(NAME))] = None
    """Name of the link or site at which a limb grasps, or a list; None for a customary name such as
    `tool0`, or the last link."""
    tool_length: Annotated[float | None, LENGTH] = None
    """Length of a gripper that is added at the tool frame [m]; None for the gripper of the file,
    or, if it has none, for the default gripper of 0.05 m."""
    mount_radius: Annotated[float | None, LENGTH] = None
    """Distance of an arm's base from the body's z axis [m], if the file is one arm; by default half
    the body's longest edge, and more if its upper arm could not turn there."""
    body_size: Annotated[float | Triple | None, OrNone(SizeOrEdges())] = None
    """Edge of the body, or its three edges [m]; None for 0.2 m, or for the box round the shapes of
    a whole robot's body."""
    speed_limits: Annotated[
        tuple[float, ...] | None, OrNone(OneOrEach(Tuples((), 1e-3, 1e3, "rad/s")))
    ] = None
    """Largest speed of every joint, or a list [rad/s]. MJCF has no field for them but a `<numeric>`
    of this name."""
    torque_limits: Annotated[
        tuple[float, ...] | None, OrNone(OneOrEach(Tuples((), 1e-3, 1e6, "N m")))
    ] = None
    """Largest torque of every joint, or a list [N m]."""
    rotor_inertia: Annotated[float | None, OrNone(Tuples((), 0.0, 1e3, "kg m^2"))] = None
    """Inertia of a joint's rotor, reflected through its gear [kg m^2]; None for the `armature` of
    the file, or `ROTOR_INERTIA` where it has none."""
    held_joint: Annotated[tuple[str | None, ...] | None, OrNone(OneOrEach(OrNone(NAME)))] = None
    """Name of the joint that does not move in an arm of seven, or a list; None for the third joint,
    and for a limb of six joints."""
    held_angle: Annotated[tuple[float | None, ...] | None, OrNone(OneOrEach(OrNone(Tuples())))] = (
        None
    )
    """Angle at which it is held, or a list [rad]; None for 0, and for a limb of six joints."""
    capsules: Annotated[tuple[Capsule, ...] | str | None, OrNone(Reader(_capsules))] = None
    """Collision shapes of a limb in its link frames; None for capsules fitted to the collision
    shapes of the file. `"ur5e"` stands for those that a limb has by default, simple ones along its
    links."""
    package_dirs: Annotated[tuple[str | Path, ...], ListOf(FileName())] = ()
    """Folders in which the packages of `package://` names lie, in addition to those above the file.
    """


FILE_OPTIONS = Struct.of(FileOptions)
"""Fields of a `FileOptions`."""


@dataclass(frozen=True)
class FileLimb:
    """A limb of a file."""

    limb: AnyLimb
    """Lengths and joint limits."""
    joint_names: tuple[str, ...]
    """Names of its joints that move."""
    mount: Array
    """Base frame of the limb in the body's frame, of a file of one arm in the world, (4, 4)."""
    capsules: tuple[Capsule, ...]
    """Collision shapes."""
    excess: dict[str, float]
    """Largest excess of the capsules of each link [m]."""
    dynamics: LimbDynamics
    """Masses, inertias and limits."""
    tool_length: float
    """Distance from the flange to the grasp [m]."""
    gripper_mass: float
    """Mass of a gripper that the last link does not include [kg]."""
    apart: tuple[tuple[str, str], ...]
    """Links whose shapes never meet, see `RobotSpec.apart`."""
    visuals: tuple[Visual, ...]
    """Meshes that show it."""
    notes: tuple[str, ...]
    """What the file does not say, in words."""

    @property
    def described_capsules(self) -> tuple[Capsule, ...] | None:
        """Its collision shapes, None if they are those that a limb has by default."""
        default = default_capsules(self.limb, self.tool_length)
        same = _alike(tuple(map(astuple, self.capsules)), tuple(map(astuple, default)))
        return None if same else self.capsules

    def is_like(self, other: FileLimb) -> bool:
        """Return whether another limb has the same figures, to the last rounded digit."""
        return _alike(self._figures, other._figures)

    @property
    def _figures(self) -> tuple[Any, ...]:
        """What limbs that are like each other have in common, in nested tuples."""
        limb, shapes = self.limb, tuple(map(astuple, self.capsules))
        held = limb.held_joint, limb.held_angle, *limb.senses.tolist()
        lengths = *limb.steps.ravel().tolist(), *limb.limits.ravel().tolist()
        return (*held, lengths, shapes, astuple(self.dynamics), self.gripper_mass)


def limb_of(
    file: Description, members: LimbParts, options: FileOptions, length: float, body: Array
) -> FileLimb:
    """Return a limb of a file, whose flange is made to lie at a distance from the grasp [m].

    The frame of the robot's body in the world has shape (4, 4). Raises a `RobotError` if a figure
    is missing.
    """
    arm, notes = members.arm, list[str]()
    limb, base = members.chain.limb, members.chain.mount
    shift = round(members.tool_length - length, DECIMALS)
    if limb.base_in_mount is not None:
        base = base @ rigid(*limb.base_in_mount)
    if shift:
        limb = limb.with_flange_moved(shift)
    frames = base @ limb.frames_at_zero
    if arm.held is not None:
        joint, held = arm.held
        notes.append(f"joint {file.joints[joint].name} held at {held.angle:g} rad")
    if closed_form(limb.steps) is None:
        notes.append("of no closed form, solved numerically")
    masses = [joined(file, part, frame) for _, part, frame in members.on(frames)]
    if members.gripper:
        masses, gripper_mass = _with_gripper(file, members, frames[6], masses, shift)
    else:
        masses, gripper_mass = masses[:7], GRIPPER_MASS
        notes.append(f"a gripper of {members.tool_length:g} m and {gripper_mass:g} kg added")
    rotors = tuple(file.joints[joint].rotor for joint in arm.joints)
    if options.rotor_inertia is not None:
        rotors = (options.rotor_inertia,) * len(rotors)
    elif ROTORS in file.fields:
        rotors = figures_of_limb(file, ROTORS, members.number)
    elif None in rotors:
        notes.append(f"rotor inertias of {ROTOR_INERTIA:g} kg m^2 assumed")
    known_rotors = tuple(ROTOR_INERTIA if rotor is None else rotor for rotor in rotors)
    dynamics = _dynamics(file, arm, masses, known_rotors)
    apart: tuple[tuple[str, str], ...] = ()
    if options.capsules is None:
        capsules, excess = fitted_capsules(file, members, frames, length)
        if not members.gripper:
            capsules = (*capsules, gripper_capsule(length, shift))
        apart = links_apart(file, members, base, limb)
    elif isinstance(options.capsules, str):
        capsules, excess = default_capsules(limb, length), {}
        notes.append("collision shapes are not the file's but along the links")
    else:
        capsules, excess = options.capsules, {}
    return FileLimb(
        limb, tuple(file.joints[joint].name for joint in arm.joints),
        inverse(body) @ members.chain.mount, capsules, excess, dynamics, length, gripper_mass,
        apart, limb_visuals(file, members, frames), tuple(notes),
    )  # fmt: skip


def _dynamics(
    file: Description, arm: FileArm, masses: list[RigidBody], rotors: tuple[float, ...]
) -> LimbDynamics:
    """Return masses, inertias and limits of the limb, whose rotors have given inertias."""
    figures = [file.joints[joint] for joint in arm.joints]
    for one in figures:
        if one.torque is None:
            raise RobotError(
                f"joint {one.name!r} has no torque limit; give from_urdf or from_mjcf "
                "torque_limits [N m] (URDF: effort; MJCF: actuatorfrcrange, or forcerange)"
            )
        if not one.speed:
            raise RobotError(
                f"joint {one.name!r} has no speed limit; give from_urdf or from_mjcf speed_limits "
                "above 0 [rad/s] (URDF: velocity; MJCF: a <numeric> named 'speed_limits')"
            )
    for link, part in zip(arm.links, masses[1:], strict=True):
        if part.mass <= 0.0:
            raise RobotError(
                f"link {file.model.body(link).name!r} has no mass; give it an inertial with the "
                "mass [kg] and the inertia [kg m^2]"
            )
        moments = part.principal_moments
        if moments[0] <= 2.0 * LEAST_MASS:
            raise RobotError(
                f"link {file.model.body(link).name!r} has {part.mass:g} kg and the principal "
                f"moments {', '.join(f'{moment:.3g}' for moment in moments)} kg m^2; give its "
                "inertial moments above 0"
            )
    base = masses[0]
    size = _cylinder_of(base)
    return LimbDynamics(
        base.mass,
        tuple(part.mass for part in masses[1:]),
        tuple(part.centre for part in masses[1:]),
        tuple(part.inertia for part in masses[1:]),
        tuple(float(one.torque or 0.0) for one in figures),
        tuple(float(one.speed or 0.0) for one in figures),
        rotors,
        size,
        None if size or not base.mass else base.centre,
        None if size or not base.mass else base.inertia,
    )


def _cylinder_of(base: RigidBody) -> tuple[float, float] | None:
    """Return radius and length [m] of the cylinder on the body that a base is, None if none."""
    if not base.mass:
        return None
    radius = float(np.sqrt(2.0 * base.inertia[2] / base.mass))
    length = 2.0 * base.centre[2]
    if radius < MIN_SIZE or length < MIN_SIZE:
        return None
    same = _same(base, cylinder(base.mass, radius, length, 0.5 * length))
    return (radius, length) if same else None


def _with_gripper(
    file: Description, members: LimbParts, flange: Array, masses: list[RigidBody], shift: float
) -> tuple[list[RigidBody], float]:
    """Return masses of base and links, and that of a gripper that is none of them.

    `masses` has the file's gripper last, whose own flange lies `shift` behind the limb's [m].
    """
    gripper, length = masses[7], members.tool_length
    radius = arm_data("ur5e")["gripper"]["radius"]
    middle = 0.5 * length - shift
    if _same(gripper, cylinder(gripper.mass, radius, max(length, 0.01), middle)):
        return masses[:7], gripper.mass
    last = joined(file, (*members.links[5], *members.gripper), flange)
    return [*masses[:6], last], 0.0


def _same(first: RigidBody, second: RigidBody) -> bool:
    """Return whether two bodies move alike."""
    figures = [(body.mass, *body.centre, *body.inertia) for body in (first, second)]
    return bool(np.allclose(figures[0], figures[1], rtol=1e-9, atol=1e-9))


def _alike(one: object, other: object) -> bool:
    """Return whether nested tuples are equal but for rounding of their numbers."""
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_alike, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return bool(np.isclose(one, other, atol=1e-6))
    return one == other
