"""Robots from URDF and MJCF files.

A file is either one arm, of which several are mounted evenly round a body, or a whole robot, whose
body and limbs are found from the tree of its links. Lengths, limits, masses, inertias and collision
shapes come from the file; whatever it does not say is named in `RobotSpec.source`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import FileName
from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError, path_shown
from mlivr_gym.robot.description import ROTORS, WINDOWS, Description, read_description
from mlivr_gym.robot.file_arms import arms_of, body_frame, body_name, with_held_joints
from mlivr_gym.robot.file_chain import LIMBS
from mlivr_gym.robot.file_limb import FILE_OPTIONS, FileLimb, FileOptions, limb_of
from mlivr_gym.robot.file_parts import LimbParts, body_parts, joined, limb_parts
from mlivr_gym.robot.file_shapes import box_round, solids
from mlivr_gym.robot.link_frames import inverse, rigid
from mlivr_gym.robot.mounts import Mount
from mlivr_gym.robot.planning_lengths import CHARACTERISTIC_LENGTH, HEIGHTS, SPAN
from mlivr_gym.robot.rigid import RigidBody, box_inertia
from mlivr_gym.schema import FieldPath
from mlivr_gym.values import MAX_REMARK_LENGTH, Triple

UR5E_ARM = 0.425 + 0.3922
"""Length of the UR5e's upper arm and forearm [m], to which the default base heights belong."""

UPPER_ARM_GAP = 0.03
"""Distance of an upper arm from the body [m]: more than the clearance that plans keep."""

KEPT_APART = (WINDOWS, ROTORS, LIMBS)
"""Fields of a file of this package that are none of `RobotSpec`."""

EVEN = 1e-6
"""Largest deviation of axes and positions [m] that counts as mounted at equal angles."""


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
    def capsule_excess(self) -> tuple[dict[str, float], ...]:
        """How far capsules reach beyond the shapes of each link at most [m], by limb and link."""
        return tuple(limb.excess for limb in self.file_limbs)


def read_robot(path: str | Path, **options: Any) -> RobotFile:
    """Read a robot from a URDF or MJCF file.

    Options are fields of `file_limb.FileOptions`, such as `limbs`, `tool_frame` or `speed_limits`,
    and further fields of `RobotSpec`, such as `name`, `heights` or `span`. Where `heights`, `span`
    and `characteristic_length` are not given, those of the default robot grow with the arm.

    Raises a `RobotError` if the file cannot be read, or describes a robot that is not supported;
    the message names the joint or link, its value and what would be valid.

    Examples
    --------
    >>> file = read_robot("my_arm.urdf", limbs=3, tool_frame="tool0")  # doctest: +SKIP
    >>> file.capsule_excess[0]["forearm"]  # doctest: +SKIP
    """
    name = FileName().read(path, FieldPath("path", RobotError))
    said = {key: value for key, value in options.items() if key in FILE_OPTIONS.validators}
    fields = {key: value for key, value in options.items() if key not in said}
    known = FILE_OPTIONS.read(said, FieldPath("", RobotError))
    return FieldPath(f"robot {path_shown(path)}", RobotError).build(_read, name, known, fields)


def _read(path: str, options: FileOptions, fields: dict[str, Any]) -> RobotFile:
    """Read a robot by what a caller says and by the fields that a caller gives."""
    file = read_description(path, options.package_dirs, options.speed_limits, options.torque_limits)
    arms = arms_of(file, options.tips, options.tool_frame)
    arms = with_held_joints(file, arms, options.held_joint, options.held_angle)
    parts = tuple(limb_parts(file, arms, k, options.tool_length) for k in range(len(arms)))
    if len(arms) == 1:
        return _of_one_arm(file, parts[0], options, fields)
    if options.limbs not in (None, len(arms)):
        raise RobotError(f"limbs is {options.limbs}; the file has {len(arms)} limbs")
    if options.mount_radius is not None:
        raise RobotError(
            f"mount_radius is {options.mount_radius}; the file is a whole robot of {len(arms)} "
            "limbs, whose mounts it names"
        )
    body, parts, build = _body_of(file, parts, options.body_size)
    # A limb's flange may lie anywhere on the axis of its last joint: all tools are made equal.
    shortest = min(part.tool_length for part in parts)
    limbs = tuple(limb_of(file, part, options, shortest, body) for part in parts)
    alike = all(limb.is_like(limbs[0]) for limb in limbs)
    if alike and "mount_radius" in build:
        build["limbs"] = len(limbs)
    else:
        build.pop("mount_radius", None)
        build["mounts"] = tuple(_mount(limb, alike) for limb in limbs)
    return RobotFile(_fields(file, limbs, fields, build), limbs)


def _of_one_arm(
    file: Description, parts: LimbParts, options: FileOptions, fields: dict[str, Any]
) -> RobotFile:
    """Return a robot of equal arms mounted evenly round a box."""
    limb = limb_of(file, parts, options, parts.tool_length, np.eye(4))
    count, size, radius = options.limbs or 2, options.body_size or 0.2, options.mount_radius
    if radius is None:
        radius = 0.5 * float(np.max(size)) + _stand_off(limb)
    build = {"limbs": count, "body_size": size, "mount_radius": radius}
    return RobotFile(_fields(file, (limb,), fields, build), (limb,) * count)


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
            lows.append(away + capsule.radius + UPPER_ARM_GAP - limb.limb.shoulder_height)
    return round(max(lows), 3)


