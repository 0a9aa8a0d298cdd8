"""A limb whose arm has a spherical wrist, of six joints or of seven of which one is held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import Capsule
from mlivr_gym.robot.limb import (
    BACK,
    CELLS,
    FAMILIES,
    FARTHEST_TURN,
    FORTH,
    LENGTH,
    STRAIGHT,
    AnchorPlace,
    LimbBase,
    LinkOffset,
)
from mlivr_gym.schema import Choice, FieldPath, Integer, OrNone, Struct, Tuples
from mlivr_gym.values import MIN_SIZE, Triple

HELD_JOINT = 3
"""The joint of a seven-joint arm that is held by default: the roll of the upper arm."""

QUARTER = 0.5 * np.pi
"""A quarter turn [rad]."""

SHIFTS = {None: (0.0,) * 6, 1: (0.0, QUARTER, QUARTER, 0.0, 0.0, 0.0),
          2: (-QUARTER, 0.0, QUARTER, 0.0, 0.0, 0.0), 3: (0.0,) * 6}  # fmt: skip
"""By how much angles of the joints that move exceed those of the arm, by the held joint [rad].

Without joint 1, 2 or 3 the six other joints have a closed form, see `kinematics.spherical_wrist`,
whose zero angles these are.
"""

DEGREES = (170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 175.0)
"""Limits of the joints of a KUKA LBR iiwa 14 R820 in either direction [degrees], the maker's."""

JOINT_LIMITS = tuple((-limit, limit) for limit in np.deg2rad(DEGREES).tolist())
"""The same in radians, lower and upper limit of each joint."""

WINDOW_STARTS = (-np.pi,) * 6
"""Where the windows of the joints that move begin [rad], see `LimbBase.windows`."""

FOLDS = (
    (0.0, -0.6, 0.0, 2.0, 0.0, 0.6, 0.0),
    (0.0, 0.9, 0.0, -2.0, 0.0, 0.6, 0.0),
)
"""Joints of an arm folded back over itself, away from the surface and towards it [rad]."""

THICKNESS = 0.08
"""Radius of the default collision shapes as a share of the length of upper arm and forearm."""


