"""A limb of any six joints, whose inverse kinematics has no closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.file_joints import UNIT_LENGTH, GivenJoints, LinkQuaternion, axes_of
from mlivr_gym.robot.limb import (
    STRAIGHT,
    AnchorPlace,
    LimbBase,
    LinkOffset,
    SixAngles,
    SixLimits,
    share_of,
)
from mlivr_gym.robot.link_frames import link_frames
from mlivr_gym.schema import Choice, FieldPath, Struct, Tuples
from mlivr_gym.values import MAX_ROBOT_LENGTH, MIN_SIZE, Triple

NUMERIC = "numeric"
"""Name of the family in robot files."""

WINDOW_STARTS = (-np.pi,) * 6
"""Where the windows of the joints begin [rad], see `LimbBase.windows`."""

LEAST_SINE = 1e-3
"""Least sine of the angle between axes 5 and 6."""

LEAST_DETERMINANT = 1e-4
"""Least `|det J|` that an arm must have somewhere, as a share of its length cubed."""

FOLDS, TRIED = 3, 4096
"""Number of folds, and of postures among which they are chosen."""

THICKNESS, GAP = 0.06, 0.03
"""Radius of the default collision shapes as a share of the length of the arm, and how far those of
a link and the next but one are apart where the link between is straight [m]."""


@dataclass(frozen=True)
class NumericLimb(LimbBase):
    """An arm of six joints that is solved numerically, see `kinematics.numeric`.

    Each joint turns about the z axis of its link's frame. A pose takes longer than with a closed
    form, and so does the first plan on a map: prefer another family where one fits.
    """

    origins: Annotated[tuple[Triple, ...], Tuples((6, 3), most=MAX_ROBOT_LENGTH, unit="m")]
    """Origin of each link's frame in that of the link before it, at joint angles of 0 [m]: of the
    links 1 to 5, then of the flange. That of link 1 lies on the z axis of the base."""
    quaternions: Annotated[tuple[LinkQuaternion, ...], Tuples((6, 4), most=1.0 + UNIT_LENGTH)]
    """Their orientations, quaternions w, x, y, z; that of link 1 is (1, 0, 0, 0). The z axis of the
    flange is that of joint 6 and leads to the grasp."""
    joint_limits: SixLimits
    """Lower and upper limit of each joint [rad]."""
    window_starts: SixAngles = WINDOW_STARTS
    """Where the turn begins in which each joint stays while the limb holds [rad], see `windows`."""
    family: Annotated[str, Choice((NUMERIC,))] = NUMERIC
    """`"numeric"`."""
    joints: GivenJoints = None
    """The joints of the file that the limb is read from; None for those of the form."""
    family_code = 3

    def __post_init__(self) -> None:
        """Check frames and limits."""
        place = FieldPath("limb", RobotError)
        NUMERIC_LIMB.check(self, place)
        self.check_joints(place)
        for k, quaternion in enumerate(self.quaternions):
            size = float(np.linalg.norm(quaternion))
            if abs(size - 1.0) > UNIT_LENGTH:
                entry = place.field("quaternions").entry(k)
                raise entry.fault(f"is {list(quaternion)} of length {size:g}; it must be 1")
        x, y, _ = self.origins[0]
        if max(abs(x), abs(y)) > MIN_SIZE:
            entry = place.field("origins").entry(0)
            raise entry.fault(f"is {list(self.origins[0])}; x and y must be 0, on axis 1")
        if not np.allclose(self.quaternions[0], STRAIGHT):
            entry = place.field("quaternions").entry(0)
            raise entry.fault(f"is {list(self.quaternions[0])}; it must be {list(STRAIGHT)}")
        if float(np.hypot(*axes_of(self.quaternions[5])[:2, 2])) < LEAST_SINE:
            entry = place.field("quaternions").entry(5)
            raise entry.fault("makes axes 5 and 6 parallel; they must not be")
        if self._largest_determinant < LEAST_DETERMINANT * self.arm_length**3:
            raise place.field("origins").fault(
                "and quaternions make an arm that is singular in every posture"
            )

    @property
    def _largest_determinant(self) -> float:
        """The largest `|det J|` of many postures [m^3]."""
        _, frames = _postures(self)
        axes, away = frames[:, 1:, :3, 2], frames[:, 6:, :3, 3] - frames[:, 1:, :3, 3]
        return float(np.abs(np.linalg.det(np.concatenate([np.cross(axes, away), axes], 2))).max())

    @property
    def wrist(self) -> Triple:
        """The point of axis 6 nearest to axis 5, in the frame of link 5 [m]."""
        *_, (origin, quaternion) = self.form_offsets
        z = axes_of(quaternion)[:, 2]
        across = np.array([z[0], z[1], 0.0])
        share = -float(np.array(origin) @ across) / float(across @ across)
        x, y, height = (np.array(origin) + share * z).tolist()
        return x, y, height

    @property
    def d1(self) -> float:
        """Height of the origin of link 2 over the base [m]."""
        return self.origins[0][2] + self.origins[1][2]

    @property
    def d6(self) -> float:
        """From the wrist point to the flange along axis 6 [m]."""
        *_, (origin, quaternion) = self.form_offsets
        return float((np.array(origin) - self.wrist) @ axes_of(quaternion)[:, 2])

    def with_flange_moved(self, shift: float) -> NumericLimb:
        """Return the limb with its flange farther out on the last axis [m]."""
        *others, (origin, quaternion) = self.form_offsets
        x, y, z = (np.array(origin) + shift * axes_of(quaternion)[:, 2]).tolist()
        return replace(self, origins=(*(place for place, _ in others), (x, y, z)))

    @property
    def form_lengths(self) -> Array:
        """Origins [m] and axes of the links' frames, `kinematics.arm.NumericArm.steps`, (72,)."""
        steps = [[origin, *axes_of(quaternion).T] for origin, quaternion in self.form_offsets]
        return np.array([np.stack(step) for step in steps]).reshape(-1)

    @property
    def form_offsets(self) -> tuple[LinkOffset, ...]:
        """Frames of the six links."""
        return tuple(zip(self.origins, self.quaternions, strict=True))

    @property
    def link_distances(self) -> tuple[float, ...]:
        """Upper bounds of the distance of each link's origin from the limb's mount [m]."""
        steps = np.linalg.norm(self.origins, axis=1)
        return (0.0, *np.cumsum(steps).tolist())

    @property
    def arm_length(self) -> float:
        """Largest distance of the origins of links 2 and 5 in many postures [m].

        It is rounded to a millimetre.
        """
        _, frames = _postures(self)
        farthest = np.linalg.norm(frames[:, 5, :3, 3] - frames[:, 2, :3, 3], axis=1).max()
        return max(round(float(farthest), 3), 1e-3)

    @property
    def form_folds(self) -> tuple[tuple[float, ...], ...]:
        """Angles of joints 1 to 5 of the form at which a free limb may stay folded [rad].

        Of many postures that stay on the outer side of the mount, those that reach least far.
        """
        angles, frames = _postures(self)
        origins = frames[:, 1:, :3, 3]
        outer = origins[..., 2].min(axis=1) >= 0.0
        size = np.where(outer, np.linalg.norm(origins, axis=2).max(axis=1), np.inf)
        chosen = np.argsort(size, kind="stable")[:FOLDS]
        folds = self.signs[:5] * np.round(angles[chosen, :5], 3) + self.zeros[:5]
        return tuple(map(tuple, folds.tolist()))

    @property
    def anchors(self) -> dict[int, tuple[AnchorPlace, ...]]:
        """Anchors from which the motion of points of each link, 1 to 6, can be bounded.

        They are the origins of the links 2, 3 and 4, and the wrist point.
        """
        here, places = (0.0, 0.0, 0.0), self.origins
        return {
            1: ((0, places[1]),),
            2: ((0, here), (1, places[2])),
            3: ((1, here), (2, places[3])),
            4: ((2, here),),
            5: ((3, self.wrist),),
            6: ((3, (0.0, 0.0, -self.d6)),),
        }

    @property
    def link_capsules(self) -> tuple[Capsule, ...]:
        """Simple collision shapes along the links, without a gripper.

        Each begins where it is clear of the end of the link before the last one, and that of link 4
        ends where it is clear of the flange; a link that is too short for that has none.
        """
        radius, here, d6 = THICKNESS * self.arm_length, (0.0, 0.0, 0.0), self.d6
        x, y, z = self.origins[0]
        out = [Capsule("base", here, (x, y, 0.25 * z), radius)]
        apart, before = 2.0 * radius + GAP, np.inf
        for link, place in zip(LINKS[1:5], self.origins[1:5], strict=True):
            size = max(float(np.linalg.norm(place)), MIN_SIZE)
            start = 0.0 if before > apart else apart
            stop = size - apart if link == "wrist_1" else size
            if start < stop or link == "upper_arm":
                first, last = (share_of(min(at / size, 1.0), place) for at in (start, stop))
                out.append(Capsule(link, first, last, radius))
            before = size
        slim = max(min(0.6 * radius, 0.5 * abs(d6)), MIN_SIZE)
        end = -float(np.copysign(slim, d6))
        return (*out, Capsule("wrist_3", (0.0, 0.0, -0.5 * d6), (0.0, 0.0, end), slim))


@lru_cache(maxsize=8)
def _postures(limb: NumericLimb) -> tuple[Array, Array]:
    """Return joint angles (k, 6) [rad] all over the windows, and link frames (k, 7, 4, 4)."""
    low, high = limb.windows.T
    angles = np.random.default_rng(0).uniform(low, high, (TRIED, 6))
    return angles, link_frames(limb, angles)


NUMERIC_LIMB = Struct.of(NumericLimb)
"""Fields of a `NumericLimb`."""
