"""Where the limbs of a robot are mounted on its body.

By default N equal limbs are mounted at equal angles about the body's z axis. A robot of another
build names one `Mount` for each limb, which may also bring a limb of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import GivenCapsules
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.limb_dynamics import GIVEN_LIMB, GivenDynamics
from mlivr_gym.robot.rigid import rigid
from mlivr_gym.robot.validators import POSITION
from mlivr_gym.robot.visuals import GivenVisuals
from mlivr_gym.schema import FieldPath, OrNone, Rotation, Struct
from mlivr_gym.values import MIN_SIZE, Triple


@dataclass(frozen=True)
class Mount:
    """The place of one limb on the body, and the parts in which it differs from the other limbs."""

    position: Annotated[Triple, POSITION]
    """Origin of the limb's base in the body frame [m]."""
    rotation: Annotated[tuple[Triple, Triple, Triple], Rotation()]
    """Rows of the rotation from the limb's base axes to the body's; its third column is the axis of
    the first joint."""
    limb: Annotated[Limb | None, OrNone(GIVEN_LIMB)] = None
    """Kinematics of this limb; None for `RobotSpec.limb`."""
    capsules: GivenCapsules = None
    """Collision shapes of this limb; None for those of the robot's other limbs, or, if `limb` is
    given, for those that it has by default."""
    dynamics: GivenDynamics = None
    """Masses, inertias and joint limits of this limb; None for `RobotSpec.dynamics`, or, if `limb`
    is given, for those of the arm that has its lengths."""
    visuals: GivenVisuals = None
    """Meshes that show this limb; None for `RobotSpec.visuals`, or none if `limb` is given."""

    def __post_init__(self) -> None:
        """Check every figure."""
        MOUNT.check(self, FieldPath("mount", RobotError))

    @property
    def frame(self) -> Array:
        """Frame of the limb's base in the body frame, shape (4, 4)."""
        return rigid(self.rotation, self.position)


MOUNT = Struct.of(Mount)
"""Fields of a `Mount`."""


def even_mounts(limbs: int, radius: float) -> tuple[Mount, ...]:
    """Return the mounts of limbs at equal angles, at a distance from the body's z axis [m].

    The z axis of a limb's base is radial and its x axis is the body's z axis.
    """
    azimuths = 2.0 * np.pi * np.arange(limbs) / limbs
    return tuple(
        Mount((radius * c, radius * s, 0.0), ((0.0, s, c), (0.0, -c, s), (1.0, 0.0, 0.0)))
        for c, s in zip(np.cos(azimuths).tolist(), np.sin(azimuths).tolist(), strict=True)
    )


def are_even(mounts: Sequence[Mount]) -> bool:
    """Return whether all mounts and limbs are those of the first, turned about the body's z axis.

    The first one must lie along the body's x axis.
    """
    first, turns = mounts[0], np.array([one.rotation for one in even_mounts(len(mounts), 0.0)])
    expected = turns @ turns[0].T @ np.array(first.frame[:3])
    found = np.array([mount.frame[:3] for mount in mounts])
    return (
        all((one.limb, one.capsules) == (first.limb, first.capsules) for one in mounts)
        and bool(np.allclose(found, expected, atol=MIN_SIZE))
        and first.position[0] >= MIN_SIZE > abs(first.position[1])
    )
