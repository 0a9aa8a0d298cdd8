"""The kinematics of a limb: lengths, joint limits, and the windows of its joints.

`Limb` is an arm of the UR family. `LimbBase` is what limbs of all families have; another family is
a class of its own, as `spherical_wrist_limb.SphericalWristLimb`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.file_joints import (
    FARTHEST_TURN,
    FileJoints,
    GivenJoints,
    LinkQuaternion,
    axes_of,
    rolled,
)
from mlivr_gym.schema import FieldPath, Struct, Tuples
from mlivr_gym.values import MAX_ROBOT_LENGTH, MIN_SIZE, Triple

FAMILIES = ("ur", "spherical_wrist")
"""Families of limbs by the names in robot files, in the order of their numbers in `kinematics.arm`.

They are not imported from there, since robots are described without a compiler.
"""

JOINT_LIMITS = (
    *((-2.0 * np.pi, 2.0 * np.pi),) * 2, (-np.pi, np.pi), *((-2.0 * np.pi, 2.0 * np.pi),) * 3,
)  # fmt: skip
"""Limits of the UR5e's joints [rad]; the manufacturer's description keeps the elbow to half a turn.
"""

WINDOW_STARTS = (
    -1.65, 1.75 - 2.0 * np.pi, -np.pi, 1.75 - 2.0 * np.pi, -np.pi, -0.75 * np.pi,
)  # fmt: skip
"""Where the windows of a UR limb begin [rad], see `Limb.windows`.

Joints 3 and 5 never pass half a turn while a limb holds, since the arm is singular there. Joints 1,
2 and 4 of limbs that hold points of the JEM pass 1.65 rad on 0.05 % of the steps only. Joint 6 may
be half a turn further, the flip: one of the two passes the ends of its window only where the tool
turns by half a turn and more.
"""


FOLDS = (
    (-0.6, np.pi, 2.4, 0.0, -0.75),
    (0.3, np.pi, 0.0, -1.6, 0.75),
    (2.19, -0.15, 1.83, 0.7, -0.38),
)
"""Joints 1 to 5 [rad] of a UR limb folded beside the body, on the side away from the surface.

Chosen from postures that keep clear of the body: each in turn adds most steps of the JEM over which
a limb can fold, stay folded and unfold.
"""

LinkOffset = tuple[tuple[float, float, float], LinkQuaternion]
"""Origin [m] and quaternion w, x, y, z of a link's frame in that of the link before it."""

AnchorPlace = tuple[int, tuple[float, float, float]]
"""An anchor, 0 limb base, 1 elbow, 2 forearm end, 3 wrist point, and where it lies on a link [m].
"""

Length = Annotated[float, Tuples((), most=MAX_ROBOT_LENGTH, unit="m")]
"""A length of a robot that may be negative, as in the DH convention [m]."""

Angle = Annotated[float, Tuples((), -FARTHEST_TURN, FARTHEST_TURN, "rad")]
"""An angle of a joint [rad]."""

SixAngles = Annotated[tuple[float, ...], Tuples((6,), -FARTHEST_TURN, FARTHEST_TURN, "rad")]
"""Angles of six joints [rad]."""

SixLimits = Annotated[
    tuple[tuple[float, float], ...], Tuples((6, 2), -FARTHEST_TURN, FARTHEST_TURN, "rad")
]
"""Lower and upper limits of six joints [rad]."""

HALF = float(np.sqrt(0.5))
STRAIGHT, FORTH, BACK = (1.0, 0.0, 0.0, 0.0), (HALF, HALF, 0.0, 0.0), (HALF, -HALF, 0.0, 0.0)
"""Quaternions of no turn, and of a quarter turn about x in either sense."""


def share_of(share: float, place: Triple) -> Triple:
    """Return a part of the way from the origin to a place."""
    x, y, z = place
    return share * x, share * y, share * z


