"""Which bodies of a URDF or MJCF file belong to the links, the base and the gripper of a limb."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.description import LEAST_MASS, Description
from mlivr_gym.robot.file_arms import FileArm, body_name, tool_frame_of, with_carriers
from mlivr_gym.robot.file_chain import MEETING, FileChain, chain_of
from mlivr_gym.robot.link_frames import inverse, rigid
from mlivr_gym.robot.rigid import RigidBody, combined

SHORTEST_GRIPPER = 0.01
"""A grasp that is nearer to the first shape behind the flange is the flange itself [m]."""

TOOL_LENGTH = 0.05
"""Length of the gripper that is added to an arm without one [m]."""


class LimbParts(NamedTuple):
    """Bodies of a limb by their numbers in the model, and the limb that they are."""

    number: int
    """Number of the limb in the file."""
    arm: FileArm
    """Its joints."""
    base: tuple[int, ...]
    """Bodies that fix the limb to the robot's body."""
    links: tuple[tuple[int, ...], ...]
    """Bodies that move with each joint, six tuples; the last is without the gripper."""
    gripper: tuple[int, ...]
    """Bodies of the gripper, empty if the file has none."""
    tool_length: float
    """Distance from the flange to the grasp, of the file's gripper or of the one that is added [m].
    """
    chain: FileChain
    """The limb, and its mount in the world."""

    def on(self, frames: Array) -> Iterator[tuple[str, tuple[int, ...], Array]]:
        """Yield name, bodies and frame of base, links and gripper; `frames` are (7, 4, 4)."""
        members = (self.base, *self.links, self.gripper)
        return zip(LINKS, members, (*frames, frames[6]), strict=True)


def limb_parts(
    file: Description, arms: tuple[FileArm, ...], number: int, tool_length: float | None
) -> LimbParts:
    """Return the bodies of the limb that one of a file's arms is, by its number.

    Shapes behind the last link are a gripper, or else, and where a tool length is given [m], belong
    to that link. Raises a `RobotError` if its joints are those of no limb.
    """
    arm = arms[number]
    links = [_moved_by(file, arm, body) for body in arm.links]
    tool = tool_frame_of(file.data, arm)
    gripper = _gripper(file, arm, links[-1]) if tool_length is None else ()
    flange, length = tool, TOOL_LENGTH if tool_length is None else tool_length
    if gripper:
        flange = tool.copy()
        flange[:3, 3] = file.data.xpos[gripper[0]]
        away, axis = tool[:3, 3] - flange[:3, 3], file.data.xaxis[arm.joints[-1]]
        length = round(abs(float(away @ axis)), 9)
        off = float(np.linalg.norm(np.cross(away, axis)))
        if (length < SHORTEST_GRIPPER and not file.is_exported) or off > MEETING:
            gripper, flange, length = (), tool, TOOL_LENGTH
    links[-1] = tuple(body for body in links[-1] if body not in gripper)
    chain, base = chain_of(file, arm, number, flange), _base(file, arms, number)
    return LimbParts(number, arm, base, tuple(links), gripper, length, chain)


def body_parts(file: Description, arms: tuple[FileArm, ...]) -> tuple[int, ...]:
    """Return the bodies that belong to the robot's body, its root first.

    Raises a `RobotError` if the limbs do not stand on one body.
    """
    model = file.model
    roots = {with_carriers(model, arm.first)[-1] for arm in arms}
    if len(roots) > 1 or any(model.body_parentid[arm.first] == 0 for arm in arms):
        names = ", ".join(repr(body_name(model, root)) for root in sorted(roots))
        raise RobotError(f"the limbs stand on {names}; all must be mounted on one body")
    root = roots.pop()
    bases = {body for k in range(len(arms)) for body in _base(file, arms, k)}
    moving = {link for arm in arms for link in arm.links}
    return tuple(
        body
        for body in range(1, model.nbody)
        if root in with_carriers(model, body)
        and body not in bases
        and not moving & set(with_carriers(model, body))
    )


def solid_geoms(file: Description, body: int) -> list[int]:
    """Return the collision shapes of a body."""
    model = file.model
    first = int(model.body_geomadr[body])
    return [
        geom
        for geom in range(first, first + int(model.body_geomnum[body]))
        if model.geom_contype[geom] or model.geom_conaffinity[geom]
    ]


def _moved_by(file: Description, arm: FileArm, link: int) -> tuple[int, ...]:
    """Return the bodies fixed to a link of an arm; joints that are not the arm's stay at 0."""
    model = file.model
    out = []
    for body in range(1, model.nbody):
        carrier = next((b for b in with_carriers(model, body) if b in arm.links), None)
        if carrier == link:
            out.append(body)
    return tuple(out)


def _gripper(file: Description, arm: FileArm, last: tuple[int, ...]) -> tuple[int, ...]:
    """Return the bodies behind the last link that have shapes, and those that they carry.

    Files of this package have a gripper by that name, with shapes or not.
    """
    first = [
        body
        for body in last
        if body != arm.links[-1]
        and (
            solid_geoms(file, body)
            or (file.is_exported and body_name(file.model, body).endswith("/gripper"))
        )
    ]
    return tuple(body for body in last if set(first) & set(with_carriers(file.model, body)))


def _base(file: Description, arms: tuple[FileArm, ...], number: int) -> tuple[int, ...]:
    """Return the bodies that fix a limb, and no other, to the robot's body."""
    model = file.model
    before = [set(with_carriers(model, int(model.body_parentid[arm.first]))) for arm in arms]
    others = set().union(*(found for k, found in enumerate(before) if k != number))
    alone = before[number] - others
    moving = {link for arm in arms for link in arm.links}
    if len(arms) > 1 and alone and not others:
        alone = set()
    return tuple(
        body
        for body in range(1, model.nbody)
        if alone & set(with_carriers(model, body)) and not moving & set(with_carriers(model, body))
    )


def joined(file: Description, numbers: Iterable[int], frame: Array) -> RigidBody:
    """Return bodies of a file as one, as seen from a frame of the world, shape (4, 4)."""
    model, data, parts = file.model, file.data, []
    for body in numbers:
        mass = float(model.body_mass[body])
        if mass > 2.0 * LEAST_MASS:
            place = rigid(data.ximat[body].reshape(3, 3), data.xipos[body])
            moments = (*model.body_inertia[body].tolist(), 0.0, 0.0, 0.0)
            parts.append(RigidBody(mass, (0.0, 0.0, 0.0), moments).moved(place))
    if not parts:
        return RigidBody(0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
    return combined(parts).moved(inverse(frame))
