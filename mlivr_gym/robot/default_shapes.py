"""Collision shapes of limbs that bring none."""

from __future__ import annotations

import numpy as np

from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.limb_dynamics import arm_data, arm_of
from mlivr_gym.values import MIN_SIZE, as_triple

MEASURED = "ur5e"
"""The arm whose capsules were fitted to its shapes."""

THICKNESS, GAP = 0.06, 0.03
"""Radius of simple shapes as a share of the length of the arm, and how far those of a link and the
next but one are apart where the link between is straight [m]."""


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
