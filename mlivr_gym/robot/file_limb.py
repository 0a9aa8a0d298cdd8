"""One limb of a URDF or MJCF file: its chain of joints, its masses and its shapes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import astuple, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.kinematics.forms import closed_form, foot
from mlivr_gym.robot.capsules import LINKS, Capsule, default_capsules
from mlivr_gym.robot.description import LEAST_MASS, Description, JointData
from mlivr_gym.robot.fields import RobotFields
from mlivr_gym.robot.file_arms import FileArm
from mlivr_gym.robot.file_options import FileOptions
from mlivr_gym.robot.file_shapes import fitted_capsules
from mlivr_gym.robot.limb import Limb, link_frames
from mlivr_gym.robot.limb_dynamics import LimbDynamics
from mlivr_gym.robot.rigid import (
    RigidBody,
    combined,
    frame_on,
    inverse,
    quaternion_of,
    rigid,
    turn_about_z,
)
from mlivr_gym.robot.validators import FARTHEST_TURN
from mlivr_gym.robot.visuals import MOST_VISUALS, Visual
from mlivr_gym.values import MAX_ROBOT_LENGTH, as_triple

ROTOR_INERTIA = 0.1
"""Inertia of a rotor where neither file nor caller gives one [kg m^2]: MuJoCo Menagerie's UR arms.
"""

SHORTEST_GRIPPER = 0.01
"""A grasp that is nearer to the first shape behind the flange is the flange itself [m]."""

MEETING = 1e-3
"""Largest distance of the flange from the last axis [m]."""

MOST_TILT = 1.0
"""Largest angle between the last joint's axis and the nearest axis of the tool frame [deg]."""

ENDLESS = 1000.0
"""Limit from which on a joint turns without end [rad]."""

SAME = 1e-11
"""Parts of frames below this are rounding errors [m, rad]."""


class LimbParts(NamedTuple):
    """Bodies of a limb by their numbers in the model, and where it grasps."""

    arm: FileArm
    """Its joints."""
    base: tuple[int, ...]
    """Bodies that fix the limb to the robot's body."""
    links: tuple[tuple[int, ...], ...]
    """Bodies that move with each joint, six tuples; the last is without the gripper."""
    gripper: tuple[int, ...]
    """Bodies of the gripper, empty if the file has none."""
    grasp: Array
    """Grasp frame in the world, shape (4, 4); its z axis is the last joint's."""
    tool_length: float
    """Distance from the flange to the grasp, of the file's gripper or of the one that is added [m].
    """
    tilt: str
    """A note on a tool frame whose z axis is not along the last joint, else empty."""

    def on(self, frames: Array) -> Iterator[tuple[str, tuple[int, ...], Array]]:
        """Yield name, bodies and frame of base, links and gripper; `frames` are (7, 4, 4)."""
        members = (self.base, *self.links, self.gripper)
        return zip(LINKS, members, (*frames, frames[6]), strict=True)


class FileLimb(NamedTuple):
    """A limb of a file."""

    limb: Limb
    """Its kinematics."""
    joint_names: tuple[str, ...]
    """Names of its joints that move."""
    mount: Array
    """Its mount in the world, shape (4, 4)."""
    capsules: tuple[Capsule, ...]
    """Collision shapes."""
    excess: dict[str, float]
    """Largest excess of the capsules of each link [m]."""
    dynamics: LimbDynamics | None
    """Masses, inertias and limits; None if the file does not have them all."""
    gripper_mass: float
    """Mass of a gripper that the last link does not include [kg]."""
    visuals: tuple[Visual, ...]
    """Meshes that show it."""
    notes: tuple[str, ...]
    """What the file does not say, in words."""

    def is_like(self, other: FileLimb) -> bool:
        """Return whether another limb has the same figures, to the last rounded digit."""
        mine, theirs = (
            _flat((one.limb, one.capsules, one.dynamics, one.gripper_mass)) for one in (self, other)
        )
        return len(mine) == len(theirs) and all(
            a == b
            or (isinstance(a, float) and isinstance(b, float) and np.isclose(a, b, atol=1e-6))
            for a, b in zip(mine, theirs, strict=True)
        )


