"""The kinematics of a limb: the frames of its links, joint limits, and windows of its joints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Annotated, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.kinematics.forms import THREE_PARALLEL, closed_form, foot, frames_at
from mlivr_gym.robot.dh_table import frames_of_dh, ur_dh
from mlivr_gym.robot.rigid import axes_of, rigid, turn_about_z
from mlivr_gym.robot.validators import FARTHEST_TURN, SIX_ANGLES
from mlivr_gym.schema import FieldPath, Integer, OrNone, Struct, Tuples
from mlivr_gym.values import MAX_ROBOT_LENGTH, Triple

JOINT_LIMITS = (
    *((-2.0 * np.pi, 2.0 * np.pi),) * 2, (-np.pi, np.pi), *((-2.0 * np.pi, 2.0 * np.pi),) * 3,
)  # fmt: skip
"""Limits of the UR5e's joints [rad]; the maker's description keeps the elbow to half a turn."""

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

Angle = Annotated[float, Tuples((), -FARTHEST_TURN, FARTHEST_TURN, "rad")]
"""An angle of a joint [rad]."""

UNIT_LENGTH = 1e-6
"""How far a quaternion's length may be from 1."""

SAME_LINE = 1e-6
"""Largest distance [m] of the first axis from the z axis of the base, and sine of their angle."""

LEAST_SINE = 1e-3
"""Least sine of the angle between axes 5 and 6."""

LEAST_DETERMINANT = 1e-4
"""Least `|det J|` that an arm must have somewhere, as a share of its length cubed."""

MOST_FOLDS, TRIED = 3, 4096
"""Number of folds, and of postures among which they are chosen."""


ORIGINS, QUATERNIONS = frames_of_dh(ur_dh())
"""Frames of the links of the UR5e."""


