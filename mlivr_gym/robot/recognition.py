"""Which family of arms a chain of joints belongs to, from the axes of its joints.

A family is a row of `FAMILIES`: its recogniser takes the axes and anchors of the joints at the zero
posture of a file and returns the lengths of the family with the signs and offsets that turn the
file's joint angles into the family's, or the reason why the chain is of another family.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError

ALIGNED = 1e-3
"""Largest angle between axes that count as parallel or perpendicular [rad]."""

MEETING = 1e-3
"""Largest distance of axes that count as crossing each other [m]."""

EXACT = 1e-7
"""Lengths [m] and angles [rad] below this are rounding errors of a file and count as 0."""

DECIMALS = 9
"""Lengths are rounded to nanometres, so that a rounded angle of a file leaves no trace in them."""


class JointChain(NamedTuple):
    """The joints of an arm at the zero posture of its file, all in one frame."""

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


class RecognisedArm(NamedTuple):
    """An arm in the terms of its family."""

    lengths: dict[str, float]
    """Lengths by the name of the field of `Limb` [m]."""
    signs: Array
    """1 or -1 for each joint: an angle of the family is `sign * angle of the file + offset`."""
    offsets: Array
    """The offsets [rad], shape (6,)."""
    mount: Array
    """Base frame of the limb in the frame of the chain, shape (4, 4)."""


class ArmFamily(NamedTuple):
    """A family of arms."""

    name: str
    """Its name in messages."""
    joints: int
    """Number of joints of its arms."""
    recognise: Callable[[JointChain], RecognisedArm | str]
    """Return the arm, or why the chain is not of this family."""


def recognised(chain: JointChain) -> RecognisedArm:
    """Return an arm in the terms of the first family that it belongs to.

    Raises
    ------
    RobotError
        If it belongs to none; the message has the reason for each family and the axes.
    """
    reasons = []
    for family in FAMILIES:
        if len(chain.names) != family.joints:
            reasons.append(f"{family.name}: it has {len(chain.names)} joints, not {family.joints}")
            continue
        found = family.recognise(chain)
        if isinstance(found, RecognisedArm):
            return found
        reasons.append(f"{family.name}: {found}")
    axes = ", ".join(
        f"{name} {_told(axis)}" for name, axis in zip(chain.names, chain.axes, strict=True)
    )
    raise RobotError(
        f"the arm of joints {chain.names[0]!r} to {chain.names[-1]!r} is of no supported family "
        f"({'; '.join(reasons)}); axes of its joints: {axes}"
    )


def three_parallel(chain: JointChain) -> RecognisedArm | str:
    """Return a chain as an arm of the UR form, or why it is none.

    Its axes 2, 3 and 4 are parallel, axes 1, 2 and 4, 5 and 5, 6 are perpendicular and cross. With
    `n` the common direction of axes 2 to 4, a length `d` is measured along the axis before it, and
    `a2`, `a3` across `n`. Signs are those of the file if its zero posture is that of the standard
    DH convention, else those of the UR arms: `a2`, `a3` negative and the others not.
    """
    reason = _fault(chain)
    if reason:
        return reason
    shoulder = _foot(chain, 0, 1)
    bend = _foot(chain, 3, 4)
    wrist = _foot(chain, 4, 5)
    tip = chain.flange[:3, 3] - wrist
    along = float(tip @ chain.axes[5])
    off = float(np.linalg.norm(tip - along * chain.axes[5]))
    if off > MEETING:
        return (
            f"the flange lies {off:.3g} m off the axis of joint {chain.names[5]!r}; it must lie "
            "on it, choose another with tool_frame"
        )
    points = np.array([shoulder, bend, wrist])
    literal = _in_family(chain, points, np.array([1.0, 1.0, 1.0, 1.0]), (0.0, 0.0))
    if not np.abs(literal.offsets).max() and _points_out(chain, literal.lengths["d6"], 1.0):
        return literal
    normal = chain.axes[1]
    signs = np.array([
        _sign((shoulder - chain.base[:3, 3]) @ chain.axes[0], chain.base[:3, 2] @ chain.axes[0]),
        _sign((bend - shoulder) @ normal, 1.0),
        _sign((wrist - bend) @ chain.axes[4], 1.0),
        _sign(along, chain.flange[:3, 2] @ chain.axes[5]),
    ])  # fmt: skip
    return _in_family(chain, points, signs, (-1.0, -1.0))


def _fault(chain: JointChain) -> str:
    """Return in which respect axes are not those of the UR form, empty if they are."""
    names, axes = chain.names, chain.axes
    for k in (2, 3):
        if np.linalg.norm(np.cross(axes[1], axes[k])) > ALIGNED:
            return (
                f"axis {_told(axes[k])} of joint {names[k]!r} is not parallel to axis "
                f"{_told(axes[1])} of joint {names[1]!r}"
            )
    for k in (0, 3, 4):
        pair = f"the axes of joints {names[k]!r} and {names[k + 1]!r}"
        if abs(axes[k] @ axes[k + 1]) > ALIGNED:
            angle = np.rad2deg(np.arccos(np.clip(abs(axes[k] @ axes[k + 1]), 0.0, 1.0)))
            return f"{pair} are {angle:.3g} degrees apart, not 90"
        across = np.cross(axes[k], axes[k + 1])
        gap = abs((chain.anchors[k + 1] - chain.anchors[k]) @ across)
        if gap > MEETING:
            return f"{pair} pass each other at {gap:.3g} m and do not cross"
    for k in (1, 2):
        apart = chain.anchors[k + 1] - chain.anchors[k]
        if np.linalg.norm(np.cross(apart, axes[1])) <= MEETING:
            return f"the axes of joints {names[k]!r} and {names[k + 1]!r} are one line"
    if abs((_foot(chain, 3, 4) - _foot(chain, 0, 1)) @ axes[1]) <= MEETING:
        return (
            f"the axes of joints {names[0]!r} and {names[4]!r} meet in one plane, while the "
            "wrist must lie beside it (d4 is 0)"
        )
    return ""


def _in_family(
    chain: JointChain, points: Array, signs: Array, halves: tuple[float, float]
) -> RecognisedArm:
    """Return the arm for signs of axes 1, 2 to 4, 5 and 6, and for signs of `a2` and `a3`.

    A sign of 0 of `a2` or `a3` stands for the one with which its joint's offset is smaller.
    """
    axes = chain.axes
    up, normal, roll, out = (
        signs[0] * axes[0],
        signs[1] * axes[1],
        signs[2] * axes[4],
        signs[3] * axes[5],
    )
    shoulder, bend, wrist = points
    elbow, end = (point + ((shoulder - point) @ normal) * normal for point in chain.anchors[2:4])
    first = np.cross(up, normal)
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    a2, q2 = _link(elbow - shoulder, first, second, halves[0], 0.0)
    a3, q23 = _link(end - elbow, first, second, halves[1], q2)
    total = np.arctan2(roll @ first, -roll @ second)
    fourth = np.cos(total) * first + np.sin(total) * second
    q5 = np.arctan2(-out @ fourth, out @ normal)
    fifth = np.cos(q5) * fourth + np.sin(q5) * normal
    tool = _tool_x(chain.flange, out)
    q6 = np.arctan2(-tool @ roll, tool @ fifth)
    offsets = np.array([0.0, q2, q23 - q2, total - q23, q5, q6])
    offsets = np.arctan2(np.sin(offsets), np.cos(offsets))
    offsets[np.abs(offsets) < EXACT] = 0.0
    mount = np.eye(4)
    mount[:3, :3] = np.stack([first, np.cross(up, first), up], axis=1)
    base = chain.base[:3, 3] - chain.anchors[0]
    mount[:3, 3] = chain.anchors[0] + (base @ up) * up
    lengths = {
        "d1": (shoulder - mount[:3, 3]) @ up, "a2": a2, "a3": a3, "d4": (bend - end) @ normal,
        "d5": (wrist - bend) @ roll, "d6": (chain.flange[:3, 3] - wrist) @ out,
    }  # fmt: skip
    each = signs[[0, 1, 1, 1, 2, 3]]
    # Axes of joints 3 and 4 may point against that of joint 2.
    each[2:4] *= np.sign(axes[2:4] @ axes[1])
    rounded = {name: round(float(length), DECIMALS) + 0.0 for name, length in lengths.items()}
    return RecognisedArm(rounded, each, offsets, mount)


def _link(
    vector: Array, first: Array, second: Array, half: float, before: float
) -> tuple[float, float]:
    """Return a link's signed length and its angle from `first` towards `second`."""
    length, angle = (
        float(np.linalg.norm(vector)),
        float(np.arctan2(vector @ second, vector @ first)),
    )
    opposite = half < 0.0 if half else np.cos(angle - before) < 0.0
    return (-length, angle + np.pi) if opposite else (length, angle)


