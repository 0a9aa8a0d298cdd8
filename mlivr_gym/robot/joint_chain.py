"""A chain of joints as a file has it, and the arm of a family that it is found to be."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.robot.any_limb import AnyLimb
from mlivr_gym.robot.file_joints import FileJoints, axes_of
from mlivr_gym.robot.link_frames import inverse, link_frames, rigid
from mlivr_gym.values import as_triple

ALIGNED = 1e-3
"""Largest angle between axes that count as parallel or perpendicular [rad]."""

MEETING = 1e-3
"""Largest distance of axes that count as crossing each other [m]."""

EXACT = 1e-7
"""Lengths [m] and angles [rad] below this are rounding errors of a file and count as 0."""

SAME = 1e-11
"""Frames that deviate by less, in metres and radians, are the same."""

DECIMALS = 9
"""Lengths are rounded to nanometres, so that a rounded angle of a file leaves no trace in them."""


class HeldJoint(NamedTuple):
    """A joint of a seven-joint arm that is held."""

    joint: int
    """Index of the joint in the chain."""
    angle: float
    """The angle at which it is held, in the terms of the file [rad]."""
    limits: tuple[float, float]
    """Its lower and upper limit in the file [rad]."""


class JointChain(NamedTuple):
    """The joints of an arm where those that move are at 0, all in one frame."""

    names: tuple[str, ...]
    """Names of the joints, n of them."""
    axes: Array
    """Unit vectors along them, shape (n, 3)."""
    anchors: Array
    """A point on each [m], shape (n, 3)."""
    base: Array
    """Frame of the link that carries the first joint, shape (4, 4)."""
    flange: Array
    """Frame of the flange, shape (4, 4)."""
    held: HeldJoint | None
    """The joint that is held, None if all move."""

    @property
    def moving(self) -> JointChain:
        """The joints that move alone."""
        if self.held is None:
            return self
        k = self.held.joint
        names = (*self.names[:k], *self.names[k + 1 :])
        axes, anchors = (np.delete(rows, k, axis=0) for rows in (self.axes, self.anchors))
        return JointChain(names, axes, anchors, self.base, self.flange, None)


class RecognisedArm(NamedTuple):
    """An arm in the terms of its family."""

    kind: type[AnyLimb]
    """Class of the limb."""
    fields: dict[str, Any]
    """Its lengths [m], and the joint that is held."""
    signs: Array
    """1 or -1 for each joint of the family's arm, see `FileJoints`, shape (n,)."""
    zeros: Array
    """Angles of the family where those of the file are 0 [rad], shape (n,)."""
    mount: Array
    """Base frame of the limb in the frame of the chain, shape (4, 4)."""
    held_limits: tuple[float, float] = (-np.pi, np.pi)
    """Limits of the joint that is held [rad], if the family has one."""

    def limb(self, limits: list[tuple[float, float]]) -> AnyLimb:
        """Return the limb, by the limits of the joints that move."""
        held = self.fields.get("held_joint")
        if held is not None:
            limits = [*limits[: held - 1], self.held_limits, *limits[held - 1 :]]
        limb = self.kind(**self.fields, joint_limits=tuple(limits))
        if not self.zeros.any() and self.signs.min() > 0.0:
            return limb
        joints = FileJoints(tuple(self.signs.tolist()), tuple(self.zeros.tolist()))
        limb = replace(limb, joints=joints)
        return replace(limb, window_starts=_window_starts(limb))

    def turned(self, angle: float) -> RecognisedArm:
        """Return the arm with its base frame turned about the first axis [rad]."""
        mount, zeros = self.mount.copy(), self.zeros.copy()
        c, s = np.cos(angle), np.sin(angle)
        mount[:3, :2] = mount[:3, :2] @ [[c, -s], [s, c]]
        zeros[0] -= angle
        return self._replace(zeros=zeros, mount=mount)


def _window_starts(limb: AnyLimb) -> tuple[float, ...]:
    """Return where the windows of the form begin in the terms of the file [rad].

    Of those a turn apart the one is taken that lies nearest to the middle of the limits.
    """
    turn = 2.0 * np.pi
    starts = limb.signs * (np.array(limb.window_starts) - limb.zeros)
    starts = np.where(limb.signs < 0.0, starts - turn, starts)
    starts += turn * np.rint((limb.limits.mean(axis=1) - starts - np.pi) / turn)
    return tuple(starts.tolist())


