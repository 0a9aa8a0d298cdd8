"""Arms with a spherical wrist in files, of six joints or of seven of which one is held."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.joint_chain import (
    ALIGNED,
    EXACT,
    MEETING,
    JointChain,
    RecognisedArm,
    crossing_fault,
    flange_fault,
    foot,
    right_angle_fault,
    rounded,
    sign_of,
    tool_x,
)
from mlivr_gym.robot.spherical_wrist_limb import HELD_JOINT, SphericalWristLimb


class Points(NamedTuple):
    """Points of an arm [m], each of shape (3,)."""

    foot: Array
    """Of axis 1, nearest to axis 2."""
    shoulder: Array
    """Of axis 2, nearest to axis 1."""
    elbow: Array
    """Of the elbow axis, nearest to the wrist point."""
    wrist: Array
    """Where the last three axes meet."""


def spherical_wrist(chain: JointChain) -> RecognisedArm | str:
    """Return a chain as an arm with a spherical wrist, or why it is none.

    The last three axes meet in a point, successive ones at right angles, and axis 2 is at right
    angles to axis 1. Of six joints axis 3 is parallel to axis 2, or axes 1 and 2 cross, as where
    the roll of the upper arm of a seven-joint arm is fixed; of seven joints axes 1 to 3 meet. Signs
    are chosen so that `a1`, `a2`, `d4` and `d6` are positive and zero angles near those of the
    file; a file whose zero angles are those of the family keeps its signs.
    """
    elbow = len(chain.names) - 4
    if chain.held is not None and chain.held.joint >= HELD_JOINT:
        names = ", ".join(repr(name) for name in chain.names[:HELD_JOINT])
        return f"joint {chain.names[chain.held.joint]!r} is held, which is none of {names}"
    reason = _wrist_fault(chain, elbow) or _shoulder_fault(chain, elbow)
    if reason:
        return reason
    points = _points(chain, elbow)
    reason = flange_fault(chain, points.wrist) or _elbow_fault(chain, points, elbow)
    if reason:
        return reason
    plus = np.ones(len(chain.names))
    literal = _seen_in_family(chain, points, plus)
    lengths = literal.lengths
    if literal.zeros(chain, plus).any() or min(lengths[name] for name in ("a2", "d4", "d6")) < 0.0:
        return _in_family(chain, points, _signs(chain, points, elbow))
    return _in_family(chain, points, plus)


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


def _shoulder_fault(chain: JointChain, elbow: int) -> str:
    """Return why the first axes are not those of the form, empty if they are."""
    fault = right_angle_fault(chain, 0, 1)
    if fault:
        return fault
    if elbow == 2:
        return crossing_fault(chain, 0, 1) if _is_tilted(chain) else ""
    fault = crossing_fault(chain, 0, 1) or crossing_fault(chain, 1, 2)
    apart = foot(chain, 1, 0) - foot(chain, 1, 2)
    if not fault and np.linalg.norm(apart) > MEETING:
        names = ", ".join(repr(name) for name in chain.names[:3])
        fault = (
            f"the axes of joints {names} do not meet in a point, while a shoulder of seven joints "
            f"is spherical; they pass each other at {np.linalg.norm(apart):.3g} m"
        )
    return fault or right_angle_fault(chain, 2, 3)


def _points(chain: JointChain, elbow: int) -> Points:
    """Return where shoulder, elbow and wrist are."""
    wrist = foot(chain, elbow + 2, elbow + 3)
    along, anchor = chain.axes[elbow], chain.anchors[elbow]
    at_elbow = anchor + ((wrist - anchor) @ along) * along
    return Points(foot(chain, 0, 1), foot(chain, 1, 0), at_elbow, wrist)


def _elbow_fault(chain: JointChain, points: Points, elbow: int) -> str:
    """Return why upper arm and forearm are not those of the form, empty if they are."""
    name, axis = chain.names[elbow], chain.axes[elbow]
    if np.linalg.norm(points.wrist - points.elbow) <= MEETING:
        return f"the wrist point lies on the axis of joint {name!r}"
    upper = points.elbow - points.shoulder
    if elbow == 2 and not _is_tilted(chain):
        if np.linalg.norm(np.cross(upper, axis)) <= MEETING:
            return f"the axes of joints {chain.names[1]!r} and {name!r} are one line"
        return ""
    off = abs(float(upper @ axis))
    if off > MEETING:
        return (
            f"the shoulder lies {off:.3g} m beside the plane in which the wrist point turns about "
            f"joint {name!r}"
        )
    if np.linalg.norm(upper) <= MEETING:
        return f"the axis of joint {name!r} passes through the shoulder"
    return ""


def _signs(chain: JointChain, points: Points, elbow: int) -> Array:
    """Return the sign of each axis."""
    axes, names = chain.axes, chain.names
    upper = points.elbow - points.shoulder
    signs = np.ones(len(names))
    signs[0] = sign_of(
        float((points.shoulder - chain.base[:3, 3]) @ axes[0]),
        float(chain.base[:3, 2] @ axes[0]),
    )
    outward = np.cross(signs[0] * axes[0], axes[1])
    ahead = float(chain.base[:3, 0] @ outward)
    signs[1] = sign_of(float((points.shoulder - points.foot) @ outward), ahead)
    signs[-3] = sign_of(float((points.wrist - points.elbow) @ axes[-3]), 1.0)
    out = float((chain.flange[:3, 3] - points.wrist) @ axes[-1])
    signs[-1] = sign_of(out, float(chain.flange[:3, 2] @ axes[-1]))
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
    held: float
    """Angle from axis 2 to the elbow axis about the upper arm [rad]."""
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
    upper, fore = points.elbow - points.shoulder, points.wrist - points.elbow
    tilted = seven or _is_tilted(chain)
    if seven:
        along = axes[2]
    elif tilted:
        along = _unit(np.cross(second, lean))
        along = along * (-1.0 if upper @ along < 0.0 else 1.0)
    else:
        along = _unit(upper - (upper @ second) * second)
    x2, x3, x4 = np.cross(along, second), np.cross(wrist_1, lean), np.cross(wrist_1, wrist_2)
    held = float(np.arctan2(lean @ x2, lean @ second)) if tilted else 0.0
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
    mount = np.eye(4)
    mount[:3, :3] = np.stack([first, np.cross(up, first), up], axis=1)
    base = chain.base[:3, 3] - chain.anchors[0]
    mount[:3, 3] = chain.anchors[0] + (base @ up) * up
    lengths = {
        "d1": (points.shoulder - mount[:3, 3]) @ up, "a2": upper @ along, "a3": fore @ x3,
        "d4": fore @ wrist_1, "d6": (chain.flange[:3, 3] - points.wrist) @ out,
    }  # fmt: skip
    if tilted:
        lengths["b2"] = upper @ rolled
    else:
        lengths |= {"a1": (points.shoulder - points.foot) @ first, "d2": upper @ second}
    if chain.held is not None and chain.held.joint == 0:
        # The axes of the mount are those where joint 1 is at 0.
        angles[0] = signs[0] * chain.held.angle
        c, s = np.cos(angles[0]), np.sin(angles[0])
        mount[:3, :3] = mount[:3, :3] @ [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]
    rounded_off = np.array(angles)
    rounded_off[np.abs(rounded_off) < EXACT] = 0.0
    return ArmInFamily(rounded_off, held, {k: rounded(v) for k, v in lengths.items()}, mount)


def _in_family(chain: JointChain, points: Points, signs: Array) -> RecognisedArm:
    """Return the arm for signs of the axes, shape (n,)."""
    seen = _seen_in_family(chain, points, signs)
    fields: dict[str, Any] = {**seen.lengths, "held_joint": None}
    if chain.held is None:
        if not _is_tilted(chain):
            return RecognisedArm(SphericalWristLimb, fields, signs, seen.angles, seen.mount)
        # The roll of an upper arm that no joint of the file moves may be held anywhere.
        fields |= {"held_joint": HELD_JOINT, "held_angle": rounded(seen.held)}
        limits = (-np.pi, np.pi)
        return RecognisedArm(SphericalWristLimb, fields, signs, seen.angles, seen.mount, limits)
    k = chain.held.joint
    zero = seen.zeros(chain, signs)[k]
    low, high = sorted(float(signs[k] * end + zero) for end in chain.held.limits)
    turns = float(2.0 * np.pi * np.round(0.5 * (low + high) / (2.0 * np.pi)))
    fields |= {"held_joint": k + 1, "held_angle": rounded(seen.angles[k] - turns)}
    moving, angles = np.delete(signs, k), np.delete(seen.angles, k)
    limits = (low - turns, high - turns)
    return RecognisedArm(SphericalWristLimb, fields, moving, angles, seen.mount, limits)


def _is_tilted(chain: JointChain) -> bool:
    """Return whether the elbow axis of an arm is not parallel to axis 2."""
    lean = chain.axes[len(chain.axes) - 4]
    return float(np.linalg.norm(np.cross(chain.axes[1], lean))) > ALIGNED


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit
