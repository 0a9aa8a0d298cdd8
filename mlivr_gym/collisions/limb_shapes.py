"""The robot's shapes in the form the compiled checks read."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.allowed_collisions import BODY, is_allowed
from mlivr_gym.compiled.records import Record, Rows, Vector
from mlivr_gym.kinematics.arm import set_arm
from mlivr_gym.kinematics.limb import MountedArm
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.specification import MOST_CAPSULES, MOST_LIMBS, RobotSpec

MOST_PAIRS = MOST_CAPSULES * (MOST_CAPSULES - 1) // 2
"""Most pairs of a limb's capsules."""

MOST_MOUNTS = MOST_CAPSULES * MOST_LIMBS
"""Most capsules that are fixed to the body."""

NEVER_NEARER = {(3, 5): 2, (4, 6): 1}
"""Links two joints apart, and the axis of the first along which the second stays on one side.

Axis 1 is y, axis 2 is z. The forearm moves in a plane across joint 4, off which the wrist point
lies by d4; wrist 1 lies across joint 5, off which the flange axis lies by d5.
"""


class LimbCapsule(Record):
    """A capsule that moves with a limb."""

    link: int
    """The link it is on, 1 to 6; the gripper's is the last."""
    ends: Annotated[Array, (2, 3)]
    """Ends of its axis in the link's frame [m]."""
    radius: float
    """Radius [m]."""
    anchor: Annotated[IntArray, (2,), np.int64]
    """What the motion of each end is bounded from: limb base, elbow, forearm end or wrist point."""
    arm: Annotated[Array, (2,)]
    """Distance of each end from its anchor [m]."""


class BodyCapsule(Record):
    """A capsule that moves with the base."""

    ends: Annotated[Array, (2, 3)]
    """Ends of its axis in the body frame [m]."""
    radius: float
    """Radius [m]."""


class LimbModel(MountedArm):
    """A limb with its shapes."""

    index: int
    """Number of the limb."""
    capsule_count: int
    """Number of capsules that move."""
    capsules: Annotated[Rows[LimbCapsule], (MOST_CAPSULES,)]
    """The capsules, from the mount on in the order of `LINKS`."""
    pair_count: int
    """Number of pairs of them that are compared."""
    pairs: Annotated[IntArray, (MOST_PAIRS, 2), np.int64]
    """The pairs."""
    gripper: int
    """First capsule of the gripper."""
    hand: int
    """First of the capsules that lie on the flange axis to the end: at a grasp they are where they
    are, whatever the posture."""
    least_link: Annotated[IntArray, (MOST_MOUNTS,), np.int64]
    """The first link that can meet each of the robot's mounts."""


class RobotModel(Record):
    """A robot as compiled code reads it."""

    limb_count: int
    """Number of limbs N."""
    limbs: Annotated[Rows[LimbModel], (MOST_LIMBS,)]
    """The limbs."""
    tool_length: float
    """Flange to grasp [m]."""
    lift: float
    """Departure along the surface normal [m]."""
    characteristic_length: float
    """l_c [m]."""
    fold_count: int
    """Number of folds."""
    folds: Annotated[Array, (4, 5)]
    """Joints 1 to 5 of a folded limb, in their windows [rad]."""
    half: Vector
    """Half edges of the body [m]."""
    mount_count: int
    """Number of capsules that are fixed to the body."""
    mounts: Annotated[Rows[BodyCapsule], (MOST_MOUNTS,)]
    """These capsules."""
    around_count: int
    """Number of capsules that together contain all that moves with the base."""
    around: Annotated[Rows[BodyCapsule], (MOST_MOUNTS + 4,)]
    """These, for comparison with boxes: four round the body, see `round_cube`, and the mounts."""


class ShapesOfLimb(NamedTuple):
    """Capsules of one limb in the frames of their links."""

    names: tuple[str, ...]
    """Link of each capsule that moves, c of them, from the mount on."""
    links: IntArray
    """Number of that link, shape (c,)."""
    ends: Array
    """Ends of their axes [m], shape (c, 2, 3)."""
    radii: Array
    """Their radii [m], shape (c,)."""
    pairs: IntArray
    """Pairs of them that are compared, shape (k, 2)."""