def _flat(value: Any) -> list[Any]:
    """Return the numbers and words in records and nested tuples."""
    value = astuple(value) if is_dataclass(value) and not isinstance(value, type) else value
    return [x for part in value for x in _flat(part)] if isinstance(value, tuple) else [value]


def limb_parts(
    file: Description, arm: FileArm, base: tuple[int, ...], given: float | None
) -> LimbParts:
    """Return the bodies of an arm, whose base is known.

    Shapes behind the last link are a gripper, or else, and where a tool length is given [m], belong
    to that link. Raises a `RobotError` if the tool frame lies beside the last axis, or leans.
    """
    moved = [file.body_of(joint) for joint in arm.moving]
    nearest, last = file.nearest(moved), moved[-1]
    links = [tuple(np.flatnonzero(nearest == body).tolist()) for body in moved]
    tool = file.frame(arm.tool.body) @ arm.tool.frame
    axes, anchors = file.lines(arm.joints)
    off = float(np.linalg.norm(np.cross(tool[:3, 3] - anchors[-1], axes[-1])))
    if off > MEETING:
        name = file.joints[arm.joints[-1]].name
        raise RobotError(
            f"the flange lies {off:.3g} m off the axis of joint {name!r}; it must lie on it, "
            "choose another with tool_frame"
        )
    wrist = foot(axes, anchors, -1, -2)
    sense = _sense_of((tool[:3, 3] - wrist) @ axes[-1], tool[:3, 2] @ axes[-1])
    grasp = frame_on(tool, sense * axes[-1], anchors[-1], tool[:3, 3])
    tilt = _tilt_of(file, arm, grasp[:3, 2] @ tool[:3, :3])
    gripper: tuple[int, ...] = ()
    length = RobotFields.tool_length if given is None else given
    if given is None:
        shaped = [body for body in links[-1] if body != last and file.solid_geoms(body)]
        behind = tuple(body for body in links[-1] if file.nearest(shaped)[body])
        fingers = [body for body in behind if file.moved[body] != last]
        starts = [*behind[:1], *([last] if fingers else [])]
        before = [float((grasp[:3, 3] - file.data.xpos[body]) @ grasp[:3, 2]) for body in starts]
        long = [one for one in before if one >= SHORTEST_GRIPPER]
        if long or fingers:
            gripper, length = behind, round(long[0], 9) if long else 0.0
    if not gripper:
        grasp[:3, 3] += length * grasp[:3, 2]
    links[-1] = tuple(body for body in links[-1] if body not in gripper)
    return LimbParts(arm, base, tuple(links), gripper, grasp, length, tilt)


def _tilt_of(file: Description, arm: FileArm, cosines: Array) -> str:
    """Return a note on the angles of the axes of a tool frame from the direction of the grasp.

    Raises a `RobotError` if none of the three axes lies along it.
    """
    name, angles = file.joints[arm.joints[-1]].name, np.rad2deg(np.arccos(np.clip(cosines, -1, 1)))
    lean = float(np.minimum(angles, 180.0 - angles).min())
    if lean > MOST_TILT:
        raise RobotError(
            f"the tool frame {arm.tool.name!r} leans by {lean:.3g} degrees from the axis of joint "
            f"{name!r}, along which a limb grasps; choose another with tool_frame, such as the "
            "last link"
        )
    if angles[2] <= MOST_TILT:
        return ""
    return (
        f"the limb grasps along joint {name}, {angles[2]:.3g} degrees from the z axis of tool "
        f"frame {arm.tool.name}"
    )


def mount_of(file: Description, arm: FileArm, up: Array | None = None) -> Array:
    """Return the mount of an arm in the world, shape (4, 4).

    The axis of the first joint, in the sense in which the arm lies over its base, is its z axis.
    Its x axis is as a direction `up`, or if none is given as that of the link that carries it.
    """
    axes, anchors = file.lines(arm.joints)
    base = file.frame(file.parent(file.body_of(arm.joints[0])))
    shoulder = foot(axes, anchors, 0, 1)
    sense = _sense_of((shoulder - base[:3, 3]) @ axes[0], base[:3, 2] @ axes[0])
    hint = base.copy()
    if up is not None:
        hint[:3, 0], hint[:3, 1] = up, base[:3, np.abs(axes[0] @ base[:3, :3]).argmin()]
    return frame_on(hint, sense * axes[0], anchors[0], base[:3, 3])


