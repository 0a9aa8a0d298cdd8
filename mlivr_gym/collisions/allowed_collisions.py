"""The allowed collisions: the one table of pairs of shapes that are never compared, with reasons.

Every other pair of the robot's shapes, and every shape with every box, is compared in each stance
and along each motion. `LimbShapes` (and with it the compiled checks), `contacts` and the MuJoCo
scene omit these pairs, and those that a robot tells by its field `apart`.
"""

from __future__ import annotations

from typing import NamedTuple

from mlivr_gym.robot.capsules import LINKS

BODY = "body"
"""Name of the robot's body where links are named."""

SAME, OTHER, ANY, BOXES = "one limb", "two limbs", "any limbs", "boxes"
"""Which shapes an allowed pair concerns: of one limb, two limbs, either, or a limb and boxes."""

FIXED = "fixed to each other"


class AllowedPair(NamedTuple):
    """Two kinds of shapes that are never compared."""

    first: str
    """`BODY` or one of `LINKS`."""
    second: str
    """Another link, or a description of the boxes."""
    whose: str
    """`SAME`, `OTHER`, `ANY` or `BOXES`."""
    reason: str
    """Why the two need not be compared."""
    checked: bool = False
    """Whether the reason is tested for the robot's capsules; if it fails, they are compared."""


ALLOWED_COLLISIONS: tuple[AllowedPair, ...] = (
    *(AllowedPair(link, link, SAME, FIXED) for link in LINKS),
    AllowedPair(BODY, "base", ANY, FIXED),
    AllowedPair("base", "base", OTHER, "both fixed to the body"),
    AllowedPair("wrist_3", "gripper", SAME, FIXED),
    AllowedPair(BODY, "shoulder", ANY, "joined by joint 1: the body is one link with the bases"),
    AllowedPair("base", "shoulder", ANY, "joined by joint 1: the bases of all limbs are one link"),
    AllowedPair("shoulder", "upper_arm", SAME, "joined by joint 2"),
    AllowedPair("upper_arm", "forearm", SAME, "joined by joint 3"),
    AllowedPair("forearm", "wrist_1", SAME, "joined by joint 4"),
    AllowedPair("wrist_1", "wrist_2", SAME, "joined by joint 5"),
    AllowedPair("wrist_2", "wrist_3", SAME, "joined by joint 6"),
    AllowedPair("wrist_2", "gripper", SAME, "joined by joint 6: the gripper is fixed to wrist 3"),
    AllowedPair("base", "upper_arm", SAME, "the upper arm moves in a plane off joint 1", True),
    AllowedPair("forearm", "wrist_2", SAME, "the wrist point lies off the forearm, by d4", True),
    AllowedPair("wrist_1", "wrist_3", SAME, "the flange axis lies off wrist 1, by d5", True),
    AllowedPair("wrist_1", "gripper", SAME, "the flange axis lies off wrist 1, by d5", True),
    AllowedPair("gripper", "behind the surface that it grasps", BOXES, "the gripper grasps there"),
)  # fmt: skip
"""All pairs that are never compared.

The gripper is compared with the boxes behind the surface everywhere except at the grasp and on the
line straight above it. Shapes that stand still in the world are compared with the boxes once, by
`queries`, and not again along a motion: the limbs at rest, and the capsules on the flange axis of a
limb that holds.
"""


_ROWS = {
    (frozenset((row.first, row.second)), whose): row
    for row in ALLOWED_COLLISIONS
    for whose in (SAME, OTHER)
    if row.whose in (whose, ANY)
}


def allowed_pair(first: str, second: str, whose: str = SAME) -> AllowedPair | None:
    """Return the allowed pair of two links, or None if they are compared.

    `whose` says whether they belong to one limb (`SAME`) or to two (`OTHER`).
    """
    return _ROWS.get((frozenset((first, second)), whose))
