"""Robots from URDF and MJCF files.

A file is either one arm, of which several are mounted evenly round a body, or a whole robot, whose
body and limbs are found from the tree of its links. Joints, limits, masses, inertias and collision
shapes come from the file; whatever it does not say is named in `RobotSpec.source`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arguments import FileName
from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError, path_shown
from mlivr_gym.robot.description import Description
from mlivr_gym.robot.fields import RobotFields
from mlivr_gym.robot.file_arms import FileArm, arms_of
from mlivr_gym.robot.file_limb import FileLimb, LimbParts, joined, limb_of, limb_parts, mount_of
from mlivr_gym.robot.file_options import FILE_OPTIONS, FileOptions
from mlivr_gym.robot.file_shapes import box_round, solids
from mlivr_gym.robot.file_text import read_tree
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.mounts import Mount, even_mounts
from mlivr_gym.robot.rigid import frame_on, inverse, rigid
from mlivr_gym.schema import FieldPath
from mlivr_gym.values import MAX_REMARK_LENGTH, Triple, as_triple
from mlivr_gym.world.boxes import Box

UPPER_ARM_GAP = 0.03
"""Distance of an upper arm from the body [m]: more than the clearance that plans keep."""

EVEN = 1e-6
"""Largest deviation of axes and positions [m] that counts as mounted at equal angles."""


class RobotFile(NamedTuple):
    """A robot as a file describes it."""

    fields: dict[str, Any]
    """Fields of `RobotSpec`."""
    file_limbs: tuple[FileLimb, ...]
    """Each limb as the file has it."""

    @property
    def capsule_excess(self) -> tuple[dict[str, float], ...]:
        """How far capsules reach beyond the shapes of each link at most [m], by limb and link."""
        return tuple(limb.excess for limb in self.file_limbs)


def read_robot(path: str | Path, **options: Any) -> RobotFile:
    """Read a robot from a URDF or MJCF file.

    Options are fields of `file_options.FileOptions`, such as `limbs`, `tool_frame` or
    `speed_limits`, and further fields of `RobotSpec`, such as `name`, `heights` or `span`. Where
    `heights`, `span` and `characteristic_length` are not given, those of the default robot grow
    with the arm.

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
    place = FieldPath(f"robot {path_shown(path)}", RobotError)
    return place.build(_read, Path(name), known, fields)


def _read(path: Path, options: FileOptions, fields: dict[str, Any]) -> RobotFile:
    file = Description(path, read_tree(path), options)
    arms = arms_of(file, options)
    members, bases = _body_and_bases(file, arms)
    every = zip(arms, bases, strict=True)
    parts = [limb_parts(file, arm, base, options.tool_length) for arm, base in every]
    if len(arms) == 1:
        limbs, build = _one_arm(file, parts[0], options)
    else:
        limbs, build = _whole(file, members, parts, options)
    return RobotFile(_fields(file, limbs) | build | fields, tuple(limbs))


def _one_arm(
    file: Description, part: LimbParts, options: FileOptions
) -> tuple[list[FileLimb], dict[str, Any]]:
    """Return equal arms mounted evenly round a box, and the fields of the robot's build."""
    if options.up is not None:
        raise RobotError("up is for a whole robot; the file is one arm")
    limb = limb_of(file, part, options, part.tool_length, None)
    count, size, radius = options.limbs or 2, options.body_size or 0.2, options.mount_radius
    if radius is None:
        radius = 0.5 * float(np.max(size)) + _stand_off(limb)
    names = tuple(tuple(f"limb{i}/{name}" for name in limb.joint_names) for i in range(count))
    return [limb] * count, {
        "limbs": count, "body_size": size, "mount_radius": radius,
        "tool_length": part.tool_length, "joint_names": names,
    }  # fmt: skip


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


def _whole(
    file: Description, members: tuple[int, ...], parts: list[LimbParts], options: FileOptions
) -> tuple[list[FileLimb], dict[str, Any]]:
    """Return the limbs of a whole robot and the fields of its build."""
    count, arms = len(parts), tuple(part.arm for part in parts)
    if options.limbs not in (None, count):
        raise RobotError(f"limbs is {options.limbs}; the file has {count} limbs")
    if options.mount_radius is not None:
        raise RobotError(
            f"mount_radius is {options.mount_radius}; the file is a whole robot of {count} limbs, "
            "whose mounts it names"
        )
    frame, radius, order = file.frame(members[0]), None, tuple(range(count))
    if options.up is not None:
        frame = _upright(frame, options.up, file.data.xanchor[[arm.joints[1] for arm in arms]])
    elif even := _even(np.array([mount_of(file, arm) for arm in arms]), frame[:3, :3]):
        frame, radius, order = even
    frame, build = _body(file, members, frame, radius is not None, options.body_size)
    # A limb's flange may lie anywhere on the axis of its last joint: all tools are made equal.
    build["tool_length"] = length = min(part.tool_length for part in parts)
    limbs = [limb_of(file, parts[k], options, length, frame[:3, 2]) for k in order]
    build["joint_names"] = tuple(limb.joint_names for limb in limbs)
    are_alike = all(limb.is_like(limbs[0]) for limb in limbs)
    if are_alike and radius is not None:
        return limbs, build | {"limbs": count, "mount_radius": radius}
    places = [inverse(frame) @ limb.mount for limb in limbs]
    build["mounts"] = tuple(
        Mount(
            as_triple(place[:3, 3]), Box.rows(place[:3, :3]),
            *(() if are_alike else (one.limb, one.capsules, one.dynamics, one.visuals or None)),
        )
        for one, place in zip(limbs, places, strict=True)
    )  # fmt: skip
    return limbs, build