class LimbBase(ABC):
    """Joint limits and windows of a limb of any family, of which six joints move.

    A seven-joint arm has one joint that is held at an angle: fields `held_joint`, its number from
    1, and `held_angle` [rad]. It moves neither while the limb holds nor while it swings.
    """

    joint_limits: tuple[tuple[float, float], ...]
    window_starts: tuple[float, ...]
    held_joint: int | None = None
    held_angle: float = 0.0
    joints: FileJoints | None = None

    @property
    @abstractmethod
    def family_code(self) -> int:
        """Number of the family, see `kinematics.arm`."""

    @property
    @abstractmethod
    def form_folds(self) -> tuple[tuple[float, ...], ...]:
        """Angles of joints 1 to 5 of the form at which a free limb may stay folded [rad]."""

    @property
    @abstractmethod
    def form_lengths(self) -> Array:
        """Lengths of the family [m]."""

    @property
    @abstractmethod
    def form_offsets(self) -> tuple[LinkOffset, ...]:
        """Frames of the six links, each in that of the link before it, where the form is at 0."""

    @property
    def link_offsets(self) -> tuple[LinkOffset, ...]:
        """Frames of the six links, each in that of the link before it, at joint angles of 0.

        Joints turn about the z axes, in the sense of `signs`; the last frame is the flange's.
        """
        if self.joints is not None and self.joints.origins is not None:
            return tuple(zip(self.joints.origins, self.joints.quaternions or (), strict=True))
        return tuple(
            (origin, rolled(quaternion, zero)) if zero else (origin, quaternion)
            for (origin, quaternion), zero in zip(
                self.form_offsets, self.zeros.tolist(), strict=True
            )
        )

    @property
    def signs(self) -> Array:
        """1 or -1 for each joint that moves, shape (6,): against the z axis of its link if -1.

        An angle of the form is `sign * angle + zero`.
        """
        if self.joints is None:
            return np.ones(6)
        return self.moving_angles(np.array(self.joints.signs, dtype=np.float64))

    @property
    def zeros(self) -> Array:
        """Angles of the form of the joints that move where their own are 0 [rad], shape (6,)."""
        if self.joints is None:
            return self.joint_shifts
        zeros: Array = self.moving_angles(np.array(self.joints.zeros)) + self.joint_shifts
        return zeros

    @property
    def form_held_angle(self) -> float:
        """Angle of the form at which the held joint is held [rad]."""
        if self.joints is None or self.held_joint is None:
            return self.held_angle
        k = self.held_joint - 1
        return float(self.joints.signs[k] * self.held_angle + self.joints.zeros[k])

    @property
    def steps(self) -> Array:
        """Frames of the six links, each in that of the link before, at angles of 0, (6, 4, 4)."""
        steps = np.tile(np.eye(4), (6, 1, 1))
        for step, (origin, quaternion) in zip(steps, self.link_offsets, strict=True):
            # What quarter turns leave of a sine is a rounding error.
            step[:3, 3], step[:3, :3] = origin, np.round(axes_of(quaternion), 15)
        return steps

    @property
    def lengths(self) -> Array:
        """Figures of the arm, see `kinematics.lengths.set_arm`, shape (n,)."""
        parts = [self.signs, self.zeros, self.form_lengths]
        if self.joints is not None and self.joints.origins is not None:
            turns = -self.zeros
            for (origin, quaternion), turn in zip(self.link_offsets, turns.tolist(), strict=True):
                parts.append(np.array([origin, *axes_of(rolled(quaternion, turn)).T]).ravel())
        return np.concatenate(parts)

    @property
    def default_folds(self) -> tuple[tuple[float, ...], ...]:
        """Angles of joints 1 to 5 at which a free limb may stay folded [rad]."""
        folds = (np.array(self.form_folds) - self.zeros[:5]) * self.signs[:5]
        return tuple(map(tuple, folds.tolist()))

    @property
    @abstractmethod
    def link_distances(self) -> tuple[float, ...]:
        """Upper bounds of the distance of each link's origin from the limb's mount [m]."""

    @property
    def reach(self) -> float:
        """An upper bound of the flange's distance from the mount [m]."""
        return self.link_distances[-1]

    @property
    def side_offsets(self) -> tuple[float, float] | None:
        """Offsets of the wrist point from the forearm and of the flange axis from wrist 1 [m].

        By these the links keep clear of each other; None if nothing keeps them clear.
        """
        return None

    @property
    def limits(self) -> Array:
        """Limits of the joints that move [rad], shape (6, 2)."""
        return self.moving_angles(np.array(self.joint_limits).T).T

    @property
    def failed_joint(self) -> int | None:
        """Number of the joint that is held because it is locked; None if none is.

        Its limits are one angle, that at which it is locked.
        """
        if self.held_joint is None:
            return None
        low, high = self.joint_limits[self.held_joint - 1]
        return self.held_joint if low == high else None

    @property
    def base_in_mount(self) -> tuple[Array, Array] | None:
        """Axes (3, 3) and origin [m] of the limb's base in its mount; None where they are one."""
        return None

    @property
    def joint_shifts(self) -> Array:
        """Angles of the form where those of the arm of the family are 0 [rad], shape (6,)."""
        return np.zeros(6)

    def moving_angles(self, angles: Array) -> Array:
        """Return angles of the joints that move from those of all joints of the arm [rad].

        The angles have shape (..., 7), or (..., 6) of an arm of six joints.
        """
        rows = np.asarray(angles, dtype=np.float64)
        if self.held_joint is not None:
            rows = np.delete(rows, self.held_joint - 1, axis=-1)
        return rows

    def all_angles(self, moving: Array) -> Array:
        """Return angles of all joints of the arm, the inverse of `moving_angles` [rad]."""
        rows: Array = np.asarray(moving, dtype=np.float64)
        if self.held_joint is None:
            return rows
        return np.insert(rows, self.held_joint - 1, self.held_angle, axis=-1)

    def check_joints(self, place: FieldPath) -> None:
        """Refuse limits in the wrong order or number, and a held angle outside them.

        Raises a `RobotError` that names the field and what would be valid.
        """
        joints = 6 if self.held_joint is None else 7
        if len(self.joint_limits) != joints:
            raise place.field("joint_limits").fault(
                f"has {len(self.joint_limits)} entries; an arm with held_joint "
                f"{self.held_joint} has {joints} joints"
            )
        for joint, (low, high) in enumerate(self.joint_limits):
            if not (low < high or (low == high and joint + 1 == self.held_joint)):
                limits = place.field("joint_limits").entry(joint)
                raise limits.fault(f"is {[low, high]}; the lower limit must come first")
        if self.joints is not None:
            self.joints.check(place.field("joints"), joints)
        if self.held_joint is None:
            return
        low, high = self.joint_limits[self.held_joint - 1]
        if not low <= self.held_angle <= high:
            raise place.field("held_angle").fault(
                f"is {self.held_angle:g} rad; joint {self.held_joint} turns from {low:g} to "
                f"{high:g} rad"
            )

    @property
    def windows(self) -> Array:
        """Least and largest angle of each joint of a limb that holds [rad], shape (6, 2).

        A window is one turn from `window_starts` on, moved into the joint limits as far as needed,
        and no more than they allow. Within it a posture has one winding: a limb never needs to turn
        back, so every walk of steps that are valid one by one can be carried out. A step on which a
        joint of a limb that holds would leave its window is no edge for the branch concerned.
        """
        low, high = self.limits.T
        start = np.clip(self.window_starts, low, np.maximum(low, high - 2.0 * np.pi))
        return np.stack([start, np.minimum(start + 2.0 * np.pi, high)], axis=1)

    def with_flange_moved(self, shift: float) -> Any:
        """Return the limb with its flange farther out on the last axis [m]."""
        limb: Any = self
        joints = None if self.joints is None else self.joints.with_flange_moved(shift)
        return replace(limb, d6=limb.d6 + shift, joints=joints)

    def folds_in_windows(self, folds: Sequence[Sequence[float]]) -> Array:
        """Those of some folds, joints 1 to 5 [rad], that lie in the windows, shape (k, 5)."""
        low, high = self.windows[:5].T
        angles = np.array(folds, dtype=np.float64).reshape(-1, 5)
        angles = low + np.mod(angles - low, 2.0 * np.pi)
        inside: Array = angles[(angles <= high).all(axis=1)]
        return inside


