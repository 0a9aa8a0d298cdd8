"""The kinematics of a limb: links, joint limits, and the windows of its joints.

`LimbBase` is what all limbs have; `Limb` is told by the lengths of an arm of UR, and
`chain_limb.ChainLimb` by the frames of its links.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.kinematics.forms import frames_at
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.rigid import LinkQuaternion, axes_of
from mlivr_gym.schema import FieldPath, Struct, Tuples
from mlivr_gym.values import MAX_ROBOT_LENGTH, MIN_SIZE, Triple, as_triple

FARTHEST_TURN = 100.0
"""Largest joint limit or angle [rad], 16 turns; a UR joint has one in each direction."""

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


THICKNESS, GAP = 0.06, 0.03
"""Radius of the default collision shapes as a share of the length of the arm, and how far those of
a link and the next but one are apart where the link between is straight [m]."""


class LimbBase(ABC):
    """Joint limits and windows of a limb, of which six joints move.

    A seven-joint arm has one joint that is held at an angle: fields `held_joint`, its number from
    1, and `held_angle` [rad]. It moves neither while the limb holds nor while it swings.
    """

    joint_limits: tuple[tuple[float, float], ...]
    window_starts: tuple[float, ...]
    held_joint: int | None = None
    held_angle: float = 0.0

    @property
    @abstractmethod
    def default_folds(self) -> tuple[tuple[float, ...], ...]:
        """Angles of joints 1 to 5 at which a free limb may stay folded [rad]."""

    @property
    @abstractmethod
    def link_offsets(self) -> tuple[LinkOffset, ...]:
        """Frames of the six links, each in that of the link before it, at joint angles of 0.

        Joints turn about the z axes, in the sense of `senses`; the last frame is the flange's.
        """

    @property
    def senses(self) -> Array:
        """1 or -1 for each joint that moves, shape (6,): against the z axis of its link if -1."""
        return np.ones(6)

    @property
    def steps(self) -> Array:
        """Frames of the six links, each in that of the link before, at angles of 0, (6, 4, 4)."""
        steps = np.tile(np.eye(4), (6, 1, 1))
        for step, (origin, quaternion) in zip(steps, self.link_offsets, strict=True):
            # What quarter turns leave of a sine is a rounding error.
            step[:3, 3], step[:3, :3] = origin, np.round(axes_of(quaternion), 15)
        return steps

    @property
    @abstractmethod
    def arm_length(self) -> float:
        """Length of upper arm and forearm together [m]."""

    @property
    def frames_at_zero(self) -> Array:
        """Frames of base and links in the base at joint angles of 0, shape (7, 4, 4)."""
        return frames_at(self.steps, self.senses, np.zeros(6))

    @property
    def link_distances(self) -> tuple[float, ...]:
        """Upper bounds of the distance of each link's origin from the limb's mount [m]."""
        base = 0.0 if self.base_in_mount is None else float(np.linalg.norm(self.base_in_mount[1]))
        sizes = np.linalg.norm(self.steps[:, :3, 3], axis=1)
        return (base, *(base + np.cumsum(sizes)).tolist())

    @property
    def reach(self) -> float:
        """An upper bound of the flange's distance from the mount [m]."""
        return self.link_distances[-1]

    @property
    def shoulder_height(self) -> float:
        """Height of the shoulder over the base, where axis 2 comes closest to axis 1 [m]."""
        first, second = self.frames_at_zero[1:3]
        across = np.cross(second[:3, 2], np.cross(first[:3, 2], second[:3, 2]))
        share = float(first[:3, 2] @ across)
        if share < MIN_SIZE:
            return float(second[2, 3])
        apart = second[:3, 3] - first[:3, 3]
        return float(first[2, 3] + (apart @ across) / share)

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
    def past_wrist(self) -> float:
        """From the point of the last axis closest to the one before, along it to the flange [m]."""
        z, origin = self.steps[5, :3, 2], self.steps[5, :3, 3]
        across = np.array([z[0], z[1], 0.0])
        return float(origin @ across / (across @ across))

    @property
    def link_capsules(self) -> tuple[Capsule, ...]:
        """Simple collision shapes along the links, without a gripper.

        Each begins where it is clear of the end of the link before the last one, and the last one
        before the wrist ends where it is clear of the flange; a link that is too short for that has
        none.
        """
        radius, here, d6 = THICKNESS * self.arm_length, (0.0, 0.0, 0.0), self.past_wrist
        places = [as_triple(step[:3, 3]) for step in self.steps]
        sizes = [max(float(np.linalg.norm(place)), MIN_SIZE) for place in places]
        x, y, z = places[0]
        out = [Capsule("base", here, (x, y, 0.25 * z), radius)]
        apart, before = 2.0 * radius + GAP, np.inf
        fore = max((k for k in range(1, 5) if sizes[k] > radius), default=4)
        for k in range(1, 5):
            start = 0.0 if before > apart else apart
            stop = sizes[k] - apart if k == fore else sizes[k]
            if (sizes[k] > radius and start < stop) or LINKS[k] == "upper_arm":
                first, last = (share_of(min(at / sizes[k], 1.0), places[k]) for at in (start, stop))
                out.append(Capsule(LINKS[k], first, last, radius))
            before = sizes[k]
        slim = max(min(0.6 * radius, 0.5 * abs(d6)), MIN_SIZE)
        end = -float(np.copysign(slim, d6))
        return (*out, Capsule("wrist_3", (0.0, 0.0, -0.5 * d6), (0.0, 0.0, end), slim))

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
        return replace(limb, d6=limb.d6 + shift)

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
    >>> Limb().lengths.tolist()
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
    default_folds = FOLDS

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
    def lengths(self) -> Array:
        """The six lengths d1, a2, a3, d4, d5, d6 [m], shape (6,)."""
        return np.array([self.d1, self.a2, self.a3, self.d4, self.d5, self.d6], dtype=np.float64)

    @property
    def arm_length(self) -> float:
        """Length of upper arm and forearm together [m]."""
        return abs(self.a2) + abs(self.a3)

    @property
    def link_offsets(self) -> tuple[LinkOffset, ...]:
        """Frames of the six links."""
        return (
            ((0.0, 0.0, self.d1), STRAIGHT), ((0.0, 0.0, 0.0), FORTH),
            ((self.a2, 0.0, 0.0), STRAIGHT), ((self.a3, 0.0, self.d4), STRAIGHT),
            ((0.0, -self.d5, 0.0), FORTH), ((0.0, self.d6, 0.0), BACK),
        )  # fmt: skip


LIMB = Struct.of(Limb)
"""Fields of a `Limb`."""
