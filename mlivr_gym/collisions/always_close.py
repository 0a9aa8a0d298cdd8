"""Links whose capsules are close to each other, or to the body, in every posture.

Capsules that are fitted to a file's shapes exceed them. Where two links are near each other in
every posture, as forearm and wrist 2 of a UR arm, the excess may leave no posture at all.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.collisions.allowed_collisions import BODY
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.robot.validators import APART

DRAWN = 200
"""Number of drawn postures."""


MOST_TOLD = 12
"""Largest number of pairs that a message lists."""


def always_close_links(robot: RobotSpec, clearance: float) -> tuple[tuple[str, str], ...]:
    """Return links of a limb, or a link and the body, that are close in every drawn posture.

    Joint angles are drawn from the joint limits, uniformly and with a fixed seed. Pairs of `APART`
    are in its order. Links of two limbs have the limb before their names.

    Parameters
    ----------
    robot
        The robot.
    clearance
        Distance below which shapes are close to each other [m].
    """
    rng = np.random.default_rng(0)
    low, high = np.moveaxis(robot.joint_limits, -1, 0)
    at = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    kept: set[tuple[str, str]] | None = None
    for _ in range(DRAWN):
        close = set()
        for contact in contacts(robot, (), (*at, rng.uniform(low, high)), clearance):
            limb, *link = contact.first.split("/")
            other, *second = contact.second.split("/")
            if BODY in (limb, other):
                close.add((BODY, (link or second)[0]))
            elif limb == other:
                close.add((link[0], second[0]))
            elif link and second:
                close.add((f"{limb}/{link[0]}", f"{other}/{second[0]}"))
        kept = close if kept is None else kept & close
    return tuple(sorted(pair[::-1] if pair[::-1] in APART else pair for pair in kept or ()))


def told_always_close(robot: RobotSpec, clearance: float) -> str:
    """Return which links are always close, and what would help; empty if none are."""
    pairs = always_close_links(robot, clearance)
    if not pairs:
        return ""
    listed = ", ".join(f"{first} and {second}" for first, second in pairs[:MOST_TOLD])
    if len(pairs) > MOST_TOLD:
        listed += f", and {len(pairs) - MOST_TOLD} other pairs"
    remedies = ["a smaller clearance", "narrower capsules"]
    if robot.capsules is not None:
        remedies.append("capsules='ur5e' of from_urdf")
    between = any("/" in pair[0] for pair in pairs)
    if between or any(BODY in pair for pair in pairs):
        remedies.append("a larger mount_radius" + ", or limbs farther apart" * between)
    if apart := [pair for pair in pairs if pair in APART]:
        remedies.append(
            f"apart={[*robot.apart, *apart]} (--allow-touching) if these links never meet"
        )
    return (
        f"{listed}{'' if between else ' of a limb'} are within {clearance:g} m of each other in "
        "every posture; give "
        f"{', '.join(remedies[:-1])}, or {remedies[-1]}"
    )
