"""Collision shapes of the UR5e, stretched to the lengths of another limb."""

from __future__ import annotations

import numpy as np

from mlivr_gym.robot.any_limb import AnyLimb
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.limb_dynamics import arm_data
from mlivr_gym.robot.ssrms_limb import SsrmsLimb


def stretched_capsules(limb: AnyLimb, tool_length: float) -> tuple[Capsule, ...]:
    """Return the UR5e's capsules, stretched to a limb's lengths, and a gripper [m].

    A limb of another family has simple capsules along its links instead.

    The gripper reaches from the flange to the grasp. Radii are the UR5e's whatever the lengths.
    """
    if not isinstance(limb, Limb) or isinstance(limb, SsrmsLimb):
        return (*limb.link_capsules, gripper_capsule(tool_length))
    data = arm_data("ur5e")
    published = data["dh"]
    stretch = {
        "upper_arm": (limb.a2 / published["a2"], 1.0, limb.d4 / published["d4"]),
        "forearm": (limb.a3 / published["a3"], 1.0, limb.d4 / published["d4"]),
        "wrist_1": (1.0, 1.0, limb.d5 / published["d5"]),
        "wrist_3": (1.0, 1.0, limb.d6 / published["d6"]),
    }  # fmt: skip
    out = []
    for entry in data["capsules"]:
        factor = np.array(stretch.get(entry["link"], (1.0, 1.0, 1.0)))
        start, end = (tuple((np.array(entry[name]) * factor).tolist()) for name in ("p0", "p1"))
        out.append(Capsule(entry["link"], start, end, entry["r"]))
    return (*out, gripper_capsule(tool_length))


def gripper_capsule(tool_length: float, behind: float = 0.0) -> Capsule:
    """Return the capsule of a gripper that x [m]."""
    radius = arm_data("ur5e")["gripper"]["radius"]
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
