"""A limb told by the frames of its joints, as a file has them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Annotated, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.kinematics.forms import THREE_PARALLEL, closed_form, frames_at
from mlivr_gym.robot.limb import (
    FARTHEST_TURN,
    FOLDS,
    WINDOW_STARTS,
    Angle,
    Limb,
    LimbBase,
    LinkOffset,
    SixAngles,
)
from mlivr_gym.robot.link_frames import turn_about_z
from mlivr_gym.robot.rigid import LinkQuaternion, axes_of
from mlivr_gym.schema import FieldPath, Integer, OrNone, Struct, Tuples
from mlivr_gym.values import MAX_ROBOT_LENGTH, Triple, as_triple

UNIT_LENGTH = 1e-6
"""How far a quaternion's length may be from 1."""

SAME_LINE = 1e-6
"""How far the first axis may be from the z axis of the base, and the last one from the flange's
[m], and the sine of the angle between."""

LEAST_SINE = 1e-3
"""Least sine of the angle between axes 5 and 6."""

LEAST_DETERMINANT = 1e-4
"""Least `|det J|` that an arm must have somewhere, as a share of its length cubed."""

MOST_FOLDS, TRIED = 3, 4096
"""Number of folds, and of postures among which they are chosen."""


class SeenAsUr(NamedTuple):
    """An arm with three parallel axes in the terms of those of UR."""

    limb: Limb
    """An arm of UR with its lengths."""
    sense: Array
    """1 or -1 for each joint: whether it turns as that of the arm, shape (6,)."""
    zero: Array
    """Joint angles at zero angles of the arm [rad], shape (6,)."""

    def of_arm(self, angles: Array) -> Array:
        """Return angles of the arm by those of the first joints of an arm of UR, (..., n)."""
        count = angles.shape[-1]
        found: Array = self.sense[:count] * (angles - self.zero[:count])
        return found


