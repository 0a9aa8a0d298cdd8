"""Arms with a spherical wrist in files, of six joints or of seven of which one is held."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.file_joints import FARTHEST_TURN
from mlivr_gym.robot.joint_chain import (
    ALIGNED,
    EXACT,
    MEETING,
    HeldJoint,
    JointChain,
    RecognisedArm,
    are_parallel,
    base_sign,
    crossing_fault,
    flange_fault,
    flange_sign,
    foot,
    mount_on,
    right_angle_fault,
    rounded,
    sign_of,
    tool_x,
)
from mlivr_gym.robot.link_frames import rigid
from mlivr_gym.robot.spherical_wrist_limb import HELD_JOINT, SphericalWristLimb


class Points(NamedTuple):
    """Points of an arm [m], each of shape (3,)."""

    foot: Array
    """Of axis 1, nearest to axis 2."""
    shoulder: Array
    """Of axis 2, nearest to axis 1."""
    beside: Array
    """Of axis 2, where axis 3 of seven joints crosses it; the shoulder of six joints."""
    elbow: Array
    """Of the elbow axis, nearest to the wrist point."""
    wrist: Array
    """Where the last three axes meet."""


def spherical_wrist(chain: JointChain) -> RecognisedArm | str:
    """Return a chain as an arm with a spherical wrist, or why it is none.

    The last three axes meet in a point, successive ones at right angles. Of six joints axis 2 is at
    right angles to axis 1 and axis 3 parallel to axis 2; any other six are those that move of an
    arm of seven of which one is held, see `_with_held_joint`. Of seven joints axes 1 to 4 are at
    right angles, axes 1 to 3 meet, but for an offset that the held joint leaves free, and joint 1,
    2 or 3 is held. Signs are chosen so that `a1`, `a2`, `d4` and `d6` are positive and zero angles
    near those of the file; a file whose zero angles are those of the family keeps its signs.
    """
    if len(chain.names) == 6:
        chain = _with_held_joint(chain)
    elbow = len(chain.names) - 4
    if chain.held is not None and chain.held.joint >= HELD_JOINT:
        names = ", ".join(repr(name) for name in chain.names[:HELD_JOINT])
        return f"joint {chain.names[chain.held.joint]!r} is held, which is none of {names}"
    reason = _wrist_fault(chain, elbow) or _shoulder_fault(chain)
    if reason:
        return reason
    points = _points(chain, elbow)
    reason = flange_fault(chain, points.wrist) or _elbow_fault(chain, points, elbow)
    if reason:
        return reason
    plus = np.ones(len(chain.names))
    literal = _seen_in_family(chain, points, plus)
    lengths = literal.lengths
    zeros = literal.zeros(chain, plus)
    if zeros.any() or min(lengths[name] for name in ("a2", "d4", "d6")) < 0.0:
        return _in_family(chain, points, _signs(chain, points, elbow))
    return _in_family(chain, points, plus)


def spherical_shoulder(chain: JointChain) -> RecognisedArm | str:
    """Return a chain as an arm with a spherical shoulder, or why it is none.

    Its joints in opposite order are those of an arm with a spherical wrist. Of seven joints, joint
    5 or 6 is held; where joint 6 is, axis 7 may lie beside axis 6.
    """
    fault = flange_fault(chain, chain.anchors[-1])
    if fault:
        return fault
    back = np.diag([1.0, -1.0, -1.0, 1.0])
    held = chain.held
    if held is not None:
        held = held._replace(joint=len(chain.names) - 1 - held.joint)
    foot_of_base = chain.base @ back
    away = foot_of_base[:3, 3] - chain.anchors[0]
    foot_of_base[:3, 3] = chain.anchors[0] + (away @ chain.axes[0]) * chain.axes[0]
    opposite = JointChain(
        chain.names[::-1], -chain.axes[::-1], chain.anchors[::-1], chain.flange @ back,
        foot_of_base, held,
    )  # fmt: skip
    found = spherical_wrist(opposite)
    if isinstance(found, str):
        return f"seen from the flange, {found}"
    arm = dict.fromkeys(("a1", "d2", "b2", "d3"), 0.0) | found.fields
    signs, zeros = found.signs[::-1], found.zeros[::-1].copy()
    if arm["held_joint"] is None and not arm["a1"]:
        arm |= {"held_joint": HELD_JOINT, "held_angle": 0.0, "d3": arm["d2"], "d2": 0.0}
        signs, zeros = (
            np.insert(one, 7 - HELD_JOINT, end) for one, end in ((signs, 1.0), (zeros, 0.0))
        )
    if arm["held_joint"] not in (2, 3) or arm["d2"]:
        return "seen from the flange, neither its joint 2 nor its joint 3 is the one that is held"
    fields = {
        "d1": arm["d6"], "a2": arm["d4"], "b2": -arm["a3"] + 0.0, "a3": -arm["b2"] + 0.0,
        "d3": arm["d3"], "d4": arm["a2"], "d6": arm["d1"], "a6": -arm["a1"] + 0.0,
        "held_joint": 8 - arm["held_joint"], "held_angle": arm["held_angle"],
    }  # fmt: skip
    out = found.signs[0] * opposite.axes[0]
    tool, first = tool_x(chain.flange, out), found.mount[:3, 0]
    zeros[-1] -= np.arctan2(np.cross(first, tool) @ out, first @ tool)
    zeros[np.abs(zeros) < EXACT] = 0.0
    up = -found.signs[-1] * opposite.axes[-1]
    ahead = tool_x(foot_of_base, up)
    mount = rigid(np.stack([ahead, np.cross(up, ahead), up], axis=1), foot_of_base[:3, 3])
    return RecognisedArm(SphericalWristLimb, fields, signs, zeros, mount, found.held_limits)


def _with_held_joint(chain: JointChain) -> JointChain:
    """Return six joints as seven of which one is held, if they are no other form.

    It is joint 3 where axes 1 and 2 cross and axis 3 is not parallel to axis 2, the roll of an
    upper arm that no joint moves, and joint 2 where axes 1 and 2 meet at another angle.
    """
    first, second, lean = chain.axes[:3]
    if not right_angle_fault(chain, 0, 1):
        if not _is_tilted(chain) or crossing_fault(chain, 0, 1):
            return chain
        joint, anchor, axis = 2, foot(chain, 1, 0), np.cross(second, lean)
        before, after, ahead = second, lean, chain.anchors[2] - anchor
    else:
        axis = np.cross(first, second)
        if np.linalg.norm(axis) <= ALIGNED or right_angle_fault(chain, 1, 2):
            return chain
        joint, anchor = 1, foot(chain, 1, 0)
        before, after, ahead = first, second, chain.base[:3, 0]
    axis = _unit(axis) * (-1.0 if ahead @ axis < -EXACT else 1.0)
    angle = float(np.arctan2(np.cross(before, after) @ axis, before @ after))
    return JointChain(
        (*chain.names[:joint], "held", *chain.names[joint:]),
        np.insert(chain.axes, joint, axis, axis=0),
        np.insert(chain.anchors, joint, anchor, axis=0),
        chain.base, chain.flange, HeldJoint(joint, angle, (-np.pi, np.pi)),
    )  # fmt: skip


def _wrist_fault(chain: JointChain, elbow: int) -> str:
    """Return why the last three axes form no spherical wrist, empty if they do."""
    for k in (elbow + 1, elbow + 2):
        fault = crossing_fault(chain, k, k + 1)
        if fault:
            return fault
    wrist = foot(chain, elbow + 2, elbow + 3)
    apart = wrist - foot(chain, elbow + 2, elbow + 1)
    if np.linalg.norm(apart) > MEETING:
        names = ", ".join(repr(name) for name in chain.names[-3:])
        return (
            f"the axes of joints {names} do not meet in a point; they pass each other at "
            f"{np.linalg.norm(apart):.3g} m"
        )
    return right_angle_fault(chain, elbow, elbow + 1)


def _shoulder_fault(chain: JointChain) -> str:
    """Return why the first axes are not those of the form, empty if they are."""
    fault = right_angle_fault(chain, 0, 1)
    if fault or chain.held is None:
        return fault or (crossing_fault(chain, 0, 1) if _is_tilted(chain) else "")
    # Only a held joint 2 may leave axis 1 beside axis 2, only another axis 3 beside axis 1.
    second = chain.held.joint == 1
    fault = ("" if second else crossing_fault(chain, 0, 1)) or crossing_fault(chain, 1, 2)
    apart = foot(chain, 1, 0) - foot(chain, 1, 2)
    if not fault and second and np.linalg.norm(apart) > MEETING:
        names = ", ".join(repr(name) for name in chain.names[:3])
        fault = (
            f"the axes of joints {names} do not meet in a point, while joint {chain.names[1]!r} is "
            f"held; they pass each other at {np.linalg.norm(apart):.3g} m"
        )
    return fault or right_angle_fault(chain, 2, 3)


def _points(chain: JointChain, elbow: int) -> Points:
    """Return where shoulder, elbow and wrist are."""
    wrist = foot(chain, elbow + 2, elbow + 3)
    along, anchor = chain.axes[elbow], chain.anchors[elbow]
    at_elbow = anchor + ((wrist - anchor) @ along) * along
    shoulder = foot(chain, 1, 0)
    beside = shoulder if elbow == 2 else foot(chain, 1, 2)
    return Points(foot(chain, 0, 1), shoulder, beside, at_elbow, wrist)


def _elbow_fault(chain: JointChain, points: Points, elbow: int) -> str:
    """Return why upper arm and forearm are not those of the form, empty if they are."""
    name, axis = chain.names[elbow], chain.axes[elbow]
    if np.linalg.norm(points.wrist - points.elbow) <= MEETING:
        return f"the wrist point lies on the axis of joint {name!r}"
    if np.linalg.norm(np.cross(points.elbow - points.beside, axis)) <= MEETING:
        if elbow == 2:
            return f"the axes of joints {chain.names[1]!r} and {name!r} are one line"
        return f"the axis of joint {name!r} passes through the shoulder"
    return ""


def _signs(chain: JointChain, points: Points, elbow: int) -> Array:
    """Return the sign of each axis."""
    axes, names = chain.axes, chain.names
    upper = points.elbow - points.beside
    signs = np.ones(len(names))
    signs[0] = base_sign(chain, points.shoulder)
    outward = np.cross(signs[0] * axes[0], axes[1])
    ahead = float(chain.base[:3, 0] @ outward)
    signs[1] = sign_of(float((points.shoulder - points.foot) @ outward), ahead)
    signs[-3] = sign_of(float((points.wrist - points.elbow) @ axes[-3]), 1.0)
    signs[-1] = flange_sign(chain, points.wrist)
    if elbow == 3:
        signs[2] = sign_of(float(upper @ axes[2]), 1.0)
    else:
        signs[2] = sign_of(float(axes[2] @ (signs[1] * axes[1])), 1.0)
    # The elbow axis of seven joints and the axis behind that of the forearm may point either way.
    turned = [(elbow + 2, elbow + 1)] if elbow == 2 else [(elbow, 2), (elbow + 2, elbow + 1)]
    for k, before in turned:
        zero = _seen_in_family(chain, points, signs).zeros(chain, signs)[before]
        if abs(np.arctan2(np.sin(zero), np.cos(zero))) > 0.5 * np.pi + EXACT:
            signs[k] = -1.0
    return signs


class ArmInFamily(NamedTuple):
    """An arm in the terms of its family where the joints of the chain that move are at 0."""

    angles: Array
    """Angles of all joints [rad], shape (n,)."""
    lengths: dict[str, float]
    """Lengths by the fields of the limb [m]."""
    mount: Array
    """Base frame of the arm, shape (4, 4)."""

    def zeros(self, chain: JointChain, signs: Array) -> Array:
        """Return the angles where those of the file are 0 [rad]."""
        zeros = self.angles.copy()
        if chain.held is not None:
            zeros[chain.held.joint] -= signs[chain.held.joint] * chain.held.angle
        return zeros


def _seen_in_family(chain: JointChain, points: Points, signs: Array) -> ArmInFamily:
    """Return angles and lengths of the chain in the family for signs of the axes, shape (n,)."""
    axes, seven = signs[:, None] * chain.axes, len(signs) == 7
    up, second, lean = axes[0], axes[1], axes[len(axes) - 4]
    wrist_1, wrist_2, out = axes[-3:]
    first = _unit(np.cross(up, second))
    upper, fore = points.elbow - points.beside, points.wrist - points.elbow
    along = axes[2] if seven else _unit(upper - (upper @ second) * second)
    x2, x3, x4 = np.cross(along, second), np.cross(wrist_1, lean), np.cross(wrist_1, wrist_2)
    held = float(np.arctan2(lean @ x2, lean @ second)) if seven else 0.0
    rolled, x5, tool = np.cross(along, lean), np.cross(out, wrist_2), tool_x(chain.flange, out)
    angles = [
        0.0,
        np.arctan2(x2 @ up, x2 @ first),
        *([held] if seven else []),
        np.arctan2(x3 @ along, x3 @ rolled),
        np.arctan2(wrist_2 @ x3, wrist_2 @ lean),
        np.arctan2(-out @ x4, out @ wrist_1),
        np.arctan2(-tool @ wrist_2, tool @ x5),
    ]
    mount = mount_on(chain, first, up)
    lengths = {
        "d1": (points.shoulder - mount[:3, 3]) @ up, "a2": upper @ along, "a3": fore @ x3,
        "d4": fore @ wrist_1, "d6": (chain.flange[:3, 3] - points.wrist) @ out,
    }  # fmt: skip
    # Offsets that a held joint does not leave free are rounding errors.
    free = None if chain.held is None else chain.held.joint
    if free in (None, 1):
        lengths["a1"] = (points.shoulder - points.foot) @ first
    if free in (0, 2):
        lengths["d2"] = (points.beside - points.shoulder) @ second
    if seven:
        lengths |= {"b2": upper @ rolled, "d3": upper @ lean}
    else:
        lengths["d2"] = upper @ second
    if chain.held is not None and chain.held.joint == 0:
        # The axes of the mount are those where joint 1 is at 0.
        angles[0] = signs[0] * chain.held.angle
        c, s = np.cos(angles[0]), np.sin(angles[0])
        mount[:3, :3] = mount[:3, :3] @ [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]
    rounded_off = np.array(angles)
    rounded_off[np.abs(rounded_off) < EXACT] = 0.0
    exact = {k: rounded(v) if abs(v) > EXACT else 0.0 for k, v in lengths.items()}
    return ArmInFamily(rounded_off, exact, mount)


def _in_family(chain: JointChain, points: Points, signs: Array) -> RecognisedArm:
    """Return the arm for signs of the axes, shape (n,)."""
    seen = _seen_in_family(chain, points, signs)
    fields: dict[str, Any] = {**seen.lengths, "held_joint": None}
    if chain.held is None:
        return RecognisedArm(SphericalWristLimb, fields, signs, seen.angles, seen.mount)
    fields |= {"held_joint": chain.held.joint + 1, "held_angle": chain.held.angle}
    low, high = chain.held.limits
    limits = max(low, -FARTHEST_TURN), min(high, FARTHEST_TURN)
    zeros = seen.zeros(chain, signs)
    return RecognisedArm(SphericalWristLimb, fields, signs, zeros, seen.mount, limits)


def _is_tilted(chain: JointChain) -> bool:
    """Return whether the elbow axis of an arm is not parallel to axis 2."""
    return not are_parallel(chain, 1, len(chain.axes) - 4)


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit
