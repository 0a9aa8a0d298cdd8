"""The joints of an arm of a file as a chain, in the terms of the file."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.any_limb import ANY_LIMB, AnyLimb
from mlivr_gym.robot.chain_limb import ChainLimb
from mlivr_gym.robot.description import WINDOWS, Description
from mlivr_gym.robot.file_arms import JOINTS, FileArm, body_frame, limits_of
from mlivr_gym.robot.limb import FARTHEST_TURN
from mlivr_gym.robot.link_frames import inverse, rigid, turn_about_z
from mlivr_gym.schema import FieldPath
from mlivr_gym.values import MAX_ROBOT_LENGTH, as_triple

LIMBS = "every_limb"
"""Name of the limbs among the fields of a file that this package wrote."""

AS_WRITTEN = 1e-7
"""Largest deviation of a link's frame from that of the limb, in metres and radians, in a file that
nobody changed."""

MEETING = 1e-3
"""Largest distance of the flange from the last axis [m]."""

PARALLEL = 1e-6
"""Sine of the angle between axes below which they count as parallel."""

SAME = 1e-11
"""Parts of frames below this are rounding errors [m, rad]."""


class FileChain(NamedTuple):
    """An arm of a file as a limb, and where it is."""

    limb: AnyLimb
    """The limb."""
    mount: Array
    """Its mount in the world, shape (4, 4)."""

    def turned(self, angle: float) -> FileChain:
        """Return the arm with its mount turned about the first axis [rad]."""
        limb, turn = self.limb, turn_about_z(angle)
        if not isinstance(limb, ChainLimb):
            places, turns = zip(*limb.link_offsets, strict=True)
            limits = tuple(map(tuple, limb.limits.tolist()))
            limb = ChainLimb(places, turns, limits, window_starts=limb.window_starts)
        first = inverse(turn) @ _step(limb, 0)
        quaternions = (_quaternion(first), *limb.quaternions[1:])
        origins = (as_triple(first[:3, 3]), *limb.origins[1:])
        limb = replace(limb, origins=origins, quaternions=quaternions)
        return FileChain(limb, self.mount @ turn)


def chain_of(file: Description, arm: FileArm, number: int, flange: Array) -> FileChain:
    """Return an arm of a file, by its number and the frame of its flange in the world (4, 4).

    The axis of the first joint, in the sense in which the arm lies over its base, is the z axis of
    the mount, whose x axis is as that of the link that carries it. The frame of a link has its
    origin where the joint's axis is closest to that of the link before, and its x axis as the file
    has it. Raises a `RobotError` if the joints are
    those of no limb.
    """
    written = _exported(file, arm, number)
    if written is not None:
        return written
    joints = list(arm.joints)
    if len(joints) != JOINTS:
        first, last = (file.joints[joints[k]].name for k in (0, -1))
        raise RobotError(
            f"the arm of joints {first!r} to {last!r} has {len(joints)} "
            f"{'joint' if len(joints) == 1 else 'joints'}; a limb has six, or seven of which one "
            "is held: name its last link with tips"
        )
    if arm.held is not None:
        joints.insert(arm.held[1].joint, arm.held[0])
    moved = [int(file.model.jnt_bodyid[joint]) for joint in joints]
    axes, anchors = file.data.xaxis[joints].copy(), file.data.xanchor[joints].copy()
    names = [file.joints[joint].name for joint in joints]
    _check_size(names, np.vstack([anchors, flange[None, :3, 3]]))
    away = flange[:3, 3] - anchors[-1]
    off = float(np.linalg.norm(np.cross(away, axes[-1])))
    if off > MEETING:
        raise RobotError(
            f"the flange lies {off:.3g} m off the axis of joint {names[-1]!r}; it must lie on it, "
            "choose another with tool_frame"
        )
    base = body_frame(file.data, int(file.model.body_parentid[moved[0]]))
    shoulder, wrist = _foot(axes, anchors, 0, 1), _foot(axes, anchors, -1, -2)
    senses = np.ones(len(joints))
    senses[0] = _sense((shoulder - base[:3, 3]) @ axes[0], base[:3, 2] @ axes[0])
    senses[-1] = _sense((flange[:3, 3] - wrist) @ axes[-1], flange[:3, 2] @ axes[-1])
    along = senses[:, None] * axes
    mount = _frame(base, along[0], anchors[0], base[:3, 3])
    frames = [mount]
    for k, body in enumerate(moved[:-1]):
        place = _foot(axes, anchors, 1, 0) if k == 1 else frames[-1][:3, 3]
        place = anchors[0] if k == 0 else place
        frames.append(_frame(body_frame(file.data, body), along[k], anchors[k], place))
    frames.append(_frame(flange, along[-1], anchors[-1], flange[:3, 3]))
    at_zero = list(frames)
    if arm.held is not None:
        # The file holds the joint at its angle.
        k, angle = arm.held[1].joint, arm.held[1].angle
        at_zero[k + 1] = frames[k + 1] @ turn_about_z(-senses[k] * angle)
    steps = [inverse(frames[k]) @ at_zero[k + 1] for k in range(len(joints))]
    return FileChain(_limb_of(file, arm, steps, senses), mount)


def _limb_of(file: Description, arm: FileArm, steps: list[Array], senses: Array) -> ChainLimb:
    """Return the limb of some steps from frame to frame, each of shape (4, 4)."""
    limits, held = limits_of(file, arm), dict[str, Any]()
    if arm.held is not None:
        joint, at = arm.held
        low, high = at.limits
        limits.insert(at.joint, (max(low, -FARTHEST_TURN), min(high, FARTHEST_TURN)))
        held = {"held_joint": at.joint + 1, "held_angle": at.angle}
    for step in steps:
        step[np.abs(step) < SAME] = 0.0
    try:
        limb = ChainLimb(
            tuple(as_triple(step[:3, 3]) for step in steps),
            tuple(map(_quaternion, steps)), tuple(limits), tuple(senses.tolist()), **held,
        )  # fmt: skip
    except RobotError as fault:
        if arm.held is None:
            raise
        raise RobotError(
            f"joint {file.joints[joint].name!r} cannot be held at {at.angle:g} rad, give another "
            f"held_angle or held_joint: {fault}"
        ) from None
    return limb.with_usual_windows()


def _exported(file: Description, arm: FileArm, number: int) -> FileChain | None:
    """Return the limb that a file says it has, None if it says nothing or was changed."""
    listed = file.fields.get(LIMBS)
    if not file.is_exported or not isinstance(listed, list) or number >= len(listed):
        return None
    limb = ANY_LIMB.read(listed[number], FieldPath(f"{LIMBS}[{number}]", RobotError))
    base = body_frame(file.data, int(file.model.body_parentid[arm.first]))
    there = np.array([body_frame(file.data, link) for link in arm.links])
    axes = file.model.jnt_axis[list(arm.joints), 2]
    off = np.abs(base @ limb.frames_at_zero[1:] - there).max()
    if max(off, np.abs(axes - limb.senses).max()) > AS_WRITTEN:
        return None
    limits = limits_of(file, arm)
    if limb.held_joint is not None:
        limits.insert(limb.held_joint - 1, limb.joint_limits[limb.held_joint - 1])
    starts = figures_of_limb(file, WINDOWS, number)
    limb = replace(limb, joint_limits=tuple(limits), window_starts=starts)
    mount = base
    if limb.base_in_mount is not None:
        mount = base @ inverse(rigid(*limb.base_in_mount))
    return FileChain(limb, mount)


def figures_of_limb(file: Description, name: str, number: int) -> tuple[float, ...]:
    """Return figures of one limb that a file of this package names, by their name."""
    listed = file.fields[name]
    if not isinstance(listed, list) or len(listed) <= number:
        raise RobotError(f"{name} of the file must be a list of six numbers for each limb")
    found: tuple[float, ...] = listed[number]
    return found


def _check_size(names: list[str], points: Array) -> None:
    """Refuse an arm longer than any robot, which is probably given in millimetres."""
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if length > MAX_ROBOT_LENGTH:
        raise RobotError(
            f"the limb of joints {names[0]!r} to {names[-1]!r} is {length:.4g} m long; it must be "
            f"at most {MAX_ROBOT_LENGTH:g} m: lengths are in metres, is the file in millimetres?"
        )


def _foot(axes: Array, anchors: Array, k: int, other: int) -> Array:
    """Return the point of an axis that is closest to another one, of parallel ones its anchor."""
    across = np.cross(axes[other], np.cross(axes[k], axes[other]))
    share = float(axes[k] @ across)
    point: Array = anchors[k]
    if share > PARALLEL * PARALLEL:
        point = point + float((anchors[other] - anchors[k]) @ across) / share * axes[k]
    return point


def _sense(length: float, otherwise: float) -> float:
    """Return the sense that makes a length positive, or another number if the length is 0."""
    number = length if abs(length) > MEETING else otherwise
    return -1.0 if number < -MEETING else 1.0


def _frame(given: Array, z: Array, anchor: Array, place: Array) -> Array:
    """Return the frame with a z axis and its origin on that where a place is closest to it.

    Its x axis is that of a given frame, or where z is close to it the given y axis.
    """
    x = given[:3, 0] - (given[:3, 0] @ z) * z
    if np.linalg.norm(x) < 0.5:
        x = given[:3, 1] - (given[:3, 1] @ z) * z
    x /= np.linalg.norm(x)
    origin = anchor + ((place - anchor) @ z) * z
    return rigid(np.stack([x, np.cross(z, x), z], axis=1), origin)


def _step(limb: ChainLimb, k: int) -> Array:
    """Return a frame of a limb in the one before it, shape (4, 4)."""
    rotation = Rotation.from_quat(limb.quaternions[k], scalar_first=True).as_matrix()
    return rigid(rotation, limb.origins[k])


def _quaternion(frame: Array) -> tuple[float, float, float, float]:
    """Return the quaternion w, x, y, z of a frame."""
    turn = Rotation.from_matrix(frame[:3, :3]).as_quat(canonical=True, scalar_first=True)
    w, x, y, z = (turn + 0.0).tolist()
    return w, x, y, z