def _body_of(
    file: Description, limbs: tuple[LimbParts, ...], size: float | Triple | None
) -> tuple[Array, tuple[LimbParts, ...], dict[str, Any]]:
    """Return the body of a whole robot: its frame in the world (4, 4), limbs, and robot's fields.

    If the limbs are mounted evenly its x axis points to limb 0, and its z axis is that round which
    they lie in order, the x axes of their bases along it; else its axes are those of the root link,
    and its origin the middle of its shapes. Its edge or three edges may be given [m]; else it is
    the box round its shapes. The fields are those of size and mass, and `mount_radius` if the
    limbs are mounted evenly. Raises a `RobotError` if the body has no mass, or no shape and no
    size.
    """
    members = body_parts(file, tuple(limb.arm for limb in limbs))
    name = body_name(file.model, members[0])
    root = body_frame(file.data, members[0])
    even = _even_frame(np.array([limb.chain.mount for limb in limbs]), root[:3, :3])
    frame = root if even is None else even[0]
    shapes = solids(file, members, frame)
    if not shapes and size is None:
        raise RobotError(f"the body {name!r} has no collision shape; give body_size [m]")
    if size is None:
        middle, half = box_round(shapes, even is not None)
        frame = frame.copy()
        frame[:3, 3] += frame[:3, :3] @ middle
        x, y, z = (2.0 * half).tolist()
        size = x if x == y == z else (x, y, z)
    solid = joined(file, members, frame)
    if not solid.mass:
        raise RobotError(
            f"link {name!r}, the body, has no mass; give it an inertial with the mass [kg] and the "
            "inertia [kg m^2]"
        )
    fields: dict[str, Any] = {
        "body_size": size,
        "body_mass": solid.mass,
        "body_centre": solid.centre,
        "body_inertia": _body_inertia(solid, size),
    }
    if even is not None:
        fields["mount_radius"] = even[1]
        limbs = tuple(_upright(limbs[k], frame) for k in even[2])
    return frame, limbs, fields


def _body_inertia(solid: RigidBody, size: float | Triple) -> tuple[float, ...] | None:
    """Return the inertia of a body, None if it is that of a homogeneous box."""
    box = box_inertia(solid.mass, np.broadcast_to(np.asarray(size, dtype=np.float64), 3))
    same = np.allclose(solid.inertia, box, rtol=1e-9, atol=1e-9)
    return None if same and np.allclose(solid.centre, 0.0, atol=1e-9) else solid.inertia


def _even_frame(mounts: Array, axes: Array) -> tuple[Array, float, tuple[int, ...]] | None:
    """Return the frame in which limbs are mounted evenly round z, their radius and their order.

    Mounts in the world have shape (N, 4, 4); z is one of some axes, columns of shape (3, 3).
    """
    count, outward, positions = len(mounts), mounts[:, :3, 2], mounts[:, :3, 3]
    centre = positions.mean(axis=0)
    radius = float(((positions - centre) * outward).sum(axis=1).mean())
    if radius < 0.0 or np.abs(positions - centre - radius * outward).max() > EVEN:
        return None
    for z in axes.T[::-1]:
        if np.abs(outward @ z).max() > EVEN:
            continue
        x = outward[0]
        angles = np.arctan2(outward @ np.cross(z, x), outward @ x)
        # What rounding leaves below 0 stays there, so that limb 0 comes first.
        angles = (angles + EVEN) % (2.0 * np.pi) - EVEN
        order = np.argsort(angles)
        gaps = np.diff([*angles[order], 2.0 * np.pi])
        if np.abs(gaps - 2.0 * np.pi / count).max() <= 10.0 * EVEN:
            frame = rigid(np.stack([x, np.cross(z, x), z], axis=1), centre)
            return frame, round(radius, 9), tuple(order.tolist())
    return None


def _upright(limb: LimbParts, body: Array) -> LimbParts:
    """Return a limb whose base has its x axis along the z axis of the body, by its frame (4, 4)."""
    x, y, *_ = (inverse(body) @ limb.chain.mount)[2]
    angle = float(np.arctan2(y, x))
    return limb if abs(angle) < EVEN else limb._replace(chain=limb.chain.turned(angle))


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
    names = [limb.joint_names for limb in (limbs if len(limbs) > 1 else limbs * build["limbs"])]
    if len(limbs) == 1:
        names = [tuple(f"limb{i}/{name}" for name in limb) for i, limb in enumerate(names)]
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
        "joint_names": None if _are_usual(names) else tuple(names),
    }
    written = {name: value for name, value in file.fields.items() if name not in KEPT_APART}
    return described | build | written | fields


def _are_usual(names: list[tuple[str, ...]]) -> bool:
    """Return whether joints have the names of a robot that is read from no file."""
    return all(
        name == f"limb{i}/joint{k}"
        for i, limb in enumerate(names)
        for k, name in enumerate(limb, 1)
    )


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