def with_exact_frames(limb: AnyLimb, base: Array, chain: JointChain) -> AnyLimb:
    """Return a limb whose joints are exactly where a chain has them, by its base frame (4, 4).

    A link's frame has its z axis and its origin on the joint's axis, and its x axis next to that of
    the form. Frames of an arm that does not deviate from its form are those of the form.
    """
    of_form = base @ link_frames(limb, np.zeros(6))
    before, steps = base, []
    for k in range(6):
        z = limb.signs[k] * chain.axes[k]
        origin = of_form[k + 1, :3, 3] if k < 5 else chain.flange[:3, 3]
        origin = chain.anchors[k] + ((origin - chain.anchors[k]) @ z) * z
        x = of_form[k + 1, :3, 0] - (of_form[k + 1, :3, 0] @ z) * z
        x /= np.linalg.norm(x)
        frame = rigid(np.stack([x, np.cross(z, x), z], axis=1), origin)
        steps.append(inverse(before) @ frame)
        before = frame
    apart = max(
        float(np.abs(inverse(rigid(axes_of(quaternion), origin)) @ step - np.eye(4)).max())
        for (origin, quaternion), step in zip(limb.link_offsets, steps, strict=True)
    )
    if apart < SAME:
        return limb
    count = len(limb.joint_limits)
    joints = limb.joints or FileJoints((1.0,) * count, (0.0,) * count)
    turns = Rotation.from_matrix([step[:3, :3] for step in steps]).as_quat(scalar_first=True)
    frames = tuple(as_triple(step[:3, 3]) for step in steps)
    quaternions = tuple(map(tuple, turns.tolist()))
    return replace(limb, joints=replace(joints, origins=frames, quaternions=quaternions))


def foot(chain: JointChain, k: int, other: int) -> Array:
    """Return the point of joint `k`'s axis that is nearest to the axis of another joint [m]."""
    axis, along = chain.axes[k], chain.axes[other]
    apart = chain.anchors[other] - chain.anchors[k]
    # The plane through the other axis and the common perpendicular has this normal.
    after_move = np.cross(along, np.cross(axis, along))
    share = (apart @ after_move) / (axis @ after_move)
    nearest: Array = chain.anchors[k] + share * axis
    return nearest


def mount_on(chain: JointChain, x: Array, up: Array) -> Array:
    """Return the mount of an arm, (4, 4): on axis 1 at the height of its base, with given axes."""
    base = chain.base[:3, 3] - chain.anchors[0]
    return rigid(np.stack([x, np.cross(up, x), up], axis=1), chain.anchors[0] + (base @ up) * up)


def base_sign(chain: JointChain, shoulder: Array) -> float:
    """Return the sign of axis 1 with which the shoulder lies over the base."""
    over = (shoulder - chain.base[:3, 3]) @ chain.axes[0]
    return sign_of(float(over), float(chain.base[:3, 2] @ chain.axes[0]))


def flange_sign(chain: JointChain, wrist: Array) -> float:
    """Return the sign of the last axis with which it leads from the wrist to the flange."""
    out = (chain.flange[:3, 3] - wrist) @ chain.axes[-1]
    return sign_of(float(out), float(chain.flange[:3, 2] @ chain.axes[-1]))


def tool_x(flange: Array, out: Array) -> Array:
    """Return the flange's first axis across `out`, or its second where the first is along it."""
    for k in (0, 1):
        across: Array = flange[:3, k] - (flange[:3, k] @ out) * out
        size = float(np.linalg.norm(across))
        if size > 0.5:
            return across / size
    raise AssertionError("two axes of a frame cannot both be along one direction")


def are_parallel(chain: JointChain, k: int, other: int) -> bool:
    """Return whether the axes of two joints are parallel."""
    return float(np.linalg.norm(np.cross(chain.axes[k], chain.axes[other]))) <= ALIGNED


def right_angle_fault(chain: JointChain, k: int, other: int) -> str:
    """Return why the axes of two joints are not at right angles, empty if they are."""
    cosine = abs(float(chain.axes[k] @ chain.axes[other]))
    if cosine <= ALIGNED:
        return ""
    angle = np.rad2deg(np.arccos(np.clip(cosine, 0.0, 1.0)))
    pair = f"the axes of joints {chain.names[k]!r} and {chain.names[other]!r}"
    return f"{pair} are {angle:.3g} degrees apart, not 90"


def crossing_fault(chain: JointChain, k: int, other: int) -> str:
    """Return why the axes of two joints do not cross at right angles, empty if they do."""
    fault = right_angle_fault(chain, k, other)
    across = np.cross(chain.axes[k], chain.axes[other])
    gap = abs(float((chain.anchors[other] - chain.anchors[k]) @ across))
    if not fault and gap > MEETING:
        pair = f"the axes of joints {chain.names[k]!r} and {chain.names[other]!r}"
        fault = f"{pair} pass each other at {gap:.3g} m and do not cross"
    return fault


def flange_fault(chain: JointChain, wrist: Array) -> str:
    """Return why the flange does not lie on the last axis, through the wrist, empty if it does."""
    off = float(np.linalg.norm(np.cross(chain.flange[:3, 3] - wrist, chain.axes[-1])))
    if off <= MEETING:
        return ""
    return (
        f"the flange lies {off:.3g} m off the axis of joint {chain.names[-1]!r}; it must lie on "
        "it, choose another with tool_frame"
    )


def rounded(length: float) -> float:
    """Return a length rounded to nanometres, never -0 [m]."""
    return round(float(length), DECIMALS) + 0.0


def sign_of(length: float, otherwise: float) -> float:
    """Return the sign that makes a length positive, or another number if the length is 0."""
    number = length if abs(length) > MEETING else otherwise
    return -1.0 if number < -ALIGNED else 1.0


def axis_text(axis: Array) -> str:
    """Return an axis for a message."""
    return "(" + ", ".join(f"{round(float(a), 4) + 0.0:g}" for a in axis) + ")"