def _foot(chain: JointChain, k: int, other: int) -> Array:
    """Return the point of joint `k`'s axis that is nearest to the axis of another joint [m]."""
    axis, along = chain.axes[k], chain.axes[other]
    apart = chain.anchors[other] - chain.anchors[k]
    # The plane through the other axis and the common perpendicular has this normal.
    beside = np.cross(along, np.cross(axis, along))
    share = (apart @ beside) / (axis @ beside)
    foot: Array = chain.anchors[k] + share * axis
    return foot


def _tool_x(flange: Array, out: Array) -> Array:
    """Return the flange's first axis across `out`, or its second where the first is along it."""
    for k in (0, 1):
        across: Array = flange[:3, k] - (flange[:3, k] @ out) * out
        size = float(np.linalg.norm(across))
        if size > 0.5:
            return across / size
    raise AssertionError("two axes of a frame cannot both be along one direction")


def _points_out(chain: JointChain, d6: float, sign: float) -> bool:
    """Return whether axis 6, times a sign, points from the wrist out of the flange."""
    if abs(d6) > MEETING:
        return d6 > 0.0
    return float(sign * chain.axes[5] @ chain.flange[:3, 2]) > -ALIGNED


def _sign(length: float, otherwise: float) -> float:
    """Return the sign that makes a length positive, or another number if the length is 0."""
    number = length if abs(length) > MEETING else otherwise
    return -1.0 if number < -ALIGNED else 1.0


def _told(axis: Array) -> str:
    return "(" + ", ".join(f"{round(float(a), 4) + 0.0:g}" for a in axis) + ")"


FAMILIES: tuple[ArmFamily, ...] = (
    ArmFamily("three parallel axes, as a UR arm", 6, three_parallel),
)
"""Families of arms, in the order in which a chain is compared with them."""
