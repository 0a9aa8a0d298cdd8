"""Capsules fixed to the links of a limb, for the planner's checks and for the MuJoCo scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from mlivr_gym.errors import ShapeError
from mlivr_gym.schema import Choice, FieldPath, Struct, Tuples
from mlivr_gym.values import MAX_ROBOT_LENGTH, MIN_SIZE, Triple

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
    start: Annotated[Triple, END]
    """One end of the axis in the link's frame, that of the manufacturer's description [m]."""
    end: Annotated[Triple, END]
    """The other end [m]."""
    radius: Annotated[float, Tuples((), MIN_SIZE, MAX_ROBOT_LENGTH, "m")]
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


END = Tuples((3,), most=MAX_ROBOT_LENGTH, unit="m")

CAPSULE = Struct.of(Capsule)
"""Fields of a `Capsule`."""


def check_moving(capsules: tuple[Capsule, ...] | None, place: FieldPath) -> None:
    """Refuse collision shapes of a limb of which none moves.

    Raises an error of the type of `place` if none of the capsules is on a link that moves.
    """
    if capsules is not None and all(shape.link == "base" for shape in capsules):
        raise place.field("capsules").fault(
            "has none on a link that moves; leave it out for those of the UR5e"
        )