@dataclass(frozen=True)
class ChainLimb(LimbBase):
    """An arm of six joints that move, or of seven of which one is held, by the frames of its links.

    Each joint turns about the z axis of its link's frame, or against it. Names, signs and zeros of
    the joints are those of the file it comes from. A joint that is held moves neither while the
    limb holds nor while it swings; manipulability is that of the six others, a lower bound of that
    of all seven: `det(J J^T)` is the sum of the squares of the determinants of all choices of six
    columns (Cauchy-Binet).
    """

    origins: Annotated[
        tuple[Triple, ...], Tuples((None, 3), most=MAX_ROBOT_LENGTH, unit="m", rows=(6, 7))
    ]
    """Origin of each link's frame in that of the link before it, at joint angles of 0 [m]; the last
    one is the flange's."""
    quaternions: Annotated[
        tuple[LinkQuaternion, ...], Tuples((None, 4), most=1.0 + UNIT_LENGTH, rows=(6, 7))
    ]
    """Their orientations, quaternions w, x, y, z. The first axis is the z axis of the base, that of
    the flange is the last joint's and leads to the grasp."""
    joint_limits: Annotated[
        tuple[tuple[float, float], ...],
        Tuples((None, 2), -FARTHEST_TURN, FARTHEST_TURN, "rad", (6, 7)),
    ]
    """Lower and upper limit of each joint [rad], the held one among them."""
    axes: Annotated[tuple[float, ...], Tuples((None,), -1.0, 1.0, "", (6, 7))] = (1.0,) * 6
    """1 for each joint whose angle counts about the z axis of its link, -1 if against it."""
    window_starts: SixAngles = (-np.pi,) * 6
    """Where the turn begins in which each joint that moves stays while the limb holds [rad], see
    `windows`."""
    held_joint: Annotated[int | None, OrNone(Integer(1, 7))] = None
    """Number of the joint of a seven-joint arm that is held; None of six."""
    held_angle: Angle = 0.0
    """Angle at which it is held [rad]."""

    def __post_init__(self) -> None:
        """Check frames and limits."""
        place = FieldPath("limb", RobotError)
        CHAIN_LIMB.check(self, place)
        self.check_joints(place)
        count = len(self.joint_limits)
        for name in ("origins", "quaternions", "axes"):
            if len(getattr(self, name)) != count:
                raise place.field(name).fault(
                    f"has {len(getattr(self, name))} entries; the arm has {count} joints"
                )
        if set(self.axes) - {1.0, -1.0}:
            raise place.field("axes").fault(f"is {list(self.axes)}; each must be 1 or -1")
        for k, quaternion in enumerate(self.quaternions):
            size = float(np.linalg.norm(quaternion))
            if abs(size - 1.0) > UNIT_LENGTH:
                entry = place.field("quaternions").entry(k)
                raise entry.fault(f"is {list(quaternion)} of length {size:g}; it must be 1")
        self._check_axes(place)

    def _check_axes(self, place: FieldPath) -> None:
        """Refuse axes that no limb can have, by a `RobotError`."""
        first, last = self.steps[0], self.steps[5]
        if max(*np.abs(first[:2, 3]), *np.abs(first[:2, 2])) > SAME_LINE or first[2, 2] < 0.0:
            raise (
                place.field("origins")
                .entry(0)
                .fault(
                    "and its quaternion put joint 1 beside the z axis of the base, or against it"
                )
            )
        if float(np.hypot(*last[:2, 2])) < LEAST_SINE:
            raise place.field("quaternions").fault(
                "make the last two axes that move parallel; they must not be"
            )
        _, frames = _postures(self)
        joints, away = frames[:, 1:, :3, 2], frames[:, 6:, :3, 3] - frames[:, 1:, :3, 3]
        jacobians = np.concatenate([np.cross(joints, away), joints], axis=2)
        largest = float(np.abs(np.linalg.det(jacobians)).max())
        if largest < LEAST_DETERMINANT * self.arm_length**3:
            held = "" if self.held_joint is None else f" with joint {self.held_joint} held there"
            raise place.field("origins").fault(
                f"and quaternions make an arm that is singular in every posture{held}"
            )

    @cached_property
    def _whole(self) -> tuple[Array, Array]:
        """Base of the joints that move in the mount (4, 4), and their steps (6, 4, 4)."""
        steps, before = [], np.eye(4)
        for k, (origin, quaternion) in enumerate(
            zip(self.origins, self.quaternions, strict=True), 1
        ):
            step = np.eye(4)
            step[:3, 3], step[:3, :3] = origin, np.round(axes_of(quaternion), 15)
            before = before @ step
            if k == self.held_joint:
                before = before @ turn_about_z(self.axes[k - 1] * self.held_angle)
                continue
            steps.append(before)
            before = np.eye(4)
        if self.held_joint == len(self.origins):
            steps[-1] = steps[-1] @ before
        base = np.eye(4)
        if self.held_joint == 1:
            base, steps[0] = steps[0], np.eye(4)
        return base, np.array(steps)

    @property
    def steps(self) -> Array:
        """Frames of the six links, each in that of the link before, at angles of 0, (6, 4, 4)."""
        return self._whole[1]

    @property
    def senses(self) -> Array:
        """1 or -1 for each joint that moves, shape (6,): against the z axis of its link if -1."""
        return self.moving_angles(np.array(self.axes))

    @property
    def link_offsets(self) -> tuple[LinkOffset, ...]:
        """Frames of the six links, each in that of the link before it, at joint angles of 0."""
        if self.held_joint is None:
            return tuple(zip(self.origins, self.quaternions, strict=True))
        turns = Rotation.from_matrix(self.steps[:, :3, :3]).as_quat(scalar_first=True)
        origins = (as_triple(step[:3, 3]) for step in self.steps)
        return tuple(zip(origins, map(tuple, turns.tolist()), strict=True))

    @property
    def base_in_mount(self) -> tuple[Array, Array] | None:
        """Axes (3, 3) and origin [m] of the base of joint 2 in the mount, if joint 1 is held."""
        if self.held_joint != 1:
            return None
        base = self._whole[0]
        return base[:3, :3], base[:3, 3]

    @cached_property
    def as_ur(self) -> SeenAsUr | None:
        """The arm in the terms of those of UR; None if it has not three parallel axes."""
        found = closed_form(self.steps)
        if found is None or found[0].kind != THREE_PARALLEL:
            return None
        form, names = found[0], ("d1", "a2", "a3", "d4", "d5", "d6")
        d1, a2, a3, d4, d5, d6 = (round(form.figures[name], 9) + 0.0 for name in names)
        # The links of an arm of UR point against the x axes of their frames.
        upper, fore = np.pi * (a2 > 0.0), np.pi * (a3 > 0.0)
        halves = np.array([0.0, upper, fore - upper, -fore, 0.0, 0.0])
        limb = Limb(d1, -abs(a2), -abs(a3), d4, d5, d6)
        return SeenAsUr(limb, np.array(form.sign) * self.senses, np.array(form.zero) + halves)

    def with_usual_windows(self) -> ChainLimb:
        """Return the limb with windows that begin where those of UR arms do, or at half a turn.

        Of those a turn apart the ones are taken that lie closest to the middle of the limits.
        """
        turn, starts = 2.0 * np.pi, np.full(6, -np.pi)
        if self.as_ur is not None:
            starts = self.as_ur.of_arm(np.array(WINDOW_STARTS))
            starts = np.where(self.as_ur.sense < 0.0, starts - turn, starts)
        starts += turn * np.rint((self.limits.mean(axis=1) - starts - np.pi) / turn)
        return replace(self, window_starts=tuple(starts.tolist()))

    def with_flange_moved(self, shift: float) -> ChainLimb:
        """Return the limb with its flange farther out on the last axis [m]."""
        z = axes_of(self.quaternions[-1])[:, 2]
        moved = as_triple(np.array(self.origins[-1]) + shift * z)
        return replace(self, origins=(*self.origins[:-1], moved))

    @cached_property
    def arm_length(self) -> float:
        """Length of upper arm and forearm together [m].

        Without a closed form, the largest distance of the origins of links 2 and 5 in many
        postures.
        """
        found = closed_form(self.steps)
        if found is not None:
            figures = found[0].figures
            pair = ("upper", "forearm") if "upper" in figures else ("a2", "a3")
            return sum(abs(float(figures[name])) for name in pair)
        _, frames = _postures(self)
        farthest = np.linalg.norm(frames[:, 5, :3, 3] - frames[:, 2, :3, 3], axis=1).max()
        return max(round(float(farthest), 3), 1e-3)

    @cached_property
    def default_folds(self) -> tuple[tuple[float, ...], ...]:
        """Angles of joints 1 to 5 at which a free limb may stay folded [rad].

        Those of the arms of UR, or of many postures that stay on the outer side of the mount, those
        that reach least far.
        """
        if self.as_ur is not None:
            folds = self.as_ur.of_arm(np.array(FOLDS))
        else:
            angles, frames = _postures(self)
            origins = frames[:, 1:, :3, 3]
            outer = origins[..., 2].min(axis=1) >= 0.0
            size = np.where(outer, np.linalg.norm(origins, axis=2).max(axis=1), np.inf)
            folds = np.round(angles[np.argsort(size, kind="stable")[:MOST_FOLDS], :5], 3)
        return tuple(map(tuple, folds.tolist()))


@lru_cache(maxsize=8)
def _postures(limb: ChainLimb) -> tuple[Array, Array]:
    """Return joint angles (k, 6) [rad] all over the windows, and link frames (k, 7, 4, 4)."""
    low, high = limb.windows.T
    angles = np.random.default_rng(0).uniform(low, high, (TRIED, 6))
    return angles, frames_at(limb.steps, limb.senses, angles)


CHAIN_LIMB = Struct.of(ChainLimb)
"""Fields of a `ChainLimb`."""