@dataclass(frozen=True)
class Limb:
    """An arm of six joints, or of seven of which one is locked, by the frames of its links.

    Each joint turns about the z axis of its link's frame, or against it. Names, signs and zeros of
    the joints are those of the file it comes from. A joint that is locked moves neither while the
    limb holds nor while it swings; manipulability is that of the six others, a lower bound of that
    of all seven: `det(J J^T)` is the sum of the squares of the determinants of all choices of six
    columns (Cauchy-Binet). By default it is a UR5e by its maker's DH table.

    Examples
    --------
    >>> Limb().origins[0], round(Limb().arm_length, 4)
    ((0.0, 0.0, 0.1625), 0.8172)
    """

    origins: Annotated[
        tuple[Triple, ...], Tuples((None, 3), most=MAX_ROBOT_LENGTH, unit="m", rows=(6, 7))
    ] = ORIGINS
    """Origin of each link's frame in that of the link before it, at joint angles of 0 [m]; the last
    one is the flange's."""
    quaternions: Annotated[
        tuple[tuple[float, float, float, float], ...],
        Tuples((None, 4), most=1.0 + UNIT_LENGTH, rows=(6, 7)),
    ] = QUATERNIONS
    """Their orientations, quaternions w, x, y, z. The first axis is the z axis of the base, that of
    the flange is the last joint's and leads to the grasp."""
    joint_limits: Annotated[
        tuple[tuple[float, float], ...],
        Tuples((None, 2), -FARTHEST_TURN, FARTHEST_TURN, "rad", (6, 7)),
    ] = JOINT_LIMITS
    """Lower and upper limit of each joint [rad], the locked one among them."""
    axes: Annotated[tuple[float, ...] | None, OrNone(Tuples((None,), -1.0, 1.0, "", (6, 7)))] = None
    """1 for each joint whose angle counts about the z axis of its link, -1 if against it; None for
    1 each."""
    window_starts: Annotated[tuple[float, ...] | None, OrNone(SIX_ANGLES)] = None
    """Where the turn begins in which each joint that moves stays while the limb holds [rad], see
    `windows`; None for where those of UR arms do, or at half a turn."""
    locked_joint: Annotated[int | None, OrNone(Integer(1, 7))] = None
    """Number of the joint of a seven-joint arm that is locked; None of six."""
    locked_angle: Angle = 0.0
    """Angle at which it is locked [rad]."""

    def __post_init__(self) -> None:
        """Check frames and limits."""
        place = FieldPath("limb", RobotError)
        LIMB.check(self, place)
        count = 6 if self.locked_joint is None else 7
        for name in ("joint_limits", "origins", "quaternions", "axes"):
            found = getattr(self, name)
            if found is not None and len(found) != count:
                raise place.field(name).fault(
                    f"has {len(found)} entries; an arm with locked_joint {self.locked_joint} has "
                    f"{count} joints"
                )
        if set(self.axes or ()) - {1.0, -1.0}:
            raise place.field("axes").fault(f"is {list(self.axes or ())}; each must be 1 or -1")
        for k, quaternion in enumerate(self.quaternions):
            size = float(np.linalg.norm(quaternion))
            if abs(size - 1.0) > UNIT_LENGTH:
                entry = place.field("quaternions").entry(k)
                raise entry.fault(f"is {list(quaternion)} of length {size:g}; it must be 1")
        self._check_limits(place)
        self._check_axes(place)

    def _check_limits(self, place: FieldPath) -> None:
        for joint, (low, high) in enumerate(self.joint_limits):
            if not (low < high or (low == high and joint + 1 == self.locked_joint)):
                limits = place.field("joint_limits").entry(joint)
                raise limits.fault(f"is {[low, high]}; the lower limit must come first")
        if self.locked_joint is None:
            return
        low, high = self.joint_limits[self.locked_joint - 1]
        if not low <= self.locked_angle <= high:
            raise place.field("locked_angle").fault(
                f"is {self.locked_angle:g} rad; joint {self.locked_joint} turns from {low:g} to "
                f"{high:g} rad"
            )

    def _check_axes(self, place: FieldPath) -> None:
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
            joint = self.locked_joint
            told = "" if joint is None else f" with joint {joint} locked there"
            raise place.field("origins").fault(
                f"and quaternions make an arm that is singular in every posture{told}"
            )

    @cached_property
    def _whole(self) -> tuple[Array, Array]:
        """Base of the joints that move in the mount (4, 4), and their steps (6, 4, 4)."""
        axes, locked = self.axes or (1.0,) * len(self.origins), self.locked_joint
        # What quarter turns leave of a sine is a rounding error; nothing is -0.
        steps = [
            rigid(np.round(axes_of(quaternion), 15), origin) + 0.0
            for origin, quaternion in zip(self.origins, self.quaternions, strict=True)
        ]
        if locked is not None:
            step = steps.pop(locked - 1) @ turn_about_z(axes[locked - 1] * self.locked_angle)
            if locked < len(self.origins):
                steps[locked - 1] = step @ steps[locked - 1]
            else:
                steps[-1] = steps[-1] @ step
        base = np.eye(4)
        if locked == 1:
            base, steps[0] = steps[0], np.eye(4)
        return base, np.array(steps)

    @property
    def steps(self) -> Array:
        """Frames of the six links, each in that of the link before, at angles of 0, (6, 4, 4).

        Joints turn about the z axes, in the sense of `senses`; the last frame is the flange's.
        """
        return self._whole[1]

    @property
    def base_in_mount(self) -> Array:
        """Base of the first joint that moves in the mount, (4, 4); another if 1 is locked."""
        return self._whole[0]

    @property
    def senses(self) -> Array:
        """1 or -1 for each joint that moves, shape (6,): against the z axis of its link if -1."""
        return self.moving_angles(np.array(self.axes or (1.0,) * len(self.origins)))

    @cached_property
    def link_distances(self) -> tuple[float, ...]:
        """Upper bounds of the distance of each link's origin from the limb's mount [m]."""
        base = float(np.linalg.norm(self.base_in_mount[:3, 3]))
        sizes = np.linalg.norm(self.steps[:, :3, 3], axis=1)
        return (base, *(base + np.cumsum(sizes)).tolist())

    @property
    def reach(self) -> float:
        """An upper bound of the flange's distance from the mount [m]."""
        return self.link_distances[-1]

    @property
    def shoulder_height(self) -> float:
        """Height of the shoulder over the base, where axis 1 comes closest to axis 2 [m]."""
        frames = link_frames(self, np.zeros(6))[1:]
        return float(foot(frames[:, :3, 2], frames[:, :3, 3], 0, 1)[2])

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

    @property
    def limits(self) -> Array:
        """Limits of the joints that move [rad], shape (6, 2)."""
        return self.moving_angles(np.array(self.joint_limits).T).T

    @cached_property
    def windows(self) -> Array:
        """Least and largest angle of each joint of a limb that holds [rad], shape (6, 2).

        A window is one turn from `window_starts` on, moved into the joint limits as far as needed,
        and no more than they allow. Within it a posture has one winding: a limb never needs to turn
        back, so every walk of steps that are valid one by one can be carried out. A step on which a
        joint of a limb that holds would leave its window is no edge for the branch concerned.
        """
        turn, (low, high) = 2.0 * np.pi, self.limits.T
        if self.window_starts is not None:
            start = np.array(self.window_starts)
        else:
            # Of those a turn apart the one closest to the middle of the limits.
            starts, ends = (self._as_ur(np.add(WINDOW_STARTS, more)) for more in (0.0, turn))
            start = np.full(6, -np.pi)
            if starts is not None and ends is not None:
                start = np.minimum(starts, ends)
            start = start + turn * np.rint((0.5 * (low + high) - start - np.pi) / turn)
        start = np.clip(start, low, np.maximum(low, high - turn))
        return np.stack([start, np.minimum(start + turn, high)], axis=1)

    @cached_property
    def default_folds(self) -> tuple[tuple[float, ...], ...]:
        """Joints 1 to 5 of a free limb that stays folded [rad], as those of UR or by least reach.

        These are of many postures that stay on the outer side of the mount.
        """
        folds = self._as_ur(FOLDS)
        if folds is None:
            angles, frames = _postures(self)
            origins = frames[:, 1:, :3, 3]
            outer = origins[..., 2].min(axis=1) >= 0.0
            size = np.where(outer, np.linalg.norm(origins, axis=2).max(axis=1), np.inf)
            folds = np.round(angles[np.argsort(size, kind="stable")[:MOST_FOLDS], :5], 3)
        return tuple(map(tuple, folds.tolist()))

    def _as_ur(self, angles: Any) -> Array | None:
        """Return angles of the arm by those of the first joints of an arm of UR, shape (..., n).

        None if it has not three parallel axes as those have.
        """
        found = closed_form(self.steps)
        if found is None or found[0].kind != THREE_PARALLEL:
            return None
        form = found[0]
        # The links of an arm of UR point against the x axes of their frames.
        upper, fore = (np.pi * (form.figures[name] > 0.0) for name in ("a2", "a3"))
        zero = np.add(form.zero, (0.0, upper, fore - upper, -fore, 0.0, 0.0))
        zero -= 2.0 * np.pi * np.rint(zero / (2.0 * np.pi))
        count = np.shape(angles)[-1]
        turned: Array = (np.array(form.sign) * self.senses)[:count] * (angles - zero[:count])
        return turned

    def moving_angles(self, angles: Array) -> Array:
        """Return angles of the joints that move from those of all joints of the arm [rad].

        The angles have shape (..., 7), or (..., 6) of an arm of six joints.
        """
        rows = np.asarray(angles, dtype=np.float64)
        return (
            rows if self.locked_joint is None else np.delete(rows, self.locked_joint - 1, axis=-1)
        )

    def all_angles(self, moving: Array) -> Array:
        """Return angles of all joints of the arm, the inverse of `moving_angles` [rad]."""
        rows, at = np.asarray(moving, dtype=np.float64), self.locked_joint
        return rows if at is None else np.insert(rows, at - 1, self.locked_angle, axis=-1)


