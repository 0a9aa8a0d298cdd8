"""One limb of a URDF or MJCF file in the terms of its family."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.any_limb import AnyLimb
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.description import LEAST_MASS, ROTORS, WINDOWS, Description
from mlivr_gym.robot.file_arms import FileArm, chain_of, limb_in_family, tool_frame_of
from mlivr_gym.robot.file_chain import FileChain
from mlivr_gym.robot.file_parts import LimbParts, limb_parts
from mlivr_gym.robot.file_shapes import fitted_capsules, limb_visuals, links_apart
from mlivr_gym.robot.joint_chain import DECIMALS, JointChain, RecognisedArm
from mlivr_gym.robot.limb_dynamics import LimbDynamics, arm_data
from mlivr_gym.robot.link_frames import inverse, link_frames, rigid
from mlivr_gym.robot.numeric_limb import NumericLimb
from mlivr_gym.robot.recognition import recognised
from mlivr_gym.robot.rigid import RigidBody, cylinder, joined
from mlivr_gym.robot.stretched import gripper_capsule, stretched_capsules
from mlivr_gym.robot.visuals import Visual
from mlivr_gym.values import MAX_ROBOT_LENGTH, MIN_SIZE

ROTOR_INERTIA = 0.1
"""Inertia of a rotor where neither file nor caller gives one [kg m^2]: MuJoCo Menagerie's UR arms.
"""

TOOL_LENGTH, GRIPPER_MASS = 0.05, 0.5
"""Length [m] and mass [kg] of the gripper that is added to an arm without one."""

SAMPLES = 100
"""Number of random joint angles at which the flange is compared with that of the file."""

LARGEST_ERROR = 5e-3
"""Largest distance of the flange from that of the file [m]; grasps are captured within 10 mm."""


@dataclass(frozen=True)
class LimbOptions:
    """What a caller says of limbs, see `from_file.read_robot`."""

    tool_length: float | None
    rotor_inertia: float | None
    capsules: Sequence[Capsule] | str | None


@dataclass(frozen=True)
class FileLimb:
    """A limb of a file."""

    limb: AnyLimb
    """Lengths and joint limits."""
    joint_names: tuple[str, ...]
    """Names of its joints that move."""
    signs: Array
    """Signs of its joint angles, see `recognition.RecognisedArm`."""
    offsets: Array
    """Offsets of its joint angles [rad]."""
    mount: Array
    """Base frame of the limb in the world, later in the body's frame, shape (4, 4)."""
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
    position_error: float
    """Largest distance of the flange from that of the file [m]."""
    chain: FileChain
    """Its joints that move as the file has them."""
    apart: tuple[tuple[str, str], ...]
    """Links whose shapes never meet, see `RobotSpec.apart`."""
    visuals: tuple[Visual, ...]
    """Meshes that show it."""
    notes: tuple[str, ...] = field(default=())
    """What the file does not say, in words."""

    @property
    def described_capsules(self) -> tuple[Capsule, ...] | None:
        """Its collision shapes, None if they are those that a limb has by default."""
        default = stretched_capsules(self.limb, self.tool_length)
        return None if _all_alike(self.capsules, default) else self.capsules

    def is_like(self, other: FileLimb) -> bool:
        """Return whether another limb has the same figures, to the last rounded digit."""
        return (
            self.limb.family_code == other.limb.family_code
            and self.limb.held_joint == other.limb.held_joint
            and math.isclose(self.limb.held_angle, other.limb.held_angle, abs_tol=1e-6)
            and np.allclose(self.limb.lengths, other.limb.lengths, atol=1e-6)
            and np.allclose(self.limb.limits, other.limb.limits, atol=1e-6)
            and _all_alike(self.capsules, other.capsules)
            and _same_dynamics(self.dynamics, other.dynamics)
            and self.gripper_mass == other.gripper_mass
        )

    def with_tool_length(self, length: float) -> FileLimb:
        """Return the limb with its flange elsewhere on the last axis, the grasp where it was."""
        shift = round(self.tool_length - length, DECIMALS)
        if not shift:
            return self

        def moved(capsule: Capsule) -> Capsule:
            if capsule.link not in LINKS[6:]:
                return capsule
            low, high = capsule.start[2] - shift, capsule.end[2] - shift
            return replace(capsule, start=(0.0, 0.0, low), end=(0.0, 0.0, high))

        def seen(visual: Visual) -> Visual:
            x, y, z = visual.position
            return (
                replace(visual, position=(x, y, z - shift)) if visual.link in LINKS[6:] else visual
            )

        along = np.eye(4)
        along[2, 3] = shift
        x, y, z = self.dynamics.centres[5]
        centres = (*self.dynamics.centres[:5], (x, y, z - shift))
        return replace(
            self,
            limb=self.limb.with_flange_moved(shift),
            chain=self.chain._replace(flange=self.chain.flange @ along),
            capsules=tuple(map(moved, self.capsules)),
            dynamics=replace(self.dynamics, centres=centres),
            tool_length=length,
            visuals=tuple(map(seen, self.visuals)),
        )

    def turned(self, angle: float) -> FileLimb:
        """Return the limb with its base frame turned about the first axis [rad]."""
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        (low, high), *others = self.limb.joint_limits
        fields: dict[str, Any] = {"joint_limits": ((low - angle, high - angle), *others)}
        if self.limb.held_joint == 1:
            fields["held_angle"] = self.limb.held_angle - angle
            return replace(self, limb=replace(self.limb, **fields), mount=self.mount @ turn)
        offsets = self.offsets.copy()
        offsets[0] -= angle

        def back(point: Any) -> Any:
            return tuple((turn[:3, :3].T @ np.array(point)).tolist())

        capsules = tuple(
            replace(c, start=back(c.start), end=back(c.end)) if c.link == "base" else c
            for c in self.capsules
        )
        dynamics = self.dynamics
        if dynamics.base_centre is not None and dynamics.base_inertia is not None:
            base = RigidBody(1.0, dynamics.base_centre, dynamics.base_inertia).moved(turn.T)
            dynamics = replace(dynamics, base_centre=base.centre, base_inertia=base.inertia)
        return replace(
            self,
            limb=replace(self.limb, **fields), chain=self.chain.seen_from(turn),
            offsets=offsets, mount=self.mount @ turn, capsules=capsules, dynamics=dynamics,
            visuals=tuple(v.turned(turn[:3, :3]) if v.link == "base" else v for v in self.visuals),
        )  # fmt: skip


