"""Which bodies of a URDF or MJCF file belong to a limb, and where it grasps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.description import LEAST_MASS
from mlivr_gym.robot.file_arms import MOST_TILT, FileArm, Tree
from mlivr_gym.robot.file_shapes import solid_geoms
from mlivr_gym.robot.link_frames import inverse, rigid
from mlivr_gym.robot.rigid import RigidBody, combined

TOOL_LENGTH = 0.05
"""Length of the gripper that is added to an arm without one [m]."""

SHORTEST_GRIPPER = 0.01
"""A grasp that is nearer to the first shape behind the flange is the flange itself [m]."""

MEETING = 1e-3
"""Largest distance of the flange from the last axis [m]."""

PARALLEL = 1e-6
"""Sine of the angle between axes below which they count as parallel."""


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

    def on(self, frames: Array) -> Iterator[tuple[str, tuple[int, ...], Array]]:
        """Yield name, bodies and frame of base, links and gripper; `frames` are (7, 4, 4)."""
        members = (self.base, *self.links, self.gripper)
        return zip(LINKS, members, (*frames, frames[6]), strict=True)


def limb_parts(
    tree: Tree, arms: tuple[FileArm, ...], number: int, given: float | None
) -> LimbParts:
    """Return the bodies of one of a file's arms, by its number.

    Shapes behind the last link are a gripper, or else, and where a tool length is given [m], belong
    to that link. Raises a `RobotError` if the tool frame lies beside the last axis, or leans.
    """
    arm, data = arms[number], tree.file.data
    moved = [int(tree.model.jnt_bodyid[joint]) for joint in arm.moving]
    links = [_moved_by(tree, moved, body) for body in moved]
    tool = tree.frame(arm.tool.body) @ arm.tool.frame
    axes, anchors = data.xaxis[list(arm.joints)], data.xanchor[list(arm.joints)]
    name = tree.file.joints[arm.joints[-1]].name
    away = tool[:3, 3] - anchors[-1]
    off = float(np.linalg.norm(np.cross(away, axes[-1])))
    if off > MEETING:
        raise RobotError(
            f"the flange lies {off:.3g} m off the axis of joint {name!r}; it must lie on it, "
            "choose another with tool_frame"
        )
    wrist = foot(axes, anchors, -1, -2)
    sense = sense_of((tool[:3, 3] - wrist) @ axes[-1], tool[:3, 2] @ axes[-1])
    grasp = frame_on(tool, sense * axes[-1], anchors[-1], tool[:3, 3])
    gripper: tuple[int, ...] = ()
    length = TOOL_LENGTH if given is None else given
    if given is None:
        behind = _behind(tree, moved[-1], links[-1])
        fingers = [body for body in behind if tree.path(body)[-1] != moved[-1]]
        starts = [*behind[:1], *([moved[-1]] if fingers else [])]
        before = [float((grasp[:3, 3] - data.xpos[body]) @ grasp[:3, 2]) for body in starts]
        long = [one for one in before if one >= SHORTEST_GRIPPER]
        if long or fingers:
            gripper, length = behind, round(long[0], 9) if long else 0.0
    if not gripper:
        grasp[:3, 3] += length * grasp[:3, 2]
    links[-1] = tuple(body for body in links[-1] if body not in gripper)
    return LimbParts(arm, _base(tree, arms, number), tuple(links), gripper, grasp, length)


def mount_of(tree: Tree, arm: FileArm, up: Array | None = None) -> Array:
    """Return the mount of an arm in the world, shape (4, 4).

    The axis of the first joint, in the sense in which the arm lies over its base, is its z axis.
    Its x axis is as a direction `up`, or if none is given as that of the link that carries it.
    """
    joints, data = list(arm.joints), tree.file.data
    axes, anchors = data.xaxis[joints], data.xanchor[joints]
    base = tree.frame(int(tree.model.body_parentid[int(tree.model.jnt_bodyid[joints[0]])]))
    shoulder = foot(axes, anchors, 0, 1)
    sense = sense_of((shoulder - base[:3, 3]) @ axes[0], base[:3, 2] @ axes[0])
    hint = base.copy()
    if up is not None:
        hint[:3, 0], hint[:3, 1] = up, base[:3, np.abs(axes[0] @ base[:3, :3]).argmin()]
    return frame_on(hint, sense * axes[0], anchors[0], base[:3, 3])


def tilt_of(tree: Tree, parts: LimbParts) -> str:
    """Return a note on a tool frame whose z axis is not along the last joint, empty if it is.

    Raises a `RobotError` if none of its axes is: a limb grasps along the last joint.
    """
    tool = parts.arm.tool
    axes = (tree.frame(tool.body) @ tool.frame)[:3, :3]
    cosines = np.clip(parts.grasp[:3, 2] @ axes, -1.0, 1.0)
    name = tree.file.joints[parts.arm.joints[-1]].name
    if np.arccos(np.abs(cosines).max()) > MOST_TILT:
        lean = float(np.rad2deg(np.arccos(np.abs(cosines)).min()))
        raise RobotError(
            f"the tool frame {tool.name!r} leans by {lean:.3g} degrees from the axis of joint "
            f"{name!r}, along which a limb grasps; choose another with tool_frame, such as the "
            "last link"
        )
    angle = float(np.rad2deg(np.arccos(cosines[2])))
    if angle <= np.rad2deg(MOST_TILT):
        return ""
    return (
        f"the limb grasps along joint {name}, {angle:.3g} degrees from the z axis of tool frame "
        f"{tool.name}"
    )


def joined(tree: Tree, members: Iterable[int], frame: Array) -> RigidBody:
    """Return bodies of a file as one, as seen from a frame of the world, shape (4, 4)."""
    model, data, parts = tree.model, tree.file.data, []
    for body in members:
        mass = float(model.body_mass[body])
        if mass > 2.0 * LEAST_MASS:
            place = rigid(data.ximat[body].reshape(3, 3), data.xipos[body])
            moments = (*model.body_inertia[body].tolist(), 0.0, 0.0, 0.0)
            parts.append(RigidBody(mass, (0.0, 0.0, 0.0), moments).moved(place))
    if not parts:
        return RigidBody(0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
    return combined(parts).moved(inverse(frame))


def body_parts(tree: Tree, arms: tuple[FileArm, ...]) -> tuple[int, ...]:
    """Return the bodies that belong to the robot's body, its root first.

    Raises a `RobotError` if the limbs do not stand on one body.
    """
    first = [_first(tree, arm) for arm in arms]
    roots = {tree.carriers(body)[-1] for body in first}
    if len(roots) > 1 or any(tree.model.body_parentid[body] == 0 for body in first):
        names = ", ".join(repr(tree.name(root)) for root in sorted(roots))
        raise RobotError(
            f"the limbs stand on {names}; all must be mounted on one body, put these into one"
        )
    root = roots.pop()
    bases = {body for k in range(len(arms)) for body in _base(tree, arms, k)}
    return tuple(
        body
        for body in range(1, tree.model.nbody)
        if root in tree.carriers(body)
        and body not in bases
        and not set(first) & set(tree.carriers(body))
    )


def _base(tree: Tree, arms: tuple[FileArm, ...], number: int) -> tuple[int, ...]:
    """Return the bodies that fix a limb, and no other, to the robot's body."""
    first = [_first(tree, arm) for arm in arms]
    before = [set(tree.carriers(int(tree.model.body_parentid[body]))) for body in first]
    others = set().union(*(found for k, found in enumerate(before) if k != number))
    alone = before[number] - others
    if len(arms) > 1 and alone and not others:
        alone = set()
    return tuple(
        body
        for body in range(1, tree.model.nbody)
        if alone & set(tree.carriers(body)) and not set(first) & set(tree.carriers(body))
    )


