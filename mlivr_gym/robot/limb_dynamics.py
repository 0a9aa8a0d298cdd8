"""What the dynamics of a limb need: masses, inertias, and the limits of its joints.

Figures of the UR3e, UR5e and UR10e ship with their sources, see `envs_assets/ur5e.json` and those
beside it. Frames of links are those of the manufacturer's description, their origins on the joints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

import numpy as np

from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import RobotError
from mlivr_gym.files import read_json
from mlivr_gym.robot.dh_table import frames_of_dh, ur_dh
from mlivr_gym.robot.limb import LIMB, Limb
from mlivr_gym.robot.rigid import RigidBody, cylinder
from mlivr_gym.robot.validators import MASSES, GivenInertia, GivenPosition, Inertias
from mlivr_gym.schema import Choice, FieldPath, OrNone, Struct, Tuples, Validator
from mlivr_gym.values import MAX_ROBOT_LENGTH, Triple

ARMS = ("ur3e", "ur5e", "ur10e")
"""Arms whose figures ship."""

SAME_LENGTH = 1e-3
"""Limbs whose links differ by less are one kind of arm [m]: calibrated figures vary a little."""


@dataclass(frozen=True)
class LimbDynamics:
    """Masses, inertias and limits of the six links and joints of a limb."""

    base_mass: Annotated[float, Tuples((), 0.0, MASSES[1], "kg")]
    """Mass of the link by which the limb is fixed to the body [kg]; 0 if the body includes it."""
    masses: Annotated[tuple[float, ...], Tuples((6,), *MASSES, "kg")]
    """Mass of each link [kg]."""
    centres: Annotated[tuple[Triple, ...], Tuples((6, 3), most=MAX_ROBOT_LENGTH, unit="m")]
    """Centre of mass of each link in its frame [m], six of three."""
    inertias: Annotated[tuple[tuple[float, ...], ...], Inertias((6, 6), -1e6, 1e6, "kg m^2")]
    """Inertia of each link about its centre of mass in the axes of its frame, xx, yy, zz, xy, xz,
    yz [kg m^2]."""
    torque_limits: Annotated[tuple[float, ...], Tuples((6,), 1e-3, 1e6, "N m")]
    """Largest torque of each joint [N m]."""
    speed_limits: Annotated[tuple[float, ...], Tuples((6,), 1e-3, 1e3, "rad/s")]
    """Largest speed of each joint [rad/s]."""
    rotor_inertias: Annotated[tuple[float, ...], Tuples((6,), 0.0, 1e3, "kg m^2")]
    """Inertia of each joint's rotor, reflected through its gear [kg m^2]."""
    base_centre: GivenPosition = None
    """Centre of mass of that link in the limb's base frame [m]; None if it has no mass."""
    base_inertia: GivenInertia = None
    """Its inertia, in the order of `inertias` [kg m^2]; None if it has no mass."""

    def __post_init__(self) -> None:
        """Check every figure."""
        place = FieldPath("dynamics", RobotError)
        LIMB_DYNAMICS.check(self, place)
        for name in ("base_centre", "base_inertia"):
            if (getattr(self, name) is None) != (not self.base_mass):
                raise place.field(name).fault(
                    f"is {getattr(self, name)}; a base_mass of {self.base_mass:g} kg needs "
                    f"{'it' if self.base_mass else 'None'}"
                )

    @property
    def solids(self) -> tuple[RigidBody, ...]:
        """Base and six links, each in its frame; the base in that of the limb's base."""
        base = self.base_centre or (0.0, 0.0, 0.0), self.base_inertia or (0.0,) * 6
        links = zip(self.masses, self.centres, self.inertias, strict=True)
        return RigidBody(self.base_mass, *base), *(RigidBody(*link) for link in links)


@cache
def arm_data(name: str) -> dict[str, Any]:
    """Return the figures of an arm that ships, with their sources; `name` is one of `ARMS`."""
    return read_json(asset_path(f"{name}.json"), "robot", RobotError)


@cache
def arm_dynamics(name: str) -> LimbDynamics:
    """Return the masses, inertias and limits of an arm that ships; `name` is one of `ARMS`."""
    data = arm_data(name)
    rows, columns = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    links, limits, base = data["links"], data["joint_limits"], data["base_link"]
    stands = cylinder(base["mass"], base["radius"], base["length"], 0.5 * base["length"])
    return LimbDynamics(
        base["mass"],
        tuple(link["mass"] for link in links),
        tuple(tuple(link["com_urdf"]) for link in links),
        tuple(tuple(np.array(link["inertia_urdf"])[rows, columns].tolist()) for link in links),
        tuple(limits["torque"]),
        tuple(limits["velocity"]),
        (data["rotor_inertia"]["value"],) * 6,
        stands.centre,
        stands.inertia,
    )


def gripper_link(mass: float, tool_length: float) -> RigidBody:
    """Return a gripper, a cylinder from the flange to the grasp [kg, m]."""
    radius = arm_data("ur5e")["gripper"]["radius"]
    return cylinder(mass, radius, max(tool_length, 0.01), 0.5 * tool_length)


@cache
def arm_limb(name: str) -> Limb:
    """Return the lengths and joint limits of an arm that ships; `name` is one of `ARMS`."""
    data = arm_data(name)
    rows = ur_dh(*(data["dh"][name] for name in ("d1", "a2", "a3", "d4", "d5", "d6")))
    limits = tuple((low, high) for low, high in data["joint_limits"]["position"])
    return Limb(*frames_of_dh(rows), limits)


def arm_of(limb: Limb) -> str | None:
    """Return the name of the arm that ships with the lengths of a limb, or None."""
    for name in ARMS:
        if np.abs(limb.steps - arm_limb(name).steps).max() < SAME_LENGTH:
            return name
    return None


@dataclass(frozen=True)
class Named:
    """A record of a limb, or the name of an arm that ships."""

    kind: Validator[Any]
    """Reads a record that is spelled out."""
    make: Callable[[str], Any]
    """Gives the record of a name."""

    def read(self, value: object, place: FieldPath) -> Any:
        """Return the record."""
        if isinstance(value, str):
            return self.make(Choice(ARMS).read(value, place))
        return self.kind.read(value, place)


LIMB_DYNAMICS = Struct.of(LimbDynamics)
"""Fields of a `LimbDynamics`."""

GIVEN_LIMB = Named(LIMB, arm_limb)
"""Validator of a limb, its name or plain data."""

GivenDynamics = Annotated[LimbDynamics | None, OrNone(Named(LIMB_DYNAMICS, arm_dynamics))]
"""Masses, inertias and limits of a limb, or the name of an arm that ships, or None."""