def limb_of(
    file: Description, arms: tuple[FileArm, ...], number: int, options: LimbOptions
) -> FileLimb:
    """Return the limb of a file that one of its arms is, by number and by what the caller says.

    Raises a `RobotError` if its joints are those of no known family, or a figure is missing.
    """
    arm = arms[number]
    tool = tool_frame_of(file.data, arm)
    _check_size(file, arm, tool)
    members = limb_parts(file, arms, number, options.tool_length is None)
    joints = chain_of(file, arm, members.flange)
    found = recognised(joints)
    limb = limb_in_family(file, arm, found)
    if file.is_exported:
        limb = replace(limb, window_starts=_of_limb(file, WINDOWS, number))
    found = found._replace(offsets=found.offsets + limb.joint_shifts)
    frames = _base_of(limb, found) @ link_frames(limb, found.offsets)
    notes = []
    if arm.held is not None:
        joint, held = arm.held
        notes.append(f"joint {file.joints[joint].name} held at {held.angle:g} rad")
    if isinstance(limb, NumericLimb):
        notes.append("of no closed form, solved numerically")
    length, gripper_mass = members.tool_length, 0.0
    if not members.gripper:
        length = TOOL_LENGTH if options.tool_length is None else options.tool_length
        gripper_mass = GRIPPER_MASS
        notes.append(f"a gripper of {length:g} m and {gripper_mass:g} kg added")
    masses = [
        joined(file.model, file.data, part, frame) for part, frame in members.with_frames(frames)
    ]
    if members.gripper:
        masses, gripper_mass = _with_gripper(file, members, frames, masses)
    dynamics = _dynamics(file, arm, masses)
    rotors = tuple(file.joints[joint].rotor for joint in arm.joints)
    if options.rotor_inertia is not None:
        rotors = (options.rotor_inertia,) * len(rotors)
    elif ROTORS in file.fields:
        rotors = _of_limb(file, ROTORS, number)
    elif None in rotors:
        notes.append(f"rotor inertias of {ROTOR_INERTIA:g} kg m^2 assumed")
    known_rotors = tuple(ROTOR_INERTIA if rotor is None else rotor for rotor in rotors)
    dynamics = replace(dynamics, rotor_inertias=known_rotors)
    apart: tuple[tuple[str, str], ...] = ()
    if options.capsules is None:
        capsules, excess = fitted_capsules(file, members, frames, length)
        if not members.gripper:
            capsules = (*capsules, gripper_capsule(length))
        apart = links_apart(file, members, frames, limb)
    elif isinstance(options.capsules, str):
        capsules, excess = stretched_capsules(limb, length), {}
        notes.append("collision shapes are not the file's but along the links")
    else:
        capsules, excess = tuple(options.capsules), {}
    chain = _chain_in_base(joints, limb, found)
    error = _position_error(chain, limb, found, file.joints[arm.joints[-1]].name)
    if error > 1e-4:
        notes.append(f"flanges differ from the file's by {1e3 * error:.2g} mm at most")
    return FileLimb(
        limb, tuple(file.joints[joint].name for joint in arm.joints), found.signs, found.offsets,
        found.mount, capsules, excess, dynamics, length, gripper_mass, error, chain,
        apart, limb_visuals(file, members, frames), tuple(notes),
    )  # fmt: skip


