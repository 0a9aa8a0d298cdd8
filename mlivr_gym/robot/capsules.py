"""Capsules fixed to the links of a limb, for the planner's checks and for the MuJoCo scene."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import ShapeError
from mlivr_gym.robot.sizes import MOST_CAPSULES
from mlivr_gym.robot.validators import POSITION, POSITIVE
from mlivr_gym.schema import Choice, FieldPath, ListOf, OrNone, Struct
from mlivr_gym.values import MIN_SIZE, Triple

LINKS = ("base", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3", "gripper")
"""Links of a limb in order from the body; the gripper is fixed to the last."""


@dataclass(frozen=True)
class Capsule:
    """A capsule fixed to a link of a limb.

    Examples
    --------
    >>> Capsule("forearm", (0.0, 0.0, 0.0), (0.2, 0.0, 0.0), 0.05).radius
    0.05
    """

    link: Annotated[str, Choice(LINKS)]
    """One of `LINKS`; the gripper's frame is that of the flange, z towards the grasp."""
    start: Annotated[Triple, POSITION]
    """One end of the axis in the link's frame, that of the manufacturer's description [m]."""
    end: Annotated[Triple, POSITION]
    """The other end [m]."""
    radius: Annotated[float, POSITIVE]
    """Radius [m]."""

    def __post_init__(self) -> None:
        """Check every figure."""
        place = FieldPath("capsule", ShapeError)
        CAPSULE.check(self, place)
        for name in ("start", "end") if self.link in LINKS[6:] else ():
            x, y, _ = getattr(self, name)
            if max(abs(x), abs(y)) > MIN_SIZE:
                found = list(getattr(self, name))
                raise place.field(name).fault(
                    f"is {found}; on {self.link} it must lie on the flange axis, x = y = 0"
                )


CAPSULE = Struct.of(Capsule)
"""Fields of a `Capsule`."""


class MovingShapes(ListOf[Capsule]):
    """Validator of the collision shapes of a limb, of which one must move."""

    def read(self, value: object, place: FieldPath) -> tuple[Capsule, ...]:
        """Return the capsules."""
        capsules = super().read(value, place)
        if all(shape.link == "base" for shape in capsules):
            raise place.fault("has none on a link that moves; leave it out for those of the UR5e")
        return capsules


SHAPES = MovingShapes(CAPSULE, most=MOST_CAPSULES)
"""Validator of the collision shapes of a limb."""

GivenCapsules = Annotated[tuple[Capsule, ...] | None, OrNone(SHAPES)]
"""Collision shapes of a limb, or None."""


def placed(capsules: Iterable[Capsule], frames: Array) -> list[tuple[str, Array, float]]:
    """Return link, ends (2, 3) and radius [m] of capsules where the links of their limb are.

    Frames of base and links have shape (7, 4, 4).
    """
    out = []
    for shape in capsules:
        frame = frames[min(LINKS.index(shape.link), 6)]
        ends = np.array([shape.start, shape.end]) @ frame[:3, :3].T + frame[:3, 3]
        out.append((shape.link, ends, shape.radius))
    return out
