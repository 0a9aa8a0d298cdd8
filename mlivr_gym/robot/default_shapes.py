"""Collision shapes of limbs that bring none."""

from __future__ import annotations

import numpy as np

from mlivr_gym.robot.any_limb import AnyLimb
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.limb_dynamics import arm_data, arm_of

MEASURED = "ur5e"
"""The arm whose capsules were fitted to its shapes."""


def default_capsules(limb: AnyLimb, tool_length: float) -> tuple[Capsule, ...]:
    """Return the capsules of a UR5e, or simple ones along the links, and a gripper.

    The gripper reaches from the flange to the grasp, `tool_length` away [m].
    """
    if arm_of(limb) != MEASURED:
        return (*limb.link_capsules, gripper_capsule(tool_length))
    measured = (
        Capsule(entry["link"], tuple(entry["p0"]), tuple(entry["p1"]), entry["r"])
        for entry in arm_data(MEASURED)["capsules"]
    )
    return (*measured, gripper_capsule(tool_length))


def gripper_capsule(tool_length: float, behind: float = 0.0) -> Capsule:
    """Return the capsule of a gripper that begins behind the flange and ends at the grasp [m]."""
    radius = arm_data(MEASURED)["gripper"]["radius"]
    tip = tool_length - radius
    return Capsule("gripper", (0.0, 0.0, min(0.0 - behind, tip)), (0.0, 0.0, tip), radius)


def farthest_part(limb: AnyLimb, capsules: tuple[Capsule, ...], tool_length: float) -> float:
    """Return an upper bound of the distance of any part of a limb from its base [m]."""
    # In the order of `LINKS`, of which the gripper is on the flange.
    origins = (*limb.link_distances, limb.link_distances[-1])
    farthest = limb.reach + tool_length
    for capsule in capsules:
        end = max(float(np.linalg.norm(end)) for end in (capsule.start, capsule.end))
        farthest = max(farthest, origins[LINKS.index(capsule.link)] + end + capsule.radius)
    return farthest
