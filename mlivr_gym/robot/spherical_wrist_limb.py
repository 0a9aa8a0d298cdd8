"""A limb whose arm has a spherical wrist, of six joints or of seven of which one is held."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import Capsule
from mlivr_gym.robot.limb import (
    BACK,
    FAMILIES,
    FARTHEST_TURN,
    FORTH,
    STRAIGHT,
    Angle,
    Length,
    LimbBase,
    LinkOffset,
    SixAngles,
    share_of,
)
from mlivr_gym.robot.rigid import LinkQuaternion
from mlivr_gym.schema import Choice, FieldPath, Integer, OrNone, Struct, Tuples
from mlivr_gym.values import MIN_SIZE

HELD_JOINT = 3
"""The joint of a seven-joint arm that is held by default: the roll of the upper arm."""

HELD_JOINTS = (1, 2, 3, 5, 6)
"""Joints of a seven-joint arm of which one can be held."""

NOT_HELD = {
    4: "joint 4, the elbow, changes the distance of the wrist from the shoulder and no other does",
    7: "joint 7 turns the tool about its axis, by which a grasp may be half a turn further",
}
"""Why the others cannot."""

OFFSETS: dict[str, tuple[int | None, ...]] = {
    "a1": (None, 2), "d2": (None, 1, 3), "b2": HELD_JOINTS, "d3": HELD_JOINTS, "a6": (6,),
}  # fmt: skip
"""With which held joints an offset may be other than 0."""

QUARTER = 0.5 * np.pi
"""A quarter turn [rad]."""

SHIFTS = {None: (0.0,) * 6, 1: (0.0, QUARTER, QUARTER, 0.0, 0.0, 0.0),
          2: (-QUARTER, 0.0, QUARTER, 0.0, 0.0, 0.0), 3: (0.0,) * 6, 5: (0.0,) * 6,
          6: (0.0, 0.0, 0.0, QUARTER, 0.0, -QUARTER)}  # fmt: skip
"""By how much angles of the joints that move exceed those of the arm, by the held joint [rad].