class LimbShapes:
    """Capsules of one limb, the pairs of them that can meet, and what is fixed to the body.

    Pairs that are left out stand in `ALLOWED_COLLISIONS`.

    Attributes
    ----------
    names
        Link of each capsule that moves, c of them, from the mount on.
    rows
        All this as compiled code reads it, a row of `RobotModel`, shape (1,).
    robot
        The row.
    limb
        The first limb there; in the frames of their links the limbs of most robots are equal.
    each
        Capsules of every limb; the attributes below are those of the first.
    links
        Link of each capsule that moves, shape (c,).
    ends
        Ends of their axes in the frames of their links [m], shape (c, 2, 3).
    radii
        Their radii [m], shape (c,).
    pairs
        Pairs of them that are compared, shape (k, 2).
    mounts
        Rows of `BodyCapsule`: what is fixed to the body.
    """

    def __init__(self, spec: RobotSpec) -> None:
        """Sort the robot's capsules."""
        self.rows = RobotModel.rows(1)
        self.robot: RobotModel = self.rows[0]
        robot = self.robot
        robot["limb_count"] = spec.limbs
        for name in ("tool_length", "lift", "characteristic_length"):
            robot[name] = getattr(spec, name)
        folds = _common_folds(spec)
        robot["fold_count"] = len(folds)
        robot["folds"][: len(folds)] = folds
        robot["half"][:] = 0.5 * spec.body_edges
        self._are_equal = len({(m.limb, m.capsules) for m in spec.mounted}) == 1
        self.each = tuple(self._add_limb(spec, i) for i in range(spec.limbs))
        self._add_mounts(spec)
        self.limb: LimbModel = robot["limbs"][0]
        self.names, self.links, self.ends, self.radii, self.pairs = self.each[0]
        self.mounts: Any = robot["mounts"][: robot["mount_count"]]

    def _add_limb(self, spec: RobotSpec, i: int) -> ShapesOfLimb:
        kinematics = spec.every_limb[i]
        moving = [capsule for capsule in _sorted_capsules(spec, i) if capsule.link != "base"]
        names = tuple(capsule.link for capsule in moving)
        on_axis = [c.link in LINKS[6:] or _on_flange_axis(c) for c in moving]
        pairs = [
            (a, b)
            for a in range(len(moving))
            for b in range(a + 1, len(moving))
            if _can_meet(spec, kinematics, moving[a], moving[b])
        ]
        limb = self.robot["limbs"][i]
        limb["index"], limb["capsule_count"], limb["pair_count"] = i, len(moving), len(pairs)
        limb["mount"]["position"][:] = spec.mount_positions[i]
        limb["mount"]["rotation"][:] = spec.mount_rotations[i]
        set_arm(limb["arm"], kinematics.lengths, kinematics.windows)
        limb["gripper"] = sum(name != "gripper" for name in names)
        limb["hand"] = max((c + 1 for c in range(len(moving)) if not on_axis[c]), default=0)
        limb["pairs"][: len(pairs)] = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        for c, capsule in enumerate(moving):
            row = limb["capsules"][c]
            row["link"], row["radius"] = min(LINKS.index(capsule.link), 6), capsule.radius
            row["ends"][:] = capsule.start, capsule.end
            for e, end in enumerate(row["ends"]):
                row["anchor"][e], row["arm"][e] = _anchor(kinematics, int(row["link"]), end)
        of_limb = limb["capsules"][: len(moving)]
        compared: IntArray = limb["pairs"][: len(pairs)]
        return ShapesOfLimb(names, of_limb["link"], of_limb["ends"], of_limb["radius"], compared)

    def _add_mounts(self, spec: RobotSpec) -> None:
        robot = self.robot
        round_ends, round_radius = round_box(robot["half"])
        for k in range(4):
            robot["around"][k]["ends"][:] = round_ends[k]
            robot["around"][k]["radius"] = round_radius[k]
        count = 0
        for limb in range(spec.limbs):
            rotation, position = spec.mount_rotations[limb], spec.mount_positions[limb]
            capsules = _sorted_capsules(spec, limb)
            for capsule in (capsule for capsule in capsules if capsule.link == "base"):
                row = robot["mounts"][count]
                row["ends"][:] = [position + rotation @ end for end in (capsule.start, capsule.end)]
                row["radius"] = capsule.radius
                robot["around"][4 + count] = row
                meets = _upper_arm_can_meet(capsule, capsules)
                same = 2 if meets and not spec.is_apart("base", "upper_arm") else 3
                for other in range(spec.limbs):
                    robot["limbs"][other]["least_link"][count] = same if other == limb else 2
                count += 1
        robot["mount_count"], robot["around_count"] = count, 4 + count

    def never(self, limb: int) -> list[tuple[str, str]]:
        """Pairs of a limb's links, the body among them, that are not compared.

        They are neighbours, or cannot meet.
        """
        names = (BODY, *LINKS)
        mine, _, _, _, pairs = self.each[limb]
        compared = {(mine[i], mine[j]) for i, j in pairs.tolist()}
        least = self.robot["limbs"][limb]["least_link"][: self.robot["mount_count"]]
        meets_base = {name for name in mine if LINKS.index(name) >= least.max(initial=2)}
        compared |= {(BODY, name) for name in mine if LINKS.index(name) >= 2}
        compared |= {("base", name) for name in meets_base}
        return [
            (a, b) for k, a in enumerate(names) for b in names[k + 1 :] if (a, b) not in compared
        ]

    @property
    def hands(self) -> list[Any]:
        """The robot for each of its different limbs, which comes first there, see `hands_clear`."""
        out = []
        for i in range(1 if self._are_equal else self.robot["limb_count"]):
            rows = self.rows.copy()
            rows["limbs"][0, 0] = self.rows["limbs"][0, i]
            out.append(rows)
        return out

    def __len__(self) -> int:
        """Number of capsules that move."""
        return len(self.names)