def _sense_of(length: float, otherwise: float) -> float:
    """Return the sense that makes a length positive, or another number if the length is 0."""
    number = length if abs(length) > MEETING else otherwise
    return -1.0 if number < -MEETING else 1.0


def joined(file: Description, members: Iterable[int], frame: Array) -> RigidBody:
    """Return bodies of a file as one, as seen from a frame of the world, shape (4, 4)."""
    model, data, parts = file.model, file.data, []
    for body in members:
        mass = float(model.body_mass[body])
        if mass > 2.0 * LEAST_MASS:
            place = rigid(data.ximat[body].reshape(3, 3), data.xipos[body])
            moments = (*model.body_inertia[body].tolist(), 0.0, 0.0, 0.0)
            parts.append(RigidBody(mass, (0.0, 0.0, 0.0), moments).moved(place))
    if not parts:
        return RigidBody(0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
    return combined(parts).moved(inverse(frame))


def limb_of(
    file: Description, parts: LimbParts, options: FileOptions, length: float, up: Array | None
) -> FileLimb:
    """Return a limb of a file, whose flange is made to lie at a distance from the grasp [m].

    The x axis of its mount is as a direction `up`, or if none is given as that of the link that
    carries it. Raises a `RobotError` if the joints are those of no limb.
    """
    arm, notes = parts.arm, [parts.tilt] if parts.tilt else []
    flange = parts.grasp @ rigid(np.eye(3), (0.0, 0.0, -length))
    limb, mount = _chain_of(file, arm, flange, up)
    frames = mount @ limb.base_in_mount @ link_frames(limb, np.zeros(6))
    if arm.locked is not None:
        name = file.joints[arm.joints[arm.locked]].name
        notes.append(f"joint {name} locked at {arm.angle:g} rad")
    if closed_form(limb.steps) is None:
        notes.append("of no closed form, solved numerically")
    added = 0.0 if parts.gripper else RobotFields.gripper_mass
    if not parts.gripper:
        notes.append(f"a gripper of {parts.tool_length:g} m and {added:g} kg added")
    excess: dict[str, float] = {}
    if options.capsules is None:
        capsules, excess = fitted_capsules(file, parts.on(frames), length, bool(parts.gripper))
    elif isinstance(options.capsules, str):
        capsules = default_capsules(limb, length)
        notes.append("collision shapes are not the file's but along the links")
    else:
        capsules = options.capsules
    seen = tuple(
        mesh.seen_from(link, inverse(frame) @ file.frame(body), file.model)
        for link, members, frame in parts.on(frames)
        for body in members
        for mesh in file.meshes_of(body)
    )
    dynamics = _dynamics(file, parts, options, frames, notes)
    return FileLimb(
        limb, tuple(file.joints[joint].name for joint in arm.moving), mount, capsules, excess,
        dynamics, added, seen[:MOST_VISUALS], tuple(notes),
    )  # fmt: skip


def _chain_of(
    file: Description, arm: FileArm, flange: Array, up: Array | None
) -> tuple[Limb, Array]:
    """Return the chain of an arm and its mount in the world, by its flange there, (4, 4).

    The frame of a link has its origin where the joint's axis is closest to that of the
    link before, and its x axis as the file has it.
    """
    axes, anchors = file.lines(arm.joints)
    data = [file.joints[joint] for joint in arm.joints]
    length = float(np.linalg.norm(np.diff([*anchors, flange[:3, 3]], axis=0), axis=1).sum())
    if length > MAX_ROBOT_LENGTH:
        raise RobotError(
            f"the limb of joints {data[0].name!r} to {data[-1].name!r} is {length:.4g} m long; it "
            f"must be at most {MAX_ROBOT_LENGTH:g} m: lengths are in metres, is the file in "
            "millimetres?"
        )
    mount, senses = mount_of(file, arm, up), np.ones(len(data))
    senses[0], senses[-1] = np.sign([mount[:3, 2] @ axes[0], flange[:3, 2] @ axes[-1]])
    along, frames = senses[:, None] * axes, [mount]
    for k, joint in enumerate(arm.joints[:-1]):
        place = (anchors[0], foot(axes, anchors, 1, 0))[k] if k < 2 else frames[-1][:3, 3]
        frames.append(frame_on(file.frame(file.body_of(joint)), along[k], anchors[k], place))
    frames.append(flange)
    at_zero, locked = list(frames), dict[str, Any]()
    if arm.locked is not None:
        number = arm.locked + 1
        # In the file the joint is at its angle.
        at_zero[number] = frames[number] @ turn_about_z(-senses[arm.locked] * arm.angle)
        locked = {"locked_joint": number, "locked_angle": arm.angle}
    steps = np.array([inverse(frames[k]) @ at_zero[k + 1] for k in range(len(data))])
    steps[np.abs(steps) < SAME] = 0.0
    try:
        limb = Limb(
            tuple(as_triple(step[:3, 3]) for step in steps),
            tuple(map(tuple, quaternion_of(steps[:, :3, :3]).tolist())),
            tuple(map(_limits, data)),
            None if (senses > 0.0).all() else tuple(senses.tolist()), **locked,
        )  # fmt: skip
    except RobotError as fault:
        if arm.locked is None:
            raise
        raise RobotError(
            f"joint {data[arm.locked].name!r} cannot be locked at {arm.angle:g} rad, give another "
            f"locked_angle or locked_joint: {fault}"
        ) from None
    return limb, mount


def _limits(joint: JointData) -> tuple[float, float]:
    if joint.limits is None:
        raise RobotError(
            f"joint {joint.name!r} has no limits; give it a lower and an upper angle [rad], the "
            "lower one first"
        )
    low, high = joint.limits
    if FARTHEST_TURN < max(abs(low), abs(high)) < ENDLESS:
        raise RobotError(
            f"joint {joint.name!r} has limits from {low:g} to {high:g} rad; angles are in radians, "
            f"at most {FARTHEST_TURN:g}: are these degrees?"
        )
    return max(low, -FARTHEST_TURN), min(high, FARTHEST_TURN)


def _dynamics(
    file: Description, parts: LimbParts, options: FileOptions, frames: Array, notes: list[str]
) -> LimbDynamics | None:
    """Return masses, inertias and limits of a limb, None if the file does not have them all.

    What is missing is added to the notes, and what is assumed.
    """
    joints = [file.joints[joint] for joint in parts.arm.moving]
    base, *links = [joined(file, members, frame) for _, members, frame in parts.on(frames)][:6]
    links.append(joined(file, (*parts.links[5], *parts.gripper), frames[6]))
    missing = {
        "mass or inertia of link": [
            file.name_of(file.body_of(joint))
            for joint, link in zip(parts.arm.moving, links, strict=True)
            if link.mass <= 0.0 or link.principal_moments[0] <= 2.0 * LEAST_MASS
        ],
        "torque limit of joint": [one.name for one in joints if not one.torque],
        "speed limit of joint": [one.name for one in joints if not one.speed],
    }
    told = [f"{what} {', '.join(names)}" for what, names in missing.items() if names]
    if told:
        notes.append(f"not to be simulated, the file lacks {'; '.join(told)}")
        return None
    given = options.rotor_inertia
    rotors = [one.rotor if given is None else given for one in joints]
    if None in rotors:
        notes.append(f"rotor inertias of {ROTOR_INERTIA:g} kg m^2 assumed")
    masses, centres, inertias = zip(*links, strict=True)
    return LimbDynamics(
        base.mass,
        masses,
        centres,
        inertias,
        tuple(float(one.torque or 0.0) for one in joints),
        tuple(float(one.speed or 0.0) for one in joints),
        tuple(ROTOR_INERTIA if rotor is None else rotor for rotor in rotors),
        base.centre if base.mass else None,
        base.inertia if base.mass else None,
    )