Without one joint the six others have a closed form, see `kinematics.spherical_wrist` and
`kinematics.spherical_shoulder`, whose zero angles these are.
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

    One of `HELD_JOINTS` can be held. Angles of the six others are those of the arm plus `SHIFTS`.
    If it is joint 5 or 6, the shoulder must be spherical; with joint 6 held the wrist need not be,
    as that of a Franka is not. A joint that is held does not move while the limb holds or swings.
    Manipulability is that of the six joints that move, a lower bound of that of all seven:
    `det(J J^T)` is the sum of the squares of the determinants of all choices of six columns
    (Cauchy-Binet).

    Examples
    --------
    >>> SphericalWristLimb(held_angle=0.7).windows.shape
    (6, 2)
    """

    family: Annotated[str, Choice(FAMILIES[1:])] = FAMILIES[1]
    """`"spherical_wrist"`."""
    d1: Length = 0.36
    """Height of axis 2 over the base [m]."""
    a1: Length = 0.0
    """Distance of axis 2 from axis 1 [m]; of seven joints 0 unless joint 2 is held."""
    d2: Length = 0.0
    """Offset of the arm along axis 2 [m]; of seven joints 0 unless joint 1 or 3 is held."""
    a2: Length = 0.42
    """Upper arm, from axis 2 to the elbow axis [m]."""
    a3: Length = 0.0
    """Distance of the forearm's axis from the elbow axis [m]."""
    d4: Length = 0.4
    """Forearm, from the elbow to the wrist point [m]."""
    d6: Length = 0.126
    """From the wrist point to the flange [m]."""
    held_joint: Annotated[int | None, OrNone(Integer(1, 7))] = HELD_JOINT
    """Number of the joint of a seven-joint arm that is held, one of `HELD_JOINTS`; None of six."""
    held_angle: Angle = 0.0
    """Angle at which it is held [rad]."""
    joint_limits: Annotated[
        tuple[tuple[float, float], ...],
        Tuples((None, 2), -FARTHEST_TURN, FARTHEST_TURN, "rad", (6, 7)),
    ] = JOINT_LIMITS
    """Lower and upper limit of each joint [rad], the held one among them: seven or six pairs."""
    window_starts: SixAngles = WINDOW_STARTS
    """Where the turn begins in which each of the six joints stays while the limb holds [rad], see
    `windows`."""
    b2: Length = 0.0
    """Distance of the elbow axis from the line along the upper arm [m]; 0 of an arm of six
    joints."""
    d3: Length = 0.0
    """Offset of the arm along the elbow axis [m]; 0 of an arm of six joints."""
    a6: Length = 0.0
    """Distance of axis 7 from axis 6 [m]; 0 unless joint 6 is held."""

    def __post_init__(self) -> None:
        """Check lengths, limits and the held joint."""
        place = FieldPath("limb", RobotError)
        SPHERICAL_WRIST_LIMB.check(self, place)
        if self.held_joint not in (None, *HELD_JOINTS):
            raise place.field("held_joint").fault(
                f"is {self.held_joint}; it must be 1, 2, 3, 5 or 6: {NOT_HELD[self.held_joint]}"
            )
        if self.a2 < 0.0 or np.hypot(self.a2, self.b2) < MIN_SIZE:
            raise place.field("a2").fault(f"is {self.a2:g}; the upper arm must have a length")
        if np.hypot(self.a3, self.d4) < MIN_SIZE:
            raise place.field("d4").fault(f"is {self.d4:g}; the forearm must have a length")
        self.check_joints(place)
        if self.held_joint is None and self.held_angle != 0.0:
            raise place.field("held_angle").fault(
                f"is {self.held_angle:g}, but no joint is held; set held_joint to {HELD_JOINT}"
            )
        for name, joints in OFFSETS.items():
            if getattr(self, name) != 0.0 and self.held_joint not in joints:
                of = "of an arm of six joints"
                if self.held_joint is not None:
                    of = f"where joint {self.held_joint} is held"
                raise place.field(name).fault(f"is {getattr(self, name):g}; it must be 0 {of}")
        if self.held_joint in (2, 6) and abs(np.sin(self.held_angle)) < MIN_SIZE:
            raise place.field("held_angle").fault(
                f"is {self.held_angle:g} rad; with joint {self.held_joint} held there joints "
                f"{self.held_joint - 1} and {self.held_joint + 1} are in line"
            )

    @property
    def seen_from_flange(self) -> SphericalWristLimb | None:
        """The arm whose joints are these in opposite order, None unless joint 5 or 6 is held."""
        if self.held_joint not in (5, 6):
            return None
        return replace(
            self, d1=self.d6, a1=-self.a6, a2=self.d4, b2=-self.a3, a3=-self.b2, d4=self.a2,
            d6=self.d1, a6=0.0, held_joint=8 - self.held_joint,
            held_angle=self.held_angle,
            joint_limits=((-FARTHEST_TURN, FARTHEST_TURN),) * 7,
        )  # fmt: skip

    @property
    def form_lengths(self) -> Array:
        """Lengths d1, a1, d2, a2, b2, a3, d4, d6 [m] and two angles [rad], shape (10,).

        They are those of the form of the six joints that move, see `kinematics.spherical_wrist` and
        `kinematics.spherical_shoulder`.
        """
        opposite = self.seen_from_flange
        if opposite is not None:
            form = opposite.form_lengths
            form[[0, 7]] = form[[7, 0]]
            return form
        d1, twist, held, angle = self.d1, QUARTER, QUARTER, self.held_angle
        if self.held_joint == 1:
            arm = (self.d2, 0.0, self.d3, self.b2, -self.a2)
        elif self.held_joint == 2:
            # Axes 1 and 3 meet in a point, from which the form begins.
            along, twist = (self.a1 / np.sin(angle), angle) if self.a1 else (0.0, angle)
            arm = (d1 + along * np.cos(angle), 0.0, self.d3, self.b2, along - self.a2)
        elif self.held_joint == 3:
            c, s = (np.cos(angle), np.sin(angle)) if self.d2 else (0.0, 0.0)
            arm = (d1, 0.0, self.d3 + self.d2 * c, self.a2, self.b2 - self.d2 * s)
            held = angle
        else:
            arm, held = (d1, self.a1, self.d2, self.a2, self.b2), 0.0
        return np.array((*arm, self.a3, self.d4, self.d6, twist, held), dtype=np.float64)

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
    def arm_length(self) -> float:
        """Length of upper arm and forearm together [m]."""
        return float(np.hypot(self.a2, self.b2) + np.hypot(self.a3, self.d4))

    @property
    def default_folds(self) -> tuple[tuple[float, ...], ...]:
        """Angles of joints 1 to 5 that move at which a free limb may stay folded [rad]."""
        folds = np.delete(np.array(FOLDS), (self.held_joint or HELD_JOINT) - 1, axis=1)
        return tuple(map(tuple, folds[:, :5].tolist()))

    @property
    def link_offsets(self) -> tuple[LinkOffset, ...]:
        """Frames of the six links."""
        shifts = SHIFTS[self.held_joint]
        return tuple(
            (origin, _rolled(quaternion, shift)) if shift else (origin, quaternion)
            for (origin, quaternion), shift in zip(self.form_offsets, shifts, strict=True)
        )

    @property
    def form_offsets(self) -> tuple[LinkOffset, ...]:
        """Frames of the six links, where the closed form of those that move has its zeros."""
        d1, a1, d2, a2, b2, a3, d4, d6, twist, held = self.form_lengths.tolist()
        c, s = (float(np.cos(0.5 * twist)), float(np.sin(0.5 * twist)))
        lean, back = ((c, s, 0.0, 0.0), (c, -s, 0.0, 0.0)) if twist != QUARTER else (FORTH, BACK)
        rolled = (float(np.cos(0.5 * held)), 0.0, float(np.sin(0.5 * held)), 0.0)
        here, first = (0.0, 0.0, 0.0), ((0.0, 0.0, d1), STRAIGHT)
        if self.seen_from_flange is not None:
            # The steps of the form taken backwards, with y and z reversed.
            tip = (0.0, float(d6 * np.sin(twist)), float(d6 * np.cos(twist)))
            tip = (0.0, d6, 0.0) if twist == QUARTER else tip
            elbow, point = (-a3, 0.0, d4), (-b2, a2, d2)
            return (first, (here, FORTH), (here, BACK), (elbow, FORTH), (point, rolled),
                    (tip, back))  # fmt: skip
        c, s = (float(np.cos(held)), float(np.sin(held))) if held else (1.0, 0.0)
        elbow = (b2 * c + d2 * s if b2 or d2 else 0.0, a2, d2 * c - b2 * s)
        return (
            first, ((a1, 0.0, 0.0), lean), (elbow, rolled), ((a3, d4, 0.0), BACK), (here, FORTH),
            ((0.0, d6, 0.0), BACK),
        )  # fmt: skip

    @property
    def link_capsules(self) -> tuple[Capsule, ...]:
        """Simple collision shapes along the links, without a gripper."""
        places = [place for place, _ in self.form_offsets]
        form = self.form_lengths.tolist()
        d6, radius, here = form[7], THICKNESS * self.arm_length, (0.0, 0.0, 0.0)
        flange = max(min(0.6 * radius, 0.5 * abs(d6)), MIN_SIZE)
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
        tip = Capsule("wrist_3", (0.0, 0.0, -0.5 * d6),
                      (0.0, 0.0, -float(np.copysign(flange, d6))), flange)  # fmt: skip
        if self.seen_from_flange is not None:
            return (
                *stands,
                Capsule("forearm", (0.0, 0.0, 0.5 * places[3][2]), places[3], radius),
                Capsule("wrist_1", here, share_of(0.65, places[4]), radius),
                Capsule("wrist_2", here, share_of(0.25, places[5]), radius),
                tip,
            )
        # Wrist 1 begins where it is clear of the upper arm of a stretched limb.
        d4 = form[6]
        start = -d4 * max(0.35, (2.0 * radius + 0.008) / max(abs(d4), MIN_SIZE))
        return (
            *stands,
            Capsule("upper_arm", (0.0, 0.0, 0.0 if form[9] else form[2]), places[2], radius),
            Capsule("forearm", here, (form[5], 0.35 * d4, 0.0), radius),
            Capsule("wrist_1", (0.0, 0.0, -0.6 * d4), (0.0, 0.0, start), radius),
            Capsule("wrist_2", here, (0.0, 0.25 * d6 or 0.1 * radius, 0.0), radius),
            tip,
        )


def _rolled(quaternion: LinkQuaternion, angle: float) -> LinkQuaternion:
    """Return a quaternion turned about its own z axis [rad]."""
    w, x, y, z = quaternion
    c, s = float(np.cos(0.5 * angle)), float(np.sin(0.5 * angle))
    return w * c - z * s, x * c + y * s, y * c - x * s, w * s + z * c


SPHERICAL_WRIST_LIMB = Struct.of(SphericalWristLimb)
"""Fields of a `SphericalWristLimb`."""
