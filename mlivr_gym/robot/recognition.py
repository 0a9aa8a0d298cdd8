"""Which family of arms a chain of joints belongs to, from the axes of its joints.

A family is a row of `FAMILIES`: its recogniser takes the axes and anchors of the joints of a file
at 0 and returns the fields of a limb of the family with the signs and offsets that
turn the file's joint angles into the family's, or the reason why the chain is of another family.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mlivr_gym.errors import RobotError
from mlivr_gym.robot.joint_chain import JointChain, RecognisedArm, axis_text
from mlivr_gym.robot.recognised_ur import three_parallel
from mlivr_gym.robot.recognised_wrist import spherical_shoulder, spherical_wrist


class ArmFamily(NamedTuple):
    """A family of arms."""

    name: str
    """Its name in messages."""
    joints: int
    """Number of joints of its arms."""
    recognise: Callable[[JointChain], RecognisedArm | str]
    """Return the arm, or why the chain is not of this family."""


def recognised(chain: JointChain) -> RecognisedArm:
    """Return an arm in the terms of the first family that it belongs to.

    Raises a `RobotError` if it belongs to none; the message has the reason for each family and the
    axes.
    """
    reasons = []
    for family in FAMILIES:
        seen = chain if family.joints == len(chain.names) else chain.moving
        if len(seen.names) != family.joints:
            reasons.append(f"{family.name}: it has {len(seen.names)} joints, not {family.joints}")
            continue
        found = family.recognise(seen)
        if isinstance(found, RecognisedArm):
            return found
        reasons.append(f"{family.name}: {found}")
    axes = ", ".join(
        f"{name} {axis_text(axis)}" for name, axis in zip(chain.names, chain.axes, strict=True)
    )
    held = "" if chain.held is None else f" with joint {chain.names[chain.held.joint]!r} held"
    raise RobotError(
        f"the arm of joints {chain.names[0]!r} to {chain.names[-1]!r}{held} is of no supported "
        f"family ({'; '.join(reasons)}); axes of its joints: {axes}"
    )


FAMILIES: tuple[ArmFamily, ...] = (
    ArmFamily("three parallel axes, as a UR arm", 6, three_parallel),
    ArmFamily("spherical shoulder and wrist, as an iiwa", 7, spherical_wrist),
    ArmFamily("spherical shoulder, as a Franka", 7, spherical_shoulder),
    ArmFamily("spherical wrist", 6, spherical_wrist),
    ArmFamily("spherical shoulder of six joints", 6, spherical_shoulder),
)
"""Families of arms, in the order in which a chain is compared with them."""