def _upright(root: Array, up: Triple, shoulders: Array) -> Array:
    """Return the frame between shoulders whose z axis is a direction in the root's axes."""
    if not any(up):
        raise RobotError("up is (0, 0, 0); it must be a direction, such as (-1, 0, 0)")
    z, spine, middle = root[:3, :3] @ up, np.roll(root[:, :3], 1, axis=1), shoulders.mean(axis=0)
    return frame_on(spine, z / np.linalg.norm(z), middle, middle)


def _body(
    file: Description, members: tuple[int, ...], frame: Array, is_even: bool,
    size: float | Triple | None,
) -> tuple[Array, dict[str, Any]]:  # fmt: skip
    """Return the frame of a robot's body in the world (4, 4), and the robot's fields of it.

    Its edge or three edges may be given [m]; else it is the box round its shapes, and unless the
    limbs are mounted evenly round a frame its origin is moved to the middle of it. Raises a
    `RobotError` if the body has no shape and no size.
    """
    if size is None:
        remedy = "give body_size [m]"
        shapes = solids(file, members, frame, remedy)
        if not shapes:
            name = file.name_of(members[0])
            raise RobotError(f"the body {name!r} has no collision shape; {remedy}")
        middle, half = box_round(shapes, is_even)
        frame = frame.copy()
        frame[:3, 3] += frame[:3, :3] @ middle
        x, y, z = (2.0 * half).tolist()
        size = x if x == y == z else (x, y, z)
    solid = joined(file, members, frame)
    fields = dict(zip(("body_mass", "body_centre", "body_inertia"), solid, strict=True))
    return frame, {"body_size": size} | (fields if solid.mass else {})


def _body_and_bases(
    file: Description, arms: tuple[FileArm, ...]
) -> tuple[tuple[int, ...], list[tuple[int, ...]]]:
    """Return the bodies of the robot's body, its root first, and those that fix each limb to it.

    Raises a `RobotError` if several limbs do not stand on one body.
    """
    first = [file.body_of(arm.moving[0]) for arm in arms]
    roots = {file.carriers(body)[-1] for body in first}
    if len(arms) > 1 and (len(roots) > 1 or roots & set(first)):
        names = ", ".join(repr(file.name_of(root)) for root in sorted(roots))
        raise RobotError(
            f"the limbs stand on {names}; all must be mounted on one body, put these into one"
        )
    before = [set(file.carriers(file.parent(body))) for body in first]
    fixed, bases = file.nearest(first) == 0, []
    for k, mine in enumerate(before):
        # What carries this limb alone belongs to it, with what is on that.
        alone = mine - set[int]().union(*before[:k], *before[k + 1 :])
        bases.append(tuple(np.flatnonzero(fixed & (file.nearest(alone) > 0)).tolist()))
    members = fixed & (file.nearest(roots) > 0)
    members[[body for base in bases for body in base]] = False
    return tuple(np.flatnonzero(members).tolist()), bases


def _even(mounts: Array, axes: Array) -> tuple[Array, float, tuple[int, ...]] | None:
    """Return the frame in which limbs are mounted evenly round z, their radius and their order.

    Its x axis points to limb 0, and round its z axis, one of some axes that are columns of shape
    (3, 3), they lie in order. Mounts in the world have shape (N, 4, 4). None if they are not even.
    """
    x, centre = mounts[0, :3, 2], mounts[:, :3, 3].mean(axis=0)
    radius = float((mounts[0, :3, 3] - centre) @ x)
    if radius < 0.0:
        return None
    expected = np.array([mount.frame for mount in even_mounts(len(mounts), radius)])
    for z in axes.T[::-1]:
        frame = rigid(np.stack([x, np.cross(z, x), z], axis=1), centre)
        seen = inverse(frame) @ mounts
        # What rounding leaves below 0 stays there, so that limb 0 comes first.
        angles = (np.arctan2(seen[:, 1, 2], seen[:, 0, 2]) + EVEN) % (2.0 * np.pi)
        order = np.argsort(angles)
        if np.abs((seen[order] - expected)[:, :3, 2:]).max() <= EVEN:
            return frame, round(radius, 9), tuple(order.tolist())
    return None


def _fields(file: Description, limbs: list[FileLimb]) -> dict[str, Any]:
    first, told = limbs[0], [f"the file of {file.name}", *file.notes]
    told += dict.fromkeys(note for limb in limbs for note in limb.notes)
    fitted = max(max(limb.excess.values(), default=0.0) for limb in limbs)
    if fitted:
        told.append(f"capsules exceed the shapes of their links by {fitted:.3f} m at most")
    source = "".join(c if c.isprintable() else " " for c in "; ".join(told))
    scale = max(limb.limb.arm_length for limb in limbs) / Limb().arm_length
    return {
        "name": file.name,
        "limb": first.limb,
        "capsules": first.capsules,
        "visuals": first.visuals or None,
        "dynamics": first.dynamics,
        "gripper_mass": min(limb.gripper_mass for limb in limbs),
        "source": source[:MAX_REMARK_LENGTH],
        "heights": tuple(scale * height for height in RobotFields.heights),
        "span": scale * RobotFields.span,
        "characteristic_length": scale * RobotFields.characteristic_length,
    }
