"""The one table of pairs of shapes that are not compared, each with its reason.

Every other pair of a robot's shapes, and every shape with every box, is compared in each stance and
along each motion. `LimbShapes`, and with it the compiled checks, `contacts` and the MuJoCo scene,
leave out these pairs and no others.
"""

from __future__ import annotations

from typing import NamedTuple

from mlivr_gym.robot.capsules import LINKS

BODY = "body"
"""Name of the robot's body among the links."""

SAME, OTHER, ANY, BOXES = "one limb", "two limbs", "any limbs", "boxes"
"""Whose shapes a row is about: of one limb, of two, of one or two, or of a limb and the world."""

FIXED = "fixed to each other"


class AllowedPair(NamedTuple):
    """Two shapes that are not compared."""

    first: str
    """`BODY` or one of `LINKS`."""
    second: str
    """Another of them, or which boxes."""
    whose: str
    """`SAME`, `OTHER`, `ANY` or `BOXES`."""
    reason: str
    """Why they need not be compared."""
    checked: bool = False
    """Whether the reason is tested for the robot's capsules; where it fails they are compared."""


ALLOWED_COLLISIONS: tuple[AllowedPair, ...] = (
    *(AllowedPair(link, link, SAME, FIXED) for link in LINKS),
    AllowedPair(BODY, "base", ANY, FIXED),
    AllowedPair("base", "base", OTHER, "fixed to the body, both"),
    AllowedPair("wrist_3", "gripper", SAME, FIXED),
    AllowedPair(BODY, "shoulder", ANY, "joined by joint 1: the body is one link with the bases"),
    AllowedPair("base", "shoulder", ANY, "joined by joint 1: the bases of all limbs are one link"),
    AllowedPair("shoulder", "upper_arm", SAME, "joined by joint 2"),
    AllowedPair("upper_arm", "forearm", SAME, "joined by joint 3"),
    AllowedPair("forearm", "wrist_1", SAME, "joined by joint 4"),
    AllowedPair("wrist_1", "wrist_2", SAME, "joined by joint 5"),
    AllowedPair("wrist_2", "wrist_3", SAME, "joined by joint 6"),
    AllowedPair("wrist_2", "gripper", SAME, "joined by joint 6: the gripper is fixed to wrist 3"),
    AllowedPair("base", "upper_arm", SAME, "the upper arm moves in a plane beside joint 1", True),
    AllowedPair("forearm", "wrist_2", SAME, "the wrist point lies beside the forearm, by d4", True),
    AllowedPair("wrist_1", "wrist_3", SAME, "the flange axis lies beside wrist 1, by d5", True),
    AllowedPair("wrist_1", "gripper", SAME, "the flange axis lies beside wrist 1, by d5", True),
    AllowedPair("gripper", "behind the surface that it grasps", BOXES, "it takes hold there"),
)  # fmt: skip
"""All pairs that are not compared.

Gripper and boxes that lie behind the surface are left out at the grasp and on the line straight
above it, nowhere else. What stands still in the world is compared with boxes once and not again
along a motion, by `queries`: limbs at rest, and of a limb that holds the capsules on the
flange axis.
"""


_ROWS = {
    (frozenset((row.first, row.second)), whose): row
    for row in ALLOWED_COLLISIONS
    for whose in (SAME, OTHER)
    if row.whose in (whose, ANY)
}


def is_allowed(first: str, second: str, whose: str = SAME) -> AllowedPair | None:
    """The row of two links of one limb (`SAME`) or of two (`OTHER`), None if they are compared."""
    return _ROWS.get((frozenset((first, second)), whose))
