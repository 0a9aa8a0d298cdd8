"""Capsules fixed to the links of a limb, for the planner's checks and for the MuJoCo scene."""

from __future__ import annotations

from dataclasses import dataclass

from mlivr_gym.errors import ShapeError, shown
from mlivr_gym.values import LONGEST_ROBOT, SMALLEST, Triple, number, numbers, triple

LINKS = ("base", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3", "gripper")
"""Links of a limb in order from the body; the gripper is fixed to the last."""


@dataclass(frozen=True)
class Capsule:
    """A capsule fixed to a link of a limb.

    Attributes:
        link: One of `LINKS`; the gripper's frame is that of the flange, z towards the grasp.
        start: One end of the axis in the link's frame, that of the manufacturer's description [m].
        end: The other end [m].
        radius: Radius [m].
    """

    link: str
    start: Triple
    end: Triple
    radius: float

    def __post_init__(self) -> None:
        """Check every figure."""
        if self.link not in LINKS:
            raise ShapeError(
                f"capsule on unknown link {shown(self.link)}; valid links are {', '.join(LINKS)}"
            )
        for name in ("start", "end"):
            where = f"capsule on {self.link}: {name}"
            ends = triple(numbers(getattr(self, name), (3,), where, ShapeError, LONGEST_ROBOT))
            object.__setattr__(self, name, ends)
            if self.link in LINKS[6:] and max(abs(ends[0]), abs(ends[1])) > 1e-9:
                raise ShapeError(
                    f"capsule on {self.link}: {name} {ends} must lie on the flange axis, x = y = 0"
                )
        radius = number(self.radius, f"capsule on {self.link}: radius", ShapeError, LONGEST_ROBOT)
        if radius < SMALLEST:
            raise ShapeError(
                f"capsule on {self.link}: radius is {radius:g}; it must be above 0 "
                f"(at least {SMALLEST:g} m)"
            )
        object.__setattr__(self, "radius", radius)
