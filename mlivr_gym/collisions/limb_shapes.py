"""The robot's shapes in the form the compiled checks read."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.uncompared import BODY, not_compared
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.specification import RobotSpec

NEVER_NEARER = {(3, 5): 2, (4, 6): 1}
"""Links two joints apart, and the axis of the first along which the second stays on one side.

Axis 1 is y, axis 2 is z. The forearm moves in a plane across joint 4, off which the wrist point
lies by d4; wrist 1 lies across joint 5, off which the flange axis lies by d5.
"""


class LimbShapes:
    """Capsules of one limb, the pairs of them that can meet, and what is fixed to the body.

    Pairs that are left out stand in `uncompared.NOT_COMPARED`.

    Attributes:
        arrays: Link of each capsule (c,), ends in the link frame (c, 2, 3) [m], radii (c,) [m],
            pairs of capsules that can meet (k, 2), and for each end the anchor its motion is
            bounded from (c, 2) and the distance to it (c, 2) [m]; see `swept_swing`.
        first_gripper: First capsule of the gripper; those from the mount on follow the order of
            `LINKS`.
        hand: First of the capsules that lie on the flange axis to the end: at a grasp they are
            where they are, whatever the posture.
        fixed: Ends (k, 2, 3) and radii (k,) of the capsules fixed to the body, in its frame [m],
            half edges of the body (3,) [m], and the first link of each limb that can meet each of
            those capsules (N, k).
        body: Ends (4 + k, 2, 3) and radii (4 + k,) of capsules in the body frame that contain all
            that moves with the base, for comparison with boxes [m]: four round the body, see
            `round_cube`, and the mounts of `fixed`.
    """

    def __init__(self, robot: RobotSpec) -> None:
        """Sort the robot's capsules."""
        capsules = sorted(robot.shapes, key=lambda capsule: LINKS.index(capsule.link))
        moving = [capsule for capsule in capsules if capsule.link != "base"]
        link = np.array([min(LINKS.index(capsule.link), 6) for capsule in moving], dtype=np.int64)
        ends = np.array([[capsule.start, capsule.end] for capsule in moving])
        radius = np.array([capsule.radius for capsule in moving])
        self.names = tuple(capsule.link for capsule in moving)
        self.first_gripper = sum(name != "gripper" for name in self.names)
        on_axis = [c.link in LINKS[6:] or _on_flange_axis(c) for c in moving]
        self.hand = max((c + 1 for c in range(len(moving)) if not on_axis[c]), default=0)
        pairs = [
            (i, j)
            for i in range(len(moving))
            for j in range(i + 1, len(moving))
            if _can_meet(robot, moving[i], moving[j])
        ]
        anchors = np.empty((len(moving), 2), dtype=np.int64)
        arms = np.empty((len(moving), 2))
        for c in range(len(moving)):
            for e in range(2):
                anchors[c, e], arms[c, e] = _anchor(robot, int(link[c]), ends[c, e])
        self.arrays: tuple[Any, ...] = (
            link, ends, radius, np.array(pairs, dtype=np.int64).reshape(-1, 2), anchors, arms,
        )  # fmt: skip
        mounts, mount_radius, least = [], [], []
        for limb, (rotation, position) in enumerate(
            zip(robot.mount_rotations, robot.mount_positions, strict=True)
        ):
            for capsule in capsules:
                if capsule.link == "base":
                    mounts.append(
                        [position + rotation @ capsule.start, position + rotation @ capsule.end]
                    )
                    mount_radius.append(capsule.radius)
                    same = 2 if _upper_arm_can_meet(capsule, capsules) else 3
                    least.append([same if other == limb else 2 for other in range(robot.limbs)])
        half = np.full(3, 0.5 * robot.body_size)
        self.fixed = (
            np.array(mounts).reshape(-1, 2, 3), np.array(mount_radius), half,
            np.array(least, dtype=np.int64).reshape(-1, robot.limbs).T.copy(),
        )  # fmt: skip
        round_ends, round_radius = round_cube(float(half[0]))
        self.body = (
            np.concatenate([round_ends, self.fixed[0]]),
            np.concatenate([round_radius, self.fixed[1]]),
        )

    def never(self, limb: int) -> list[tuple[str, str]]:
        """Pairs of a limb's links, the body among them, that are not compared.

        They are neighbours, or cannot meet.
        """
        names = (BODY, *LINKS)
        compared = {(self.names[i], self.names[j]) for i, j in self.arrays[3].tolist()}
        meets_base = {
            name
            for name in self.names
            if LINKS.index(name) >= int(self.fixed[3][limb].max(initial=2))
        }
        compared |= {(BODY, name) for name in self.names if LINKS.index(name) >= 2}
        compared |= {("base", name) for name in meets_base}
        return [
            (a, b) for k, a in enumerate(names) for b in names[k + 1 :] if (a, b) not in compared
        ]

    def __len__(self) -> int:
        """Number of capsules that move."""
        return len(self.names)