@dataclass(frozen=True)
class SphericalWristLimb(LimbBase):
    """An arm whose last three axes meet, of six joints, or of seven of which one is held.

    At joint angles of 0 the arm stands upright along z of its base. The joints of a seven-joint arm
    turn about z, -y, z, -y, z, -y, z; an arm of six has no joint 3. The defaults are the published
    lengths and limits of a KUKA LBR iiwa 14 R820, whose joint 3 is held; its joints 2 and 6 turn in
    the other sense there.

    One of joints 1, 2 and 3 can be held. Angles of the six others are those of the arm plus
    `SHIFTS`. A joint that is held does not move while the limb holds or swings. Manipulability is
    that of the six joints that move, a lower bound of that of all seven: `det(J J^T)` is the sum of
    the squares of the determinants of all choices of six columns (Cauchy-Binet).

    Attributes
    ----------
    family
        `"spherical_wrist"`.
    d1
        Height of axis 2 over the base [m].
    a1
        Distance of axis 2 from axis 1 [m]; 0 of an arm of seven joints.
    d2
        Offset of the arm along axis 2 [m]; 0 of an arm of seven joints.
    a2
        Upper arm, from axis 2 to the elbow axis [m].
    b2
        Distance of the elbow axis from the line along the upper arm [m]; 0 of an arm of six joints.
    a3
        Distance of the forearm's axis from the elbow axis [m].
    d4
        Forearm, from the elbow to the wrist point [m].
    d6
        From the wrist point to the flange [m].
    held_joint
        Number of the joint of a seven-joint arm that is held, 1, 2 or 3; None of six joints.
    held_angle
        Angle at which it is held [rad].
    joint_limits
        Lower and upper limit of each joint [rad], the held one among them: seven or six pairs.
    window_starts
        Where the turn begins in which each of the six joints stays while the limb holds [rad], see
        `windows`.

    Examples
    --------
    >>> SphericalWristLimb(held_angle=0.7).windows.shape
    (6, 2)
    """

    family: str = FAMILIES[1]
    d1: float = 0.36
    a1: float = 0.0
    d2: float = 0.0
    a2: float = 0.42
    a3: float = 0.0
    d4: float = 0.4
    d6: float = 0.126
    held_joint: int | None = HELD_JOINT
    held_angle: float = 0.0
    joint_limits: tuple[tuple[float, float], ...] = JOINT_LIMITS
    window_starts: tuple[float, ...] = WINDOW_STARTS
    b2: float = 0.0

    def __post_init__(self) -> None:
        """Check lengths, limits and the held joint."""
        place = FieldPath("limb", RobotError)
        SPHERICAL_WRIST_LIMB.check(self, place)
        if self.a2 < 0.0 or np.hypot(self.a2, self.b2) < MIN_SIZE:
            raise place.field("a2").fault(f"is {self.a2:g}; the upper arm must have a length")
        if np.hypot(self.a3, self.d4) < MIN_SIZE:
            raise place.field("d4").fault(f"is {self.d4:g}; the forearm must have a length")
        self.check_joints(place)
        if self.held_joint is None and self.held_angle != 0.0:
            raise place.field("held_angle").fault(
                f"is {self.held_angle:g}, but no joint is held; set held_joint to {HELD_JOINT}"
            )
        for name in ("b2",) if self.held_joint is None else ("a1", "d2"):
            if getattr(self, name) != 0.0:
                of = "of an arm of six joints"
                if self.held_joint is not None:
                    of = (
                        f"where joint {self.held_joint} is held, the shoulder of a seven-joint arm "
                        "being spherical"
                    )
                raise place.field(name).fault(f"is {getattr(self, name):g}; it must be 0 {of}")
        if self.held_joint == 2 and abs(np.sin(self.held_angle)) < MIN_SIZE:
            raise place.field("held_angle").fault(
                f"is {self.held_angle:g} rad; with joint 2 held there joints 1 and 3 are in line"
            )

    @property
    def lengths(self) -> Array:
        """Lengths d1, a1, d2, a2, b2, a3, d4, d6 [m] and two angles [rad], shape (10,).

        They are those of the form of the six joints that move, see `kinematics.spherical_wrist`.
        """
        shoulder = (self.d1, self.a1, self.d2, self.a2, self.b2)
        twist, held = QUARTER, self.held_angle
        if self.held_joint in (1, 2):
            shoulder = (0.0 if self.held_joint == 1 else self.d1, 0.0, 0.0, self.b2, -self.a2)
            twist, held = (QUARTER if self.held_joint == 1 else self.held_angle), QUARTER
        return np.array((*shoulder, self.a3, self.d4, self.d6, twist, held), dtype=np.float64)

    @property
    def base_in_mount(self) -> tuple[Array, Array] | None:
        """Axes (3, 3) and origin [m] of the base of the joints that move in the limb's mount.

        If joint 1 is held the base is at the shoulder, its z axis that of joint 2 and its y axis
        that of joint 1, turned back; else the mount is the base, None.
        """
        if self.held_joint != 1:
            return None
        c, s = np.cos(self.held_angle), np.sin(self.held_angle)
        axes = np.array([[-c, 0.0, s], [-s, 0.0, -c], [0.0, -1.0, 0.0]])
        return axes, np.array([0.0, 0.0, self.d1])

    @property
    def joint_shifts(self) -> Array:
        """By how much angles of the joints that move exceed those of the arm [rad], `SHIFTS`."""
        return np.array(SHIFTS[self.held_joint])

    @property
    def reach(self) -> float:
        """An upper bound of the flange's distance from the mount [m]."""
        return self.link_distances[-1]

    @property
    def arm_length(self) -> float:
        """Length of upper arm and forearm together [m]."""
        return float(np.hypot(self.a2, self.b2) + np.hypot(self.a3, self.d4))

    @property
    def family_code(self) -> int:
        """Number of the family, see `kinematics.arm`."""
        return FAMILIES.index(self.family)

    @property
    def default_folds(self) -> tuple[tuple[float, ...], ...]:
        """Angles of joints 1 to 5 at which a free limb may stay folded [rad]."""
        folds = np.array(FOLDS)
        if self.held_joint is None:
            folds = np.delete(folds, HELD_JOINT - 1, axis=1)
        return tuple(map(tuple, self.moving_angles(folds)[:, :5].tolist()))

    @property
    def link_offsets(self) -> tuple[LinkOffset, ...]:
        """Frames of the six links, each in that of the link before it, at joint angles of 0.

        Joints turn about the z axes; the last frame is the flange's.
        """
        d1, twist, held = self.lengths[[0, 8, 9]].tolist()
        lean = (float(np.cos(0.5 * twist)), float(np.sin(0.5 * twist)), 0.0, 0.0)
        rolled = (float(np.cos(0.5 * held)), 0.0, float(np.sin(0.5 * held)), 0.0)
        return (
            ((0.0, 0.0, d1), STRAIGHT),
            ((self.a1, 0.0, 0.0), FORTH if twist == QUARTER else lean),
            (self._elbow, rolled),
            ((self.a3, self.d4, 0.0), BACK),
            ((0.0, 0.0, 0.0), FORTH),
            ((0.0, self.d6, 0.0), BACK),
        )

    @property
    def _elbow(self) -> Triple:
        """Origin of link 3 in link 2 [m]."""
        _, _, d2, a2, b2, _, _, _, _, held = self.lengths.tolist()
        c, s = (np.cos(held), np.sin(held)) if b2 else (1.0, 0.0)
        return float(b2 * c), a2, float(d2 - b2 * s)

    @property
    def link_distances(self) -> tuple[float, ...]:
        """Upper bounds of the distance of each link's origin from the limb's mount [m]."""
        d1, elbow = abs(self.d1), float(np.linalg.norm(self._elbow))
        shoulder = d1 + abs(self.a1)
        wrist = shoulder + elbow + float(np.hypot(self.a3, self.d4))
        base, flange = d1 if self.held_joint == 1 else 0.0, wrist + abs(self.d6)
        return base, d1, shoulder, shoulder + elbow, wrist, wrist, flange

    @property
    def anchors(self) -> dict[int, tuple[AnchorPlace, ...]]:
        """Anchors from which the motion of points of each link, 1 to 6, can be bounded."""
        here = (0.0, 0.0, 0.0)
        return {
            1: ((0, here),),
            2: ((0, here), (1, self._elbow)),
            3: ((1, here), (3, (self.a3, self.d4, 0.0))),
            4: ((3, here),),
            5: ((3, here),),
            6: ((3, (0.0, 0.0, -self.d6)),),
        }

    @property
    def side_offsets(self) -> tuple[float, float] | None:
        """None: no links keep clear of each other by lying side by side."""
        return None

    @property
    def link_capsules(self) -> tuple[Capsule, ...]:
        """Simple collision shapes along the links, without a gripper."""
        d4, d6 = self.d4, self.d6
        radius = THICKNESS * self.arm_length
        flange = max(min(0.6 * radius, 0.5 * abs(d6)), MIN_SIZE)
        here, tip = (0.0, 0.0, 0.0), -float(np.copysign(flange, d6))
        stands = (
            Capsule("base", here, (0.0, 0.0, 0.25 * self.d1), radius),
            Capsule("shoulder", (0.0, 0.0, -0.45 * self.d1), here, radius),
        )
        if self.held_joint == 1:
            # The mount is at d1 along y of the base, which ends where the upper arm is clear of it.
            stands = (
                Capsule("base", (0.0, self.d1, 0.0), (0.0, 2.5 * radius, 0.0), radius),
                Capsule("shoulder", here, here, radius),
            )
        return (
            *stands,
            Capsule("upper_arm", (0.0, 0.0, self.d2), self._elbow, radius),
            Capsule("forearm", here, (self.a3, 0.35 * d4, 0.0), radius),
            Capsule("wrist_1", (0.0, 0.0, -0.6 * d4), (0.0, 0.0, -0.35 * d4), radius),
            Capsule("wrist_2", here, (0.0, 0.25 * d6 or 0.1 * radius, 0.0), radius),
            Capsule("wrist_3", (0.0, 0.0, -0.5 * d6), (0.0, 0.0, tip), flange),
        )

    def farthest_flange(self, characteristic_length: float, w_m: float) -> float:
        """Return an upper bound of the flange's distance from the mount where `w_m` is met [m].

        `w_m` asks for `|sin f u| >= w_m l_c^3 / (U L |sin r|)`, and `|u| <= |a1| + D` with `D` the
        distance of the wrist point from axis 2. The largest bound is taken over cells of the elbow
        angle, in each with the best ends.
        """
        upper, fore = float(np.hypot(self.a2, self.b2)), float(np.hypot(self.a3, self.d4))
        angle = np.linspace(0.0, np.pi, CELLS + 1)
        square = upper**2 + fore**2 + 2.0 * upper * fore * np.cos(angle[:-1])
        distance = np.sqrt(np.maximum(square, 0.0))
        middle = (angle[:-1] <= 0.5 * np.pi) & (angle[1:] >= 0.5 * np.pi)
        sine = np.where(middle, 1.0, np.maximum(np.sin(angle[:-1]), np.sin(angle[1:])))
        upper_fore = upper * fore * abs(float(np.sin(self.lengths[8])))
        needed = w_m * characteristic_length**3 / (upper_fore * sine)
        possible = needed <= abs(self.a1) + distance
        if not possible.any():
            return 0.0
        wrist = abs(self.a1) + float(np.hypot(distance[possible].max(), self.d2))
        return abs(self.d1) + wrist + abs(self.d6)


SPHERICAL_WRIST_LIMB = Struct(
    SphericalWristLimb,
    {
        "family": Choice(FAMILIES[1:]),
        **dict.fromkeys(("d1", "a1", "d2", "a2", "b2", "a3", "d4", "d6"), LENGTH),
        "held_joint": OrNone(Integer(1, HELD_JOINT)),
        "held_angle": Tuples((), -FARTHEST_TURN, FARTHEST_TURN, "rad"),
        "joint_limits": Tuples((None, 2), -FARTHEST_TURN, FARTHEST_TURN, "rad", (6, 7)),
        "window_starts": Tuples((6,), -FARTHEST_TURN, FARTHEST_TURN, "rad"),
    },
)
"""Fields of a `SphericalWristLimb`."""
