"""The robot's collision shapes as records for compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Annotated, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.allowed_collisions import BODY, allowed_pair
from mlivr_gym.compiled.records import Record, Rows, Vector
from mlivr_gym.kinematics.chain_record import set_chain
from mlivr_gym.kinematics.limb import MountedArm
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.sizes import MOST_CAPSULES, MOST_LIMBS
from mlivr_gym.robot.specification import RobotSpec

MOST_PAIRS = MOST_CAPSULES * (MOST_CAPSULES - 1) // 2
"""Maximum number of pairs of capsules of one limb."""

MOST_MOUNTS = MOST_CAPSULES * MOST_LIMBS
"""Maximum number of capsules that are fixed to the body."""

CARGO_CELLS = 4
"""Capsules that cover the cargo along each of its two shorter edges: fewer would protrude more."""


class LimbCapsule(Record):
    """A capsule that moves with a limb."""

    link: int
    """The link that carries it, 1 to 6; the gripper belongs to link 6."""
    ends: Annotated[Array, (2, 3)]
    """Ends of its axis in the link frame [m]."""
    radius: float
    """Radius [m]."""


class BodyCapsule(Record):
    """A capsule that moves with the base."""

    ends: Annotated[Array, (2, 3)]
    """Ends of its axis in the body frame [m]."""
    radius: float
    """Radius [m]."""


class LimbModel(MountedArm):
    """A limb with its collision capsules."""

    index: int
    """Index of the limb."""
    capsule_count: int
    """Number of its moving capsules."""
    capsules: Annotated[Rows[LimbCapsule], (MOST_CAPSULES,)]
    """These capsules, ordered from the mount to the gripper as in `LINKS`."""
    pair_count: int
    """Number of pairs of its capsules that are compared."""
    pairs: Annotated[IntArray, (MOST_PAIRS, 2), np.int64]
    """Capsule indices of these pairs."""
    gripper: int
    """Index of the first capsule of the gripper."""
    first_on_axis: int
    """Index from which on all capsules lie on the flange axis.

    At a grasp the place of these capsules does not depend on the posture.
    """
    first_link: Annotated[IntArray, (MOST_MOUNTS,), np.int64]
    """First link of this limb that can touch each of the capsules fixed to the body."""


class RobotModel(Record):
    """A robot with its kinematics and collision shapes, as compiled code reads it."""

    limb_count: int
    """Number of limbs N."""
    limbs: Annotated[Rows[LimbModel], (MOST_LIMBS,)]
    """The limbs."""
    tool_length: float
    """Distance from the flange to the grasped point [m]."""
    lift: float
    """Distance of a departure along the surface normal [m]."""
    characteristic_length: float
    """Characteristic length l_c [m]."""
    fold_count: int
    """Number of folded configurations."""
    folds: Annotated[Array, (4, 5)]
    """Angles of joints 1 to 5 of a folded limb, in their joint windows [rad]."""
    half: Vector
    """Half edges of the body [m]."""
    mount_count: int
    """Number of capsules that are fixed to the body."""
    mounts: Annotated[Rows[BodyCapsule], (MOST_MOUNTS,)]
    """These capsules."""
    base_capsule_count: int
    """Number of capsules that cover everything that moves with the base."""
    base_capsules: Annotated[Rows[BodyCapsule], (MOST_MOUNTS + 4,)]
    """These capsules, compared with boxes: four about the body (`box_capsules`) and the mounts."""


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
    """Collision capsules of a robot, and the pairs of them that are compared.

    Pairs that are never compared are listed in `ALLOWED_COLLISIONS`. `rows` is the robot as
    compiled code reads it, a record of `RobotModel`, shape (1,), `robot` that record, and `limb`
    its first limb. Of the c moving capsules of the first limb, from the mount to the gripper,
    `names` and `links` (c,) are their links, `ends` those of their axes in the link frames
    (c, 2, 3) and `radii` (c,) their radii [m], and `pairs` (k, 2) those that are compared; `each`
    has the capsules of every limb. `mounts` are the capsules fixed to the body, records of
    `BodyCapsule`, of which those that cover the cargo come last.
    """

    def __init__(self, spec: RobotSpec) -> None:
        """Build the record of a robot from its specification."""
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
        """Write limb `i` with its capsules into the robot, and return its shapes."""
        kinematics = spec.every_limb[i]
        moving = [capsule for capsule in _sorted_capsules(spec, i) if capsule.link != "base"]
        names = tuple(capsule.link for capsule in moving)
        on_axis = [c.link in LINKS[6:] or _on_flange_axis(kinematics, c) for c in moving]
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
        set_chain(limb["arm"], kinematics.steps, kinematics.senses, kinematics.windows)
        limb["gripper"] = sum(name != "gripper" for name in names)
        limb["first_on_axis"] = max(
            (c + 1 for c in range(len(moving)) if not on_axis[c]), default=0
        )
        limb["pairs"][: len(pairs)] = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        for c, capsule in enumerate(moving):
            row = limb["capsules"][c]
            row["link"], row["radius"] = min(LINKS.index(capsule.link), 6), capsule.radius
            row["ends"][:] = capsule.start, capsule.end
        of_limb = limb["capsules"][: len(moving)]
        compared: IntArray = limb["pairs"][: len(pairs)]
        return ShapesOfLimb(names, of_limb["link"], of_limb["ends"], of_limb["radius"], compared)

    def _add_mounts(self, spec: RobotSpec) -> None:
        """Write the capsules of the body and of all mounts into the robot."""
        robot = self.robot
        round_ends, round_radius = box_capsules(robot["half"])
        for k in range(4):
            robot["base_capsules"][k]["ends"][:] = round_ends[k]
            robot["base_capsules"][k]["radius"] = round_radius[k]
        count = 0
        for limb in range(spec.limbs):
            rotation, position = spec.mount_rotations[limb], spec.mount_positions[limb]
            capsules = _sorted_capsules(spec, limb)
            for capsule in (capsule for capsule in capsules if capsule.link == "base"):
                row = robot["mounts"][count]
                row["ends"][:] = [position + rotation @ end for end in (capsule.start, capsule.end)]
                row["radius"] = capsule.radius
                robot["base_capsules"][4 + count] = row
                meets = _upper_arm_can_meet(capsule, capsules)
                same = 2 if meets and not spec.is_apart("base", "upper_arm") else 3
                for other in range(spec.limbs):
                    robot["limbs"][other]["first_link"][count] = same if other == limb else 2
                count += 1
        for axis, radius in zip(*cargo_capsules(spec), strict=True):
            row = robot["mounts"][count]
            row["ends"][:], row["radius"] = axis, radius
            robot["base_capsules"][4 + count] = row
            robot["limbs"]["first_link"][: spec.limbs, count] = 2
            count += 1
        robot["mount_count"], robot["base_capsule_count"] = count, 4 + count

    def never(self, limb: int) -> list[tuple[str, str]]:
        """Return the pairs of a limb's links, and of links and the body, that are never compared.

        They are neighbours, or cannot touch each other.
        """
        names = (BODY, *LINKS)
        mine, _, _, _, pairs = self.each[limb]
        compared = {(mine[i], mine[j]) for i, j in pairs.tolist()}
        least = self.robot["limbs"][limb]["first_link"][: self.robot["mount_count"]]
        meets_base = {name for name in mine if LINKS.index(name) >= least.max(initial=2)}
        compared |= {(BODY, name) for name in mine if LINKS.index(name) >= 2}
        compared |= {("base", name) for name in meets_base}
        return [
            (a, b) for k, a in enumerate(names) for b in names[k + 1 :] if (a, b) not in compared
        ]

    @property
    def by_limb(self) -> list[Any]:
        """Robots in which each of the different limbs comes first, see `check_points`."""
        out = []
        for i in range(1 if self._are_equal else self.robot["limb_count"]):
            rows = self.rows.copy()
            rows["limbs"][0, 0] = self.rows["limbs"][0, i]
            out.append(rows)
        return out

    def __len__(self) -> int:
        """Return the number of moving capsules of a limb."""
        return len(self.names)


def _sorted_capsules(spec: RobotSpec, limb: int) -> list[Capsule]:
    """Return the capsules of a limb from the mount on."""
    shapes = spec.mounted[limb].capsules or ()
    return sorted(shapes, key=lambda capsule: LINKS.index(capsule.link))


def folds_in_windows(limb: Limb, folds: Sequence[Sequence[float]]) -> Array:
    """Return those of some folds, joints 1 to 5, that lie in a limb's windows, (k, 5) [rad]."""
    low, high = limb.windows[:5].T
    angles = np.array(folds, dtype=np.float64).reshape(-1, 5)
    angles = low + np.mod(angles - low, 2.0 * np.pi)
    inside: Array = angles[(angles <= high).all(axis=1)]
    return inside