def _check_size(file: Description, arm: FileArm, tool: Array) -> None:
    """Refuse an arm longer than any robot, which is probably given in millimetres."""
    points = np.vstack([file.data.xanchor[list(arm.joints)], tool[:3, 3]])
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if length > MAX_ROBOT_LENGTH:
        raise RobotError(
            f"the limb of joints {file.joints[arm.joints[0]].name!r} to "
            f"{file.joints[arm.joints[-1]].name!r} is {length:.4g} m long; it must be at most "
            f"{MAX_ROBOT_LENGTH:g} m: lengths are in metres, is the file in millimetres?"
        )


def _of_limb(file: Description, name: str, number: int) -> Any:
    """Return figures of one limb that a file of this package names."""
    listed = file.fields[name]
    if not isinstance(listed, list) or len(listed) <= number:
        raise RobotError(f"{name} of the file must be a list of six numbers for each limb")
    return listed[number]


def _dynamics(file: Description, arm: FileArm, masses: list[RigidBody]) -> LimbDynamics:
    """Return masses, inertias and limits of the limb, without inertias of rotors."""
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
        (0.0,) * len(figures),
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
    file: Description, members: LimbParts, frames: Array, masses: list[RigidBody]
) -> tuple[list[RigidBody], float]:
    """Return the masses with the file's gripper, and the mass of a gripper that is none of them."""
    gripper = joined(file.model, file.data, members.gripper, frames[6])
    radius = arm_data("ur5e")["gripper"]["radius"]
    length = members.tool_length
    if _same(gripper, cylinder(gripper.mass, radius, max(length, 0.01), 0.5 * length)):
        return masses, gripper.mass
    last = joined(file.model, file.data, (*members.links[5], *members.gripper), frames[6])
    return [*masses[:6], last], 0.0


def _same(first: RigidBody, second: RigidBody) -> bool:
    """Return whether two bodies move alike."""
    figures = [(body.mass, *body.centre, *body.inertia) for body in (first, second)]
    return bool(np.allclose(figures[0], figures[1], rtol=1e-9, atol=1e-9))


def _chain_in_base(chain: JointChain, limb: AnyLimb, found: RecognisedArm) -> FileChain:
    """Return the joints of a file that move, in the base frame of the limb."""
    base, moving = _base_of(limb, found), chain.moving
    tool = inverse(base @ link_frames(limb, found.offsets)[6]) @ chain.flange
    tool[:3, 3] = 0.0
    flange = chain.flange @ inverse(tool)
    return FileChain(moving.axes, moving.anchors, flange).seen_from(base)


def _position_error(chain: FileChain, limb: AnyLimb, found: RecognisedArm, last: str) -> float:
    """Return the largest distance of the flange from that of the file over random angles [m]."""
    rng, worst = np.random.default_rng(0), 0.0
    probes = np.array([[0.0, 0.1, 0.0], [0.0, 0.0, 0.1], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    for _ in range(SAMPLES):
        angles = rng.uniform(-np.pi, np.pi, len(chain.axes))
        ours = link_frames(limb, found.signs * angles + found.offsets)[6]
        apart = (chain.flange_at(angles) - ours) @ probes
        worst = max(worst, float(np.linalg.norm(apart[:3], axis=0).max()))
    if worst > LARGEST_ERROR:
        raise RobotError(
            f"the flange of joint {last!r} lies up to {worst:.3g} m "
            f"from where exact axes would bring it; it must be at most {LARGEST_ERROR:g} m"
        )
    return worst


def _base_of(limb: AnyLimb, found: RecognisedArm) -> Array:
    """Return the base frame of the joints that move, see `LimbBase.base_in_mount`."""
    if limb.base_in_mount is None:
        return found.mount
    base: Array = found.mount @ rigid(*limb.base_in_mount)
    return base


def _all_alike(some: tuple[Capsule, ...], others: tuple[Capsule, ...]) -> bool:
    """Return whether capsules are equal but for rounding."""
    if [one.link for one in some] != [one.link for one in others]:
        return False
    first, second = ([(*c.start, *c.end, c.radius) for c in each] for each in (some, others))
    return bool(np.allclose(first, second, atol=1e-6))


def _same_dynamics(first: LimbDynamics, second: LimbDynamics) -> bool:
    """Return whether two limbs move alike but for rounding."""
    for name in LimbDynamics.__dataclass_fields__:
        a, b = getattr(first, name), getattr(second, name)
        if (a is None) != (b is None) or (a is not None and not np.allclose(a, b, atol=1e-6)):
            return False
    return True
