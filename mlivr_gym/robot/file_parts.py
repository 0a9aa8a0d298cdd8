"""Which bodies of a URDF or MJCF file belong to a limb, where it stands, and where it grasps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.kinematics.forms import foot
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.description import LEAST_MASS, Description
from mlivr_gym.robot.file_arms import FileArm
from mlivr_gym.robot.rigid import RigidBody, combined, inverse, rigid

TOOL_LENGTH = 0.05
"""Length of the gripper that is added to an arm without one [m]."""

SHORTEST_GRIPPER = 0.01
"""A grasp that is nearer to the first shape behind the flange is the flange itself [m]."""

MEETING = 1e-3
"""Largest distance of the flange from the last axis [m]."""

MOST_TILT = 1.0
"""Largest angle between the last joint's axis and the nearest axis of the tool frame [deg]."""


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
    length = TOOL_LENGTH if given is None else given
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


def body_and_bases(
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


def _sense_of(length: float, otherwise: float) -> float:
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
