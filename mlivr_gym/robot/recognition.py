"""Which family of arms a chain of joints belongs to, from the axes of its joints.

A family is a row of `FAMILIES`: its recogniser takes the axes and anchors of the joints of a file
at 0 and returns the fields of a limb of the family with the signs and offsets that
turn the file's joint angles into the family's, or the reason why the chain is of another family.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.joint_chain import (
    ALIGNED,
    SAME,
    HeldJoint,
    JointChain,
    RecognisedArm,
    are_parallel,
    axis_text,
    base_sign,
    crossing_fault,
    flange_fault,
    flange_sign,
    foot,
    right_angle_fault,
    tool_x,
)
from mlivr_gym.robot.link_frames import rigid
from mlivr_gym.robot.numeric_limb import NumericLimb
from mlivr_gym.robot.recognised_ur import three_parallel
from mlivr_gym.robot.recognised_wrist import spherical_shoulder, spherical_wrist
from mlivr_gym.values import as_triple

JOINTS = 6
"""Number of joints of an arm that is solved numerically."""


class ArmFamily(NamedTuple):
    """A family of arms."""

    name: str
    """Its name in messages."""
    joints: int
    """Number of joints of its arms."""
    recognise: Callable[[JointChain], RecognisedArm | str]
    """Return the arm, or why the chain is not of this family."""
    axes: str
    """How each axis lies to the next: `x` crosses it at a right angle, `r` is at a right angle to
    it, `p` is parallel."""

    def broken(self, chain: JointChain) -> int:
        """Return how many of `axes` a chain of as many joints does not have."""
        return sum(not RELATIONS[one](chain, k) for k, one in enumerate(self.axes))


RELATIONS: dict[str, Callable[[JointChain, int], bool]] = {
    "x": lambda chain, k: not crossing_fault(chain, k, k + 1),
    "r": lambda chain, k: not right_angle_fault(chain, k, k + 1),
    "p": lambda chain, k: are_parallel(chain, k, k + 1),
}
"""Whether an axis of a chain and the next one lie so to each other, see `ArmFamily.axes`."""


def recognised(chain: JointChain) -> RecognisedArm:
    """Return an arm in the terms of the first family that it belongs to.

    An arm that is of no family with a closed form, whatever joint of it is held, is solved
    numerically. Raises a `RobotError` if that cannot be; the message has the reason for each
    family, the nearest one, and the axes.
    """
    reasons: list[str] = []
    tried: list[tuple[int, int, ArmFamily]] = []
    for family in FAMILIES:
        seen = chain if family.joints == len(chain.names) else chain.moving
        fault = _count_fault(seen, family.joints)
        if fault:
            reasons.append(f"{family.name}: {fault}")
            continue
        found = family.recognise(seen)
        if isinstance(found, RecognisedArm):
            return found
        reasons.append(f"{family.name}: {found}")
        tried.append((family.broken(seen), len(tried), family))
    others = _other_held(chain)
    if not others:
        numeric = _any_six_joints(chain.moving)
        if isinstance(numeric, RecognisedArm):
            return numeric
        reasons.append(f"solved numerically: {numeric}")
    axes = ", ".join(
        f"{name} {axis_text(axis)}" for name, axis in zip(chain.names, chain.axes, strict=True)
    )
    held = "" if chain.held is None else f" with joint {chain.names[chain.held.joint]!r} held"
    raise RobotError(
        f"the arm of joints {chain.names[0]!r} to {chain.names[-1]!r}{held} is of no supported "
        f"family ({'; '.join(reasons)}){others or _nearest(tried)}; "
        f"axes of its joints: {axes}"
    )


def _count_fault(chain: JointChain, joints: int) -> str:
    """Return why a chain has not as many joints as a form, empty if it has."""
    count = len(chain.names)
    if count == joints:
        return ""
    return f"it has {count} {'joint' if count == 1 else 'joints'}, not {joints}"


def _nearest(tried: list[tuple[int, int, ArmFamily]]) -> str:
    """Return which family has the most axes in common, of families with what they lack."""
    if not tried:
        return ""
    broken, _, family = min(tried)
    between = len(family.axes)
    return (
        f"; the nearest is {family.name!r}, as which {between - broken} of {between} pairs of "
        "successive axes lie"
    )


def _other_held(chain: JointChain) -> str:
    """Return with which other joints held at 0 an arm is of a family; empty if with none."""
    if chain.held is None:
        return ""
    found: dict[str, list[str]] = {}
    for k, name in enumerate(chain.names):
        if k == chain.held.joint:
            continue
        other = chain._replace(held=HeldJoint(k, 0.0, (-np.pi, np.pi)))
        for family in FAMILIES:
            seen = other if family.joints == len(other.names) else other.moving
            if family.joints == len(seen.names) and not isinstance(family.recognise(seen), str):
                found.setdefault(family.name, []).append(repr(name))
                break
    return "".join(
        f"; with held_joint {' or '.join(names)} it is of the family {family!r}"
        for family, names in found.items()
    )


def _any_six_joints(chain: JointChain) -> RecognisedArm | str:
    """Return the arm, or why it cannot be solved.

    The frame of each link lies at the file's zero, its origin as near to the one before as it may.
    """
    fault = _count_fault(chain, JOINTS)
    if fault:
        return fault
    if are_parallel(chain, 4, 5):
        return f"the axes of joints {chain.names[4]!r} and {chain.names[5]!r} are parallel"
    wrist = foot(chain, 5, 4)
    fault = flange_fault(chain, wrist)
    if fault:
        return fault
    signs = np.ones(JOINTS)
    shoulder = foot(chain, 0, 1) if not are_parallel(chain, 0, 1) else chain.anchors[0]
    signs[0], signs[5] = base_sign(chain, shoulder), flange_sign(chain, wrist)
    axes = signs[:, None] * chain.axes
    mount = _frame(tool_x(chain.base, axes[0]), axes[0], shoulder)
    base = float((chain.base[:3, 3] - shoulder) @ axes[0])
    mount[:3, 3] = shoulder + base * axes[0]
    frames = [mount, _frame(mount[:3, 0], axes[0], shoulder)]
    for k in range(1, 5):
        before = frames[-1]
        share = (before[:3, 3] - chain.anchors[k]) @ axes[k]
        origin = chain.anchors[k] + share * axes[k]
        if k == 1 and not are_parallel(chain, 0, 1):
            origin = foot(chain, 1, 0)
        x = np.cross(axes[k - 1], axes[k])
        size = float(np.linalg.norm(x))
        frames.append(_frame(x / size if size > ALIGNED else before[:3, 0], axes[k], origin))
    frames.append(_frame(tool_x(chain.flange, axes[5]), axes[5], chain.flange[:3, 3]))
    origins, quaternions = [], []
    for before, after in itertools.pairwise(frames):
        step = np.linalg.inv(before) @ after
        step[np.abs(step) < SAME] = 0.0
        origins.append(as_triple(step[:3, 3]))
        quaternions.append(_quaternion(step[:3, :3]))
    fields: dict[str, Any] = {"origins": tuple(origins), "quaternions": tuple(quaternions)}
    try:
        NumericLimb(**fields, joint_limits=((-np.pi, np.pi),) * JOINTS)
    except RobotError as error:
        return str(error)
    return RecognisedArm(NumericLimb, fields, signs, np.zeros(JOINTS), mount)


def _frame(x: Array, z: Array, origin: Array) -> Array:
    """Return the frame of an origin, its z axis, and an x axis that is made to be across it."""
    across = x - (x @ z) * z
    across = across / np.linalg.norm(across)
    return rigid(np.stack([across, np.cross(z, across), z], axis=1), origin)


def _quaternion(rotation: Array) -> tuple[float, ...]:
    """Return the quaternion w, x, y, z of a rotation."""
    turn = Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True)
    w, x, y, z = (turn + 0.0).tolist()
    return w, x, y, z


FAMILIES: tuple[ArmFamily, ...] = (
    ArmFamily("three parallel axes, as a UR arm", 6, three_parallel, "xppxx"),
    ArmFamily("spherical shoulder and wrist, as an iiwa", 7, spherical_wrist, "xxrrxx"),
    ArmFamily("spherical shoulder, as a Franka", 7, spherical_shoulder, "xxrrxr"),
    ArmFamily("spherical wrist", 6, spherical_wrist, "rprxx"),
    ArmFamily("spherical shoulder of six joints", 6, spherical_shoulder, "xxrpr"),
)
"""Families of arms, in the order in which a chain is compared with them."""