@dataclass(frozen=True)
class Limb(LimbBase):
    """A six-joint arm of the UR family, standard DH convention `Rz(theta) Tz(d) Tx(a) Rx(alpha)`.

    The default lengths [m] are the UR5e's, published by the manufacturer.

    Examples
    --------
    >>> Limb().form_lengths.tolist()
    [0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996]
    """

    d1: Length = 0.1625
    a2: Length = -0.425
    a3: Length = -0.3922
    d4: Length = 0.1333
    d5: Length = 0.0997
    d6: Length = 0.0996
    joint_limits: SixLimits = JOINT_LIMITS
    """Lower and upper limit of each joint [rad]."""
    window_starts: SixAngles = WINDOW_STARTS
    """Where the turn begins in which each joint stays while the limb holds [rad], see `windows`."""
    joints: GivenJoints = None
    """The joints of the file that the limb is read from; None for those of the form."""
    family_code, form_folds = FAMILIES.index("ur"), FOLDS

    def __post_init__(self) -> None:
        """Check lengths and limits."""
        place = FieldPath("limb", RobotError)
        LIMB.check(self, place)
        self.check_lengths(place)
        self.check_joints(place)

    def check_lengths(self, place: FieldPath) -> None:
        """Refuse lengths of 0 without which the form is another one, by a `RobotError`."""
        for name in ("a2", "a3", "d4"):
            if abs(getattr(self, name)) < MIN_SIZE:
                raise place.field(name).fault(f"is {getattr(self, name):g}; it must not be 0")

    @property
    def form_lengths(self) -> Array:
        """The six lengths d1, a2, a3, d4, d5, d6 [m], shape (6,)."""
        return np.array([self.d1, self.a2, self.a3, self.d4, self.d5, self.d6], dtype=np.float64)

    @property
    def reach(self) -> float:
        """An upper bound of the flange's distance from the mount [m]."""
        return float(np.abs(self.form_lengths).sum())

    @property
    def arm_length(self) -> float:
        """Length of upper arm and forearm together [m]."""
        return abs(self.a2) + abs(self.a3)

    @property
    def form_offsets(self) -> tuple[LinkOffset, ...]:
        """Frames of the six links."""
        return (
            ((0.0, 0.0, self.d1), STRAIGHT), ((0.0, 0.0, 0.0), FORTH),
            ((self.a2, 0.0, 0.0), STRAIGHT), ((self.a3, 0.0, self.d4), STRAIGHT),
            ((0.0, -self.d5, 0.0), FORTH), ((0.0, self.d6, 0.0), BACK),
        )  # fmt: skip

    @property
    def link_distances(self) -> tuple[float, ...]:
        """Upper bounds of the distance of each link's origin from the limb's base [m]."""
        d1, a2, a3, d4, d5, d6 = np.abs(self.form_lengths).tolist()
        return tuple(np.cumsum([0.0, d1, 0.0, a2, a3 + d4, d5, d6]).tolist())

    @property
    def anchors(self) -> dict[int, tuple[AnchorPlace, ...]]:
        """Anchors from which the motion of points of each link, 1 to 6, can be bounded."""
        here = (0.0, 0.0, 0.0)
        return {
            1: ((0, here),),
            2: ((0, here), (1, (self.a2, 0.0, 0.0))),
            3: ((1, here), (2, (self.a3, 0.0, 0.0))),
            4: ((2, (0.0, 0.0, -self.d4)), (3, (0.0, -self.d5, 0.0))),
            5: ((3, here),),
            6: ((3, (0.0, 0.0, -self.d6)),),
        }

    @property
    def side_offsets(self) -> tuple[float, float]:
        """Offsets d4 of the wrist point from the forearm and d5 of the flange axis from wrist 1."""
        return self.d4, self.d5


LIMB = Struct.of(Limb)
"""Fields of a `Limb`."""
