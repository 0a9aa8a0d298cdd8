"""Capsules fixed to the links of a limb, for the planner's checks and for the MuJoCo scene.

Limbs that bring none have those of the UR5e, or simple ones along their links.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import ShapeError
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.limb_dynamics import arm_data, arm_of
from mlivr_gym.robot.sizes import MOST_CAPSULES
from mlivr_gym.robot.validators import POSITION, POSITIVE
from mlivr_gym.schema import Choice, FieldPath, ListOf, OrNone, Struct
from mlivr_gym.values import MIN_SIZE, Triple, as_triple

LINKS = ("base", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3", "gripper")
"""Links of a limb in order from the body; the gripper is fixed to the last."""

MEASURED = "ur5e"
"""The arm whose capsules were fitted to its shapes."""

THICKNESS, GAP = 0.06, 0.03
"""Radius of simple shapes as a share of the length of the arm, and how far those of a link and the
next but one are apart where the link between is straight [m]."""


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


def default_capsules(limb: Limb, tool_length: float) -> tuple[Capsule, ...]:
    """Return the capsules of a UR5e, or simple ones along the links, and a gripper.

    The gripper reaches from the flange to the grasp, `tool_length` away [m].
    """
    if arm_of(limb) != MEASURED:
        return (*link_capsules(limb), gripper_capsule(tool_length))
    measured = (
        Capsule(entry["link"], tuple(entry["p0"]), tuple(entry["p1"]), entry["r"])
        for entry in arm_data(MEASURED)["capsules"]
    )
    return (*measured, gripper_capsule(tool_length))


def gripper_capsule(tool_length: float) -> Capsule:
    """Return the capsule of a gripper that begins at the flange and ends at the grasp [m]."""
    radius = arm_data(MEASURED)["gripper"]["radius"]
    tip = tool_length - radius
    return Capsule("gripper", (0.0, 0.0, min(0.0, tip)), (0.0, 0.0, tip), radius)


def link_capsules(limb: Limb) -> tuple[Capsule, ...]:
    """Return simple collision shapes along the links of a limb, without a gripper.

    Each begins where it is clear of the end of the link before the last one. The last link that is
    long enough for it ends where it is clear of the flange; shorter ones after it have none.
    """
    radius, here = THICKNESS * limb.arm_length, (0.0, 0.0, 0.0)
    places = limb.steps[:, :3, 3]
    sizes = [max(float(np.linalg.norm(place)), MIN_SIZE) for place in places]
    x, y, z = places[0].tolist()
    out = [Capsule("base", here, (x, y, 0.25 * z), radius)]
    apart, before = 2.0 * radius + GAP, np.inf
    fore = max((k for k in range(1, 5) if sizes[k] > apart), default=4)
    for k in range(1, fore + 1):
        start = 0.0 if before > apart else apart
        stop = sizes[k] - apart if k == fore else sizes[k]
        if (sizes[k] > radius and start < stop) or LINKS[k] == "upper_arm":
            first, last = (as_triple(min(at / sizes[k], 1.0) * places[k]) for at in (start, stop))
            out.append(Capsule(LINKS[k], first, last, radius))
        before = sizes[k]
    d6 = past_wrist(limb)
    slim = max(min(0.6 * radius, 0.5 * abs(d6)), MIN_SIZE)
    end = -float(np.copysign(slim, d6))
    return (*out, Capsule("wrist_3", (0.0, 0.0, -0.5 * d6), (0.0, 0.0, end), slim))


def past_wrist(limb: Limb) -> float:
    """Return how far the flange is along its axis from where that is closest to axis 5 [m]."""
    z, origin = limb.steps[5, :3, 2], limb.steps[5, :3, 3]
    across = np.array([z[0], z[1], 0.0])
    return float(origin @ across / (across @ across))