def _first(tree: Tree, arm: FileArm) -> int:
    """Return the body that the first joint of an arm that moves moves."""
    return int(tree.model.jnt_bodyid[arm.moving[0]])


def _moved_by(tree: Tree, moved: list[int], link: int) -> tuple[int, ...]:
    """Return the bodies fixed to a link of an arm; joints that are not the arm's stay at 0."""
    return tuple(
        body
        for body in range(1, tree.model.nbody)
        if next((b for b in tree.carriers(body) if b in moved), None) == link
    )


def _behind(tree: Tree, last: int, members: tuple[int, ...]) -> tuple[int, ...]:
    """Return those of some bodies behind the last link that have shapes, and what they carry."""
    first = {body for body in members if body != last and solid_geoms(tree.model, body)}
    return tuple(body for body in members if first & set(tree.carriers(body)))


def foot(axes: Array, anchors: Array, k: int, other: int) -> Array:
    """Return the point of an axis that is closest to another one, of parallel ones its anchor."""
    across = np.cross(axes[other], np.cross(axes[k], axes[other]))
    share = float(axes[k] @ across)
    point: Array = anchors[k]
    if share > PARALLEL * PARALLEL:
        point = point + float((anchors[other] - anchors[k]) @ across) / share * axes[k]
    return point


def sense_of(length: float, otherwise: float) -> float:
    """Return the sense that makes a length positive, or another number if the length is 0."""
    number = length if abs(length) > MEETING else otherwise
    return -1.0 if number < -MEETING else 1.0


def frame_on(given: Array, z: Array, anchor: Array, place: Array) -> Array:
    """Return the frame with a z axis and its origin on that where a place is closest to it.

    Its x axis is that of a given frame, or where z is close to it the given y axis.
    """
    x = given[:3, 0] - (given[:3, 0] @ z) * z
    if np.linalg.norm(x) < 0.5:
        x = given[:3, 1] - (given[:3, 1] @ z) * z
    x /= np.linalg.norm(x)
    origin = anchor + ((place - anchor) @ z) * z
    return rigid(np.stack([x, np.cross(z, x), z], axis=1), origin)