def round_cube(half: float) -> tuple[Array, Array]:
    """Four capsules that together contain a cube of half edge `half` [m].

    Each holds a quarter of it, whose eighths lie in the spheres about their middles. They stand out
    of the faces by 0.37 half edges, the sphere round the cube by 0.73.

    Returns:
        Ends, shape (4, 2, 3), and radii, shape (4,) [m].
    """
    at = 0.5 * half
    ends = np.array([[[x, y, -at], [x, y, at]] for x in (-at, at) for y in (-at, at)])
    return ends, np.full(4, np.sqrt(3.0) * at)


def _can_meet(robot: RobotSpec, first: Capsule, second: Capsule) -> bool:
    """Whether two capsules of a limb, in the order of `LINKS`, are compared, see `uncompared`."""
    row = not_compared(first.link, second.link)
    if row is None or not row.checked:
        return row is None
    limb, links = robot.limb, (LINKS.index(first.link), min(LINKS.index(second.link), 6))
    if NEVER_NEARER[links] == 2:
        reach = max(float(np.linalg.norm(end)) for end in (second.start, second.end))
        gap = limb.d4 - max(first.start[2], first.end[2]) - reach
    else:
        gap = min(first.start[1], first.end[1]) + limb.d5
    return gap < first.radius + second.radius


def _on_flange_axis(capsule: Capsule) -> bool:
    """Whether a capsule on wrist 2, whose y axis is the flange axis, lies on it."""
    across = [abs(end[k]) for end in (capsule.start, capsule.end) for k in (0, 2)]
    return capsule.link == "wrist_2" and max(across) < 1e-9


def _upper_arm_can_meet(base: Capsule, capsules: list[Capsule]) -> bool:
    """Whether an upper arm can touch a capsule on the base of its limb.

    It moves in a plane beside joint 1.
    """
    off = max(float(np.hypot(end[0], end[1])) for end in (base.start, base.end)) + base.radius
    return any(
        min(c.start[2], c.end[2]) - c.radius < off for c in capsules if c.link == "upper_arm"
    )


def _anchor(robot: RobotSpec, link: int, end: Array) -> tuple[int, float]:
    """Anchor of a capsule end, and the distance from there [m].

    Anchors are 0 limb base, 1 elbow, 2 forearm end, 3 wrist point; `end` is in the link frame [m].
    """
    limb = robot.limb
    options = {
        1: ((0, (0.0, 0.0, 0.0)),),
        2: ((0, (0.0, 0.0, 0.0)), (1, (limb.a2, 0.0, 0.0))),
        3: ((1, (0.0, 0.0, 0.0)), (2, (limb.a3, 0.0, 0.0))),
        4: ((2, (0.0, 0.0, -limb.d4)), (3, (0.0, -limb.d5, 0.0))),
        5: ((3, (0.0, 0.0, 0.0)),),
        6: ((3, (0.0, 0.0, -limb.d6)),),
    }[link]
    arms = [(float(np.linalg.norm(end - np.array(place))), anchor) for anchor, place in options]
    arm, anchor = min(arms)
    return anchor, arm
