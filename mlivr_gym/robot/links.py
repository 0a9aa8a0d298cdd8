"""The links of a robot in the order in which they carry each other, as files and scenes have them.

A limb has its base, six links and a gripper, which is fixed to the flange.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.limb_dynamics import LimbDynamics
from mlivr_gym.robot.mounts import Mount
from mlivr_gym.robot.rigid import RigidBody
from mlivr_gym.values import Triple


class RobotJoint(NamedTuple):
    """A joint along the z axis of the link that it moves."""

    name: str
    """Its name."""
    axis: Triple
    """Its axis in the frame of the link: along z, or against it."""
    limits: tuple[float, float]
    """Lower and upper limit [rad]."""
    torque: float
    """Largest torque [N m]."""
    speed: float
    """Largest speed [rad/s]."""
    rotor: float
    """Inertia of its rotor [kg m^2]."""


class RobotLink(NamedTuple):
    """A link of a robot."""

    name: str
    """Its name."""
    parent: str
    """Name of the link that carries it, empty for the body."""
    frame: Array
    """Its frame in that of that link, shape (4, 4)."""
    solid: RigidBody
    """Its mass, centre and inertia."""
    shapes: str
    """Name of its capsules, without their numbers."""
    capsules: tuple[Capsule, ...]
    """Its capsules."""
    joint: RobotJoint | None = None
    """The joint that moves it, None if it is fixed."""
    boxes: Sequence[tuple[str, Array, Array]] = ()
    """Name, frame (4, 4) and edges (3,) [m] of its boxes."""


def limb_links(
    limb: str, mount: Mount, dynamics: LimbDynamics, gripper: RigidBody, joints: tuple[str, ...]
) -> Iterator[RobotLink]:
    """Yield base, links and gripper of a limb, whose names are its own and `{limb}/{link}`.

    The mount has kinematics and capsules; `joints` are the names of the six that move.
    """
    assert mount.limb is not None
    parent, frames = "base", (mount.frame, *mount.limb.steps, np.eye(4))
    for k, (link, frame, solid) in enumerate(
        zip(LINKS, frames, (*dynamics.solids, gripper), strict=True)
    ):
        joint = None
        if 0 < k < 7:
            low, high = mount.limb.limits[k - 1].tolist()
            joint = RobotJoint(
                joints[k - 1], (0.0, 0.0, float(mount.limb.senses[k - 1])), (low, high),
                dynamics.torque_limits[k - 1], dynamics.speed_limits[k - 1],
                dynamics.rotor_inertias[k - 1],
            )  # fmt: skip
        shapes = tuple(shape for shape in mount.capsules or () if shape.link == link)
        name = f"{limb}/{link}" if k else limb
        yield RobotLink(name, parent, frame, solid, f"{limb}/{link}", shapes, joint)
        parent = name