def _common_folds(spec: RobotSpec) -> Array:
    """Return the folds that lie in the windows of every limb, shape (k, 5) [rad]."""
    folds = folds_in_windows(spec.every_limb[0], spec.folds)
    for limb in spec.every_limb[1:]:
        low, high = limb.windows[:5].T
        folds = folds[((folds >= low) & (folds <= high)).all(axis=1)]
    return folds


def cargo_capsules(spec: RobotSpec) -> tuple[Array, Array]:
    """Return capsules that contain the cargo, then those of the locked limb that holds it.

    Ends have shape (k, 2, 3), in the body frame, radii (k,) [m].
    """
    if spec.cargo is None:
        return np.zeros((0, 2, 3)), np.zeros(0)
    ends, radii = cargo_box_capsules(spec.cargo, spec.cargo_frame)
    held = spec.cargo.limb_capsules
    axes, around = np.array([axis for _, axis, _ in held]), [radius for *_, radius in held]
    return np.concatenate([ends, axes.reshape(-1, 2, 3)]), np.concatenate([radii, around])


def cargo_box_capsules(cargo: Cargo, frame: Array) -> tuple[Array, Array]:
    """Return capsules that contain the box of cargo whose middle has a frame (4, 4)."""
    ends, radii = box_capsules(0.5 * cargo.edges, CARGO_CELLS)
    return ends @ frame[:3, :3].T + frame[:3, 3], radii


