"""Cargo: a bag that is fixed to the body of a robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.limb_dynamics import MASSES, check_inertia
from mlivr_gym.robot.rigid import RigidBody, box_inertia
from mlivr_gym.robot.validators import SizeOrEdges
from mlivr_gym.schema import FieldPath, OrNone, Struct, Tuples
from mlivr_gym.values import MAX_ROBOT_LENGTH, Triple

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    R = TypeVar("R", bound=DataclassInstance)


@dataclass(frozen=True)
class Cargo:
    """A box that is fixed to the body of a robot, with its axes along those of the body.

    Attributes
    ----------
    mass
        Mass [kg].
    size
        Edge of a cube, or the three edges of the box along x, y and z [m].
    centre
        Middle of the box, its centre of mass, in the body frame [m]; None for a box that lies on
        the middle of the face towards +z, away from the points that the robot holds.
    inertia
        Inertia about its middle, xx, yy, zz, xy, xz, yz [kg m^2]; None for that of a homogeneous
        box.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from mlivr_gym import robot_spec
    >>> robot = replace(robot_spec("mlivr2"), cargo=Cargo(30.0, (0.3, 0.4, 0.2)))
    >>> robot.body_solid.mass, robot.body_solid.centre
    (50.0, (0.0, 0.0, 0.12))
    """

    mass: float
    size: float | Triple
    centre: Triple | None = None
    inertia: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Check every figure."""
        place = FieldPath("cargo", RobotError)
        CARGO.check(self, place)
        if self.inertia is not None:
            check_inertia(self.inertia, FieldPath("cargo.inertia", RobotError))

    @property
    def edges(self) -> Array:
        """Edges along x, y and z [m], shape (3,)."""
        return np.broadcast_to(np.asarray(self.size, dtype=np.float64), 3).copy()

    def centre_on(self, body_edges: Array) -> Array:
        """Return the middle of the box on a body of given edges, in its frame [m], shape (3,)."""
        if self.centre is not None:
            return np.array(self.centre)
        return np.array([0.0, 0.0, 0.5 * float(body_edges[2] + self.edges[2])])

    def solid_on(self, body_edges: Array) -> RigidBody:
        """Return mass, centre and inertia on a body of given edges, in its frame."""
        x, y, z = self.centre_on(body_edges).tolist()
        inertia = self.inertia or box_inertia(self.mass, self.edges)
        return RigidBody(self.mass, (x, y, z), inertia)


def carrying(robot: R, cargo: Cargo | dict[str, Any] | None) -> R:
    """Return a robot with cargo, given as itself or as plain data; the robot itself without."""
    if cargo is None:
        return robot
    return replace(robot, cargo=CARGO.read(cargo, FieldPath("cargo", RobotError)))


CARGO = Struct(
    Cargo,
    {
        "mass": Tuples((), *MASSES, "kg"),
        "size": SizeOrEdges(),
        "centre": OrNone(Tuples((3,), most=MAX_ROBOT_LENGTH, unit="m")),
        "inertia": OrNone(Tuples((6,), -1e6, 1e6, "kg m^2")),
    },
)
"""Fields of a `Cargo`."""
