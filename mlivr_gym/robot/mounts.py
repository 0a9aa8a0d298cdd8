"""Where the limbs of a robot are mounted on its body.

By default N equal limbs are mounted at equal angles about the body's z axis. A robot of another
build names one `Mount` for each limb, which may also bring a limb of its own.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import CAPSULE, Capsule, check_moving
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.limb_dynamics import (
    GIVEN_LIMB,
    LIMB_DYNAMICS,
    LimbDynamics,
    Named,
    arm_dynamics,
)
from mlivr_gym.robot.sizes import MOST_CAPSULES
from mlivr_gym.robot.visuals import MOST_VISUALS, VISUAL, Visual
from mlivr_gym.schema import FieldPath, ListOf, OrNone, Rotation, Struct, Tuples
from mlivr_gym.values import MAX_ROBOT_LENGTH, Triple

GivenCapsules = Annotated[tuple[Capsule, ...] | None, OrNone(ListOf(CAPSULE, most=MOST_CAPSULES))]
"""Collision shapes of a limb, or None."""


@dataclass(frozen=True)
class Mount:
    """The place of one limb on the body, and the parts in which it differs from the other limbs."""

    position: Annotated[Triple, Tuples((3,), most=MAX_ROBOT_LENGTH, unit="m")]
    """Origin of the limb's base in the body frame [m]."""
    rotation: Annotated[tuple[Triple, Triple, Triple], Rotation()]
    """Rows of the rotation from the limb's base axes to the body's; its third column is the axis of
    the first joint."""
    limb: Annotated[Limb | None, OrNone(GIVEN_LIMB)] = None
    """Kinematics of this limb; None for `RobotSpec.limb`."""
    capsules: GivenCapsules = None
    """Collision shapes of this limb; None for those of the robot's other limbs, or, if `limb` is
    given, for those that it has by default."""
    dynamics: Annotated[LimbDynamics | None, OrNone(Named(LIMB_DYNAMICS, arm_dynamics))] = None
    """Masses, inertias and joint limits of this limb; None for `RobotSpec.dynamics`, or, if `limb`
    is given, for those of the arm that has its lengths."""
    visuals: Annotated[tuple[Visual, ...] | None, OrNone(ListOf(VISUAL, most=MOST_VISUALS))] = None
    """Meshes that show this limb; None for `RobotSpec.visuals`, or none if `limb` is given."""

    def __post_init__(self) -> None:
        """Check every figure."""
        place = FieldPath("mount", RobotError)
        MOUNT.check(self, place)
        check_moving(self.capsules, place)


MOUNT = Struct.of(Mount)
"""Fields of a `Mount`."""


SPARSE = ("visuals", "cargo", "joint_names")
"""Fields of robots, and of their parts, that plain data name only where there are any."""


def without_none(data: dict[str, Any]) -> dict[str, Any]:
    """Return plain data of a robot with the `SPARSE` fields only where there are any."""
    cargo, kept = data.get("cargo"), dict[str, Any]()
    if cargo is not None and cargo["limb"] is None:
        del cargo["limb"]
    for name, value in data.items():
        if isinstance(value, dict):
            kept[name] = without_none(value)
        elif isinstance(value, list | tuple):
            kept[name] = type(value)(
                without_none(one) if isinstance(one, dict) else one for one in value
            )
        elif value is not None or name not in SPARSE:
            kept[name] = value
    return kept


def plain_without_looks(mount: Mount) -> dict[str, Any]:
    """Return what plans depend on of a mount, as plain data."""
    return without_none(asdict(replace(mount, dynamics=None, visuals=None)))


def even_mounts(limbs: int, radius: float) -> tuple[Mount, ...]:
    """Return the mounts of limbs at equal angles, at a distance from the body's z axis [m]."""
    turns = even_rotations(limbs)
    places = radius * turns[:, :, 2]
    return tuple(Mount(*place) for place in zip(places.tolist(), turns.tolist(), strict=True))


def even_rotations(limbs: int) -> Array:
    """Return the axes of limbs mounted at equal angles, in the body frame, shape (N, 3, 3).

    The z axis of a limb's base is radial and its x axis is the body's z axis.
    """
    azimuth = 2.0 * np.pi * np.arange(limbs) / limbs
    c, s = np.cos(azimuth), np.sin(azimuth)
    zero, one = np.zeros(limbs), np.ones(limbs)
    return np.stack(
        [
            np.stack([zero, s, c], -1),
            np.stack([zero, -c, s], -1),
            np.stack([one, zero, zero], -1),
        ],
        axis=1,
    )