def box_capsules(half: Array, cells: int = 2) -> tuple[Array, Array]:
    """Return capsules that together contain a box, four of them as in `cube_capsules`.

    They run along the longest edge, each in one of `cells` by `cells` parts of the box. Ends have
    shape (cells^2, 2, 3), radii (cells^2,), half edges (3,) [m].
    """
    if cells == 2 and (half == half[0]).all():
        return cube_capsules(float(half[0]))
    along = int(np.argmax(half))
    across = [k for k in range(3) if k != along]
    short = float(half.min()) / cells
    ends = np.zeros((cells * cells, 2, 3))
    ends[:, :, along] = short - half[along], half[along] - short
    places = (2.0 * np.arange(cells) + 1.0) / cells - 1.0
    for k, (a, b) in enumerate(product(places.tolist(), repeat=2)):
        ends[k, :, across] = np.array([a, b])[:, None] * half[across][:, None]
    radius = float(np.sqrt(((half[across] / cells) ** 2).sum() + short * short))
    return ends, np.full(cells * cells, radius)


def cube_capsules(half: float) -> tuple[Array, Array]:
    """Four capsules that together contain a cube of half edge `half` [m].

    Each contains a quarter of the cube: the spheres at its ends contain an eighth each. The
    capsules protrude from the faces by 0.37 half edges; the sphere about the cube protrudes by
    0.73. Ends have shape (4, 2, 3), radii (4,) [m].
    """
    at = 0.5 * half
    ends = np.array([[[x, y, -at], [x, y, at]] for x in (-at, at) for y in (-at, at)])
    return ends, np.full(4, np.sqrt(3.0) * at)


def _can_meet(spec: RobotSpec, limb: Limb, first: Capsule, second: Capsule) -> bool:
    """Return whether two capsules of one limb are compared, see `allowed_collisions`."""
    row = allowed_pair(first.link, second.link)
    if row is None or not row.checked:
        return row is None
    if spec.is_apart(first.link, second.link):
        return False
    k = LINKS.index(first.link)
    before, after = limb.steps[k], limb.steps[k + 1]
    # Along the axis of the joint between them neither moves by its turns.
    ends = np.array([first.start, first.end]) - before[:3, 3]
    heights = ends @ before[:3, 2]
    others = []
    for x, y, z in (second.start, second.end):
        middle = after[2, 3] + z * after[2, 2]
        aside = np.hypot(x, y) * np.sqrt(max(1.0 - after[2, 2] ** 2, 0.0))
        others += [middle - aside, middle + aside]
    gap = max(min(others) - heights.max(), heights.min() - max(others))
    return bool(gap < first.radius + second.radius)


def _on_flange_axis(limb: Limb, capsule: Capsule) -> bool:
    """Return whether a capsule of wrist 2 lies on the flange axis."""
    if capsule.link != "wrist_2":
        return False
    tip, out = limb.steps[5, :3, 3], limb.steps[5, :3, 2]
    across = [np.linalg.norm(np.cross(end - tip, out)) for end in (capsule.start, capsule.end)]
    return bool(max(across) < 1e-9)


def _upper_arm_can_meet(base: Capsule, capsules: list[Capsule]) -> bool:
    """Return whether an upper arm can touch a capsule on the base of its own limb.

    The upper arm moves in a plane at a distance from the axis of joint 1.
    """
    off = max(float(np.hypot(end[0], end[1])) for end in (base.start, base.end)) + base.radius
    return any(
        min(c.start[2], c.end[2]) - c.radius < off for c in capsules if c.link == "upper_arm"
    )
