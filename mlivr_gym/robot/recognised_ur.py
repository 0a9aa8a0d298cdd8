"""Arms of the UR form in files: three parallel axes between axes at right angles to them."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.robot.joint_chain import (
    ALIGNED,
    EXACT,
    MEETING,
    JointChain,
    RecognisedArm,
    are_parallel,
    axis_text,
    base_sign,
    crossing_fault,
    flange_fault,
    flange_sign,
    foot,
    mount_on,
    rounded,
    sign_of,
    tool_x,
)
from mlivr_gym.robot.limb import Limb


def three_parallel(chain: JointChain) -> RecognisedArm | str:
    """Return a chain as an arm of the UR form, or why it is none.

    Its axes 2, 3 and 4 are parallel, axes 1, 2 and 4, 5 and 5, 6 are perpendicular and cross. With
    `n` the common direction of axes 2 to 4, a length `d` is measured along the axis before it, and
    `a2`, `a3` across `n`. Signs are those of the file if its zero angles are those of the standard
    DH convention, else those of the UR arms: `a2`, `a3` negative and the others not.
    """
    reason = _fault(chain)
    if reason:
        return reason
    shoulder = foot(chain, 0, 1)
    bend = foot(chain, 3, 4)
    wrist = foot(chain, 4, 5)
    reason = flange_fault(chain, wrist)
    if reason:
        return reason
    points = np.array([shoulder, bend, wrist])
    literal = _in_family(chain, points, np.array([1.0, 1.0, 1.0, 1.0]), (0.0, 0.0))
    if not np.abs(literal.zeros).max() and _points_out(chain, literal.fields["d6"], 1.0):
        return literal
    normal = chain.axes[1]
    signs = np.array([
        base_sign(chain, shoulder),
        sign_of((bend - shoulder) @ normal, 1.0),
        sign_of((wrist - bend) @ chain.axes[4], 1.0),
        flange_sign(chain, wrist),
    ])  # fmt: skip
    return _in_family(chain, points, signs, (-1.0, -1.0))


def _fault(chain: JointChain) -> str:
    """Return in which respect axes are not those of the UR form, empty if they are."""
    names, axes = chain.names, chain.axes
    for k in (2, 3):
        if not are_parallel(chain, 1, k):
            return (
                f"axis {axis_text(axes[k])} of joint {names[k]!r} is not parallel to axis "
                f"{axis_text(axes[1])} of joint {names[1]!r}"
            )
    for k in (0, 3, 4):
        fault = crossing_fault(chain, k, k + 1)
        if fault:
            return fault
    for k in (1, 2):
        apart = chain.anchors[k + 1] - chain.anchors[k]
        if np.linalg.norm(np.cross(apart, axes[1])) <= MEETING:
            return f"the axes of joints {names[k]!r} and {names[k + 1]!r} are one line"
    if abs((foot(chain, 3, 4) - foot(chain, 0, 1)) @ axes[1]) <= MEETING:
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
    tool = tool_x(chain.flange, out)
    q6 = np.arctan2(-tool @ roll, tool @ fifth)
    offsets = np.array([0.0, q2, q23 - q2, total - q23, q5, q6])
    offsets = np.arctan2(np.sin(offsets), np.cos(offsets))
    offsets[np.abs(offsets) < EXACT] = 0.0
    mount = mount_on(chain, first, up)
    lengths = {
        "d1": (shoulder - mount[:3, 3]) @ up, "a2": a2, "a3": a3, "d4": (bend - end) @ normal,
        "d5": (wrist - bend) @ roll, "d6": (chain.flange[:3, 3] - wrist) @ out,
    }  # fmt: skip
    each = signs[[0, 1, 1, 1, 2, 3]]
    # Axes of joints 3 and 4 may point against that of joint 2.
    each[2:4] *= np.sign(axes[2:4] @ axes[1])
    fields = {name: rounded(length) for name, length in lengths.items()}
    return RecognisedArm(Limb, fields, each, offsets, mount)


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


def _points_out(chain: JointChain, d6: float, sign: float) -> bool:
    """Return whether axis 6, times a sign, points from the wrist out of the flange."""
    if abs(d6) > MEETING:
        return d6 > 0.0
    return float(sign * chain.axes[5] @ chain.flange[:3, 2]) > -ALIGNED
