"""Cargo: a bag that is fixed to the body of a robot, or held by a limb whose joints are locked.

A limb that carries a bag holds no point: it stands folded and, with the bag, is a part of the body.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import LINKS, placed
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.limb_dynamics import gripper_link
from mlivr_gym.robot.mounts import MOUNT, Mount
from mlivr_gym.robot.rigid import RigidBody, box_inertia
from mlivr_gym.robot.validators import (
    EDGES,
    MASSES,
    SIX_ANGLES,
    GivenInertia,
    GivenPosition,
    edges_of,
)
from mlivr_gym.schema import FieldPath, OrNone, Struct, Tuples
from mlivr_gym.values import Triple

SWEPT, SAMPLES = 24, 9
"""Number of angles of joint 1, and of points of an axis, at which cargo is checked."""


@dataclass(frozen=True)
class LockedLimb:
    """A limb whose joints are locked, so that it is a part of the body."""

    mount: Annotated[Mount, MOUNT]
    """Place of the limb; its kinematics, capsules and dynamics must be given."""
    joints: Annotated[tuple[float, ...], SIX_ANGLES]
    """Joint angles [rad]."""

    def __post_init__(self) -> None:
        """Check every figure."""
        place = FieldPath("cargo.limb", RobotError)
        LOCKED_LIMB.check(self, place)
        for name in ("limb", "capsules", "dynamics"):
            if getattr(self.mount, name) is None:
                raise place.field("mount").field(name).fault("is None; a locked limb needs it")

    @property
    def frames(self) -> Array:
        """Frames of its base and its six links in the body frame, shape (7, 4, 4)."""
        assert self.mount.limb is not None
        return np.asarray(self.mount.frame @ link_frames(self.mount.limb, np.array(self.joints)))


@dataclass(frozen=True)
class Cargo:
    """A box that is fixed to the body of a robot, or to the gripper of a locked limb.

    Its axes are those of the body, or of the limb's flange.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from mlivr_gym import robot_spec
    >>> robot = replace(robot_spec("mlivr2"), cargo=Cargo(30.0, (0.3, 0.4, 0.2)))
    >>> robot.body_solid.mass, robot.body_solid.centre
    (50.0, (0.0, 0.0, 0.12))
    """

    mass: Annotated[float, Tuples((), *MASSES, "kg")]
    """Mass [kg]."""
    size: Annotated[float | Triple, EDGES]
    """Edge of a cube, or the three edges of the box along x, y and z [m]."""
    centre: GivenPosition = None
    """Middle of the box, its centre of mass, in the body frame [m]; None for a box that lies on the
    middle of the face towards +z, away from the points that the robot holds. With `limb` in the
    frame of its flange; None for a box held at the middle of a face."""
    inertia: GivenInertia = None
    """Inertia about its middle, xx, yy, zz, xy, xz, yz [kg m^2]; None for that of a homogeneous
    box."""
    limb: Annotated[LockedLimb | None, OrNone(LOCKED_LIMB)] = None
    """The locked limb that holds the box, see `mlivr_gym.extensions.cargo`; None for a box on the
    body."""

    def __post_init__(self) -> None:
        """Check every figure."""
        CARGO.check(self, FieldPath("cargo", RobotError))

    @property
    def edges(self) -> Array:
        """Edges along x, y and z [m], shape (3,)."""
        return edges_of(self.size)

    @property
    def solid(self) -> RigidBody:
        """Mass, centre and inertia in the frame of its middle."""
        inertia = self.inertia or box_inertia(self.mass, self.edges)
        return RigidBody(self.mass, (0.0, 0.0, 0.0), inertia)

    def frame_on(self, body_edges: Array, tool_length: float) -> Array:
        """Return the frame of its middle in the body frame, shape (4, 4).

        It is given for a body of given edges and grippers of a given length [m].
        """
        frame = np.eye(4)
        if self.limb is not None:
            frame, middle = self.limb.frames[6].copy(), self.centre_below(tool_length)
        else:
            middle = self.centre_below(0.5 * float(body_edges[2]))
        frame[:3, 3] += frame[:3, :3] @ middle
        return frame

    def centre_below(self, height: float) -> Array:
        """Return its middle if a face lies at a height above the origin [m], shape (3,)."""
        return np.array(self.centre or (0.0, 0.0, height + 0.5 * float(self.edges[2])))

    @property
    def limb_capsules(self) -> list[tuple[str, Array, float]]:
        """Link, ends (2, 3) in the body frame and radius [m] of each capsule of the locked limb."""
        if self.limb is None:
            return []
        return placed(self.limb.mount.capsules or (), self.limb.frames)

    def limb_solids(self, gripper_mass: float, tool_length: float) -> list[RigidBody]:
        """Return base, links and gripper of the locked limb in the body frame, for a gripper."""
        if self.limb is None:
            return []
        frames, dynamics = self.limb.frames, self.limb.mount.dynamics
        assert dynamics is not None
        gripper = gripper_link(gripper_mass, tool_length).moved(frames[6])
        links = zip(dynamics.solids, frames, strict=True)
        return [*(solid.moved(frame) for solid, frame in links), gripper]


def check_room(cargo: Cargo, frame: Array, mounts: Sequence[Mount]) -> None:
    """Refuse a box or a locked limb that meets bases of limbs or what their shoulders sweep.

    The box has a frame (4, 4) in the body, mounts have all that they have by default. No check
    of a posture compares these.
    """
    where = (
        f"cargo of {' by '.join(f'{edge:g}' for edge in cargo.edges)} m with its centre at "
        f"{frame[:3, 3].tolist()}"
    )
    held = [
        (_samples(ends), radius)
        for link, ends, radius in cargo.limb_capsules
        if LINKS.index(link) >= LINKS.index("upper_arm")
    ]
    for i, mount in enumerate(mounts):
        for link, axis, radius in _bases_and_shoulders(mount):
            points = _samples(axis)
            outside = np.abs((points - frame[:3, 3]) @ frame[:3, :3]) - 0.5 * cargo.edges
            depths = [(radius - np.linalg.norm(outside.clip(0.0), axis=1).min(), where)]
            for other, around in held:
                gap = np.linalg.norm(points[:, None] - other, axis=2).min()
                depths.append((radius + around - gap, "the locked limb"))
            for depth, name in depths:
                if depth > 0.0:
                    raise RobotError(
                        f"{name} overlaps the {link} of limb {i} by {depth:.3g} m, so that no "
                        "posture can hold it; make the cargo smaller, or move it"
                    )


def _bases_and_shoulders(mount: Mount) -> Iterator[tuple[str, Array, float]]:
    """Yield what only joint 1 moves, at angles of that, as `capsules.placed` has it."""
    assert mount.limb is not None
    low = [shape for shape in mount.capsules or () if shape.link in LINKS[:2]]
    angles = np.zeros((SWEPT, 6))
    angles[:, 0] = np.linspace(0.0, 2.0 * np.pi, SWEPT, endpoint=False)
    for frames in mount.frame @ link_frames(mount.limb, angles):
        yield from placed(low, frames)


def _samples(axis: Array) -> Array:
    """Return points of an axis (2, 3), shape (`SAMPLES`, 3)."""
    return np.linspace(axis[0], axis[1], SAMPLES)


LOCKED_LIMB = Struct.of(LockedLimb)
"""Fields of a `LockedLimb`."""

CARGO = Struct.of(Cargo)
"""Fields of a `Cargo`."""