def _sorted_capsules(spec: RobotSpec, limb: int) -> list[Capsule]:
    """Return the capsules of a limb from the mount on."""
    shapes = spec.mounted[limb].capsules or ()
    return sorted(shapes, key=lambda capsule: LINKS.index(capsule.link))


def _common_folds(spec: RobotSpec) -> Array:
    """Return the folds that lie in the windows of every limb, shape (k, 5) [rad]."""
    folds = spec.every_limb[0].folds_in_windows(spec.folds)
    for limb in spec.every_limb[1:]:
        low, high = limb.windows[:5].T
        folds = folds[((folds >= low) & (folds <= high)).all(axis=1)]
    return folds


def round_box(half: Array) -> tuple[Array, Array]:
    """Return four capsules that together contain a box, see `round_cube`.

    They run along the longest edge, each in a quarter of the box.

    Parameters
    ----------
    half
        Half edges [m], shape (3,).

    Returns
    -------
    tuple[Array, Array]
        Ends, shape (4, 2, 3), and radii, shape (4,) [m].
    """
    if (half == half[0]).all():
        return round_cube(float(half[0]))
    along = int(np.argmax(half))
    across = [k for k in range(3) if k != along]
    short = 0.5 * float(half.min())
    ends = np.zeros((4, 2, 3))
    ends[:, :, along] = short - half[along], half[along] - short
    for k, (a, b) in enumerate(((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5))):
        ends[k, :, across] = np.array([a, b])[:, None] * half[across][:, None]
    radius = float(np.sqrt((0.25 * half[across] ** 2).sum() + short * short))
    return ends, np.full(4, radius)


def round_cube(half: float) -> tuple[Array, Array]:
    """Four capsules that together contain a cube of half edge `half` [m].

    Each holds a quarter of it, whose eighths lie in the spheres about their middles. They stand out
    of the faces by 0.37 half edges, the sphere round the cube by 0.73.

    Returns
    -------
    tuple[Array, Array]
        Ends, shape (4, 2, 3), and radii, shape (4,) [m].
    """
    at = 0.5 * half
    ends = np.array([[[x, y, -at], [x, y, at]] for x in (-at, at) for y in (-at, at)])
    return ends, np.full(4, np.sqrt(3.0) * at)


def _can_meet(spec: RobotSpec, limb: Limb, first: Capsule, second: Capsule) -> bool:
    """Whether two capsules of a limb, are compared, see `allowed_collisions`."""
    row = is_allowed(first.link, second.link)
    if row is None or not row.checked:
        return row is None
    if spec.is_apart(first.link, second.link):
        return False
    links = (LINKS.index(first.link), min(LINKS.index(second.link), 6))
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


def _anchor(limb: Limb, link: int, end: Array) -> tuple[int, float]:
    """Anchor of a capsule end, and the distance from there [m].

    Anchors are 0 limb base, 1 elbow, 2 forearm end, 3 wrist point; `end` is in the link frame [m].
    """
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