def link_frames(limb: Limb, angles: Array) -> Array:
    """Return the frames of base and links in the limb's base frame, shape (..., 7, 4, 4).

    Joint angles have shape (..., 6) [rad].
    """
    return frames_at(limb.steps, limb.senses, angles)


def with_failed_joint(limb: Limb, joint: int, angle: float) -> Limb:
    """Return a limb with a joint, counted from 1, locked at an angle [rad].

    Its limits become that angle, and it is locked in place of the one that was. Raises a
    `RobotError`, to be preceded by which limb it is, if no six other joints can move it.
    """
    count = len(limb.joint_limits)
    if joint not in range(1, count + 1):
        raise RobotError(f"joint is {joint}; it must be a whole number from 1 to {count}")
    if limb.locked_joint is None:
        raise RobotError(
            f"has {count} joints: with joint {joint} failed it can hold its point, but neither "
            "step nor follow the body, so no plan moves a robot that it holds; only a limb of "
            "seven joints plans on"
        )
    low, high = limb.joint_limits[limb.locked_joint - 1]
    if low == high and (joint, angle) != (limb.locked_joint, low):
        raise RobotError(
            f"has joint {limb.locked_joint} failed at {low:g} rad already; with joint {joint} "
            f"failed at {angle:g} rad as well it could hold its point, but neither step nor "
            "follow the body"
        )
    try:
        failed = replace(limb, locked_joint=joint, locked_angle=float(angle))
    except RobotError as fault:
        raise RobotError(f"cannot move with joint {joint} failed: {fault}") from None
    limits = list(limb.joint_limits)
    limits[joint - 1] = (failed.locked_angle, failed.locked_angle)
    return replace(failed, joint_limits=tuple(limits))


@lru_cache(maxsize=8)
def _postures(limb: Limb) -> tuple[Array, Array]:
    """Return joint angles (k, 6) [rad] all over the limits, and link frames (k, 7, 4, 4)."""
    low, high = limb.windows.T
    angles = np.random.default_rng(0).uniform(low, high, (TRIED, 6))
    return angles, link_frames(limb, angles)


LIMB = Struct.of(Limb)
"""Fields of a `Limb`."""
