"""Where the capsules of a limb are, and how far they move (compiled).

**How far shapes move.** Each capsule end hangs on an anchor, limb base, elbow E, forearm end F or
wrist point w, and moves no farther than the anchor moves plus its distance from it times the turn
of its link. Joints 2 to 4 are parallel and across joint 1, so link k up to 4 turns by `hypot(q1, q2
+ .. + qk)`, and joint 5 adds its turn; E, F and w follow one from the other. Two links of one limb
are compared as one sees the other: only the joints between them count. On a line in joint space all
this is exact. For a limb whose flange is given (it holds, or departs along the normal)
`kinematics.turns` proves how far they turn.

On a moving base a point at distance rho from its origin moves in the world at most `v + omega rho`
more. A limb that holds is also followed from its grasp, which stands still: the flange does not
move in the world, wrist 2 turns with joint 6 alone, wrist 1 with joints 5 and 6, and so on. The
smaller bound counts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.limb_shapes import LimbCapsule, LimbModel
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Joints, Record
from mlivr_gym.kinematics.arm import Arm
from mlivr_gym.kinematics.families import grasp_motion, link_frames, link_motion
from mlivr_gym.kinematics.limb import wrap
from mlivr_gym.kinematics.poses import Pose, length, out_of
from mlivr_gym.kinematics.turns import Turns
from mlivr_gym.robot.specification import MOST_CAPSULES

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

BASE, ELBOW, FOREARM_END, WRIST_POINT = 0, 1, 2, 3
"""Anchors."""


class Shapes(Record):
    """The capsules of a limb in place."""

    ends: Annotated[Array, (MOST_CAPSULES, 2, 3)]
    """Ends of their axes [m]."""
    motion: Annotated[Array, (MOST_CAPSULES, 2)]
    """How far each end moves at most [m]."""


class Ends(Record):
    """Joint angles at both ends of an interval."""

    first: Joints
    """Those at the first [rad]."""
    last: Joints
    """Those at the second [rad]."""


class Placed(Record):
    """A limb in place in the middle of an interval, and how far it moves until its ends."""

    q: Joints
    """Joint angles in the middle [rad]."""
    minus: Joints
    """Their changes from there to the first end [rad]."""
    plus: Joints
    """Their changes to the second [rad]."""
    turns: Turns
    """How far they turn at most meanwhile [rad]."""
    proved: bool
    """Whether that is known."""
    frames: Annotated[Array, (7, 4, 3)]
    """Links in the limb base frame, see `arm.link_frames`."""
    in_body: Shapes
    """Its capsules in the body frame."""
    in_world: Shapes
    """Its capsules in the world."""
    shift: Annotated[Array, (5, 4)]
    """How far each anchor moves at most, seen from each of the links 0 to 4 [m]."""
    spin: Annotated[Array, (5, 7)]
    """How far each link turns at most, seen from each of those [rad]."""
    share: float
    """Share of `shift` and `spin` that counts."""


@kernel
def axis_of(ends: Array, c: int) -> tuple[Triple, Triple]:
    """Both ends of the axis of capsule `c`, of ends of shape (c, 2, 3)."""
    return (
        (ends[c, 0, 0], ends[c, 0, 1], ends[c, 0, 2]),
        (ends[c, 1, 0], ends[c, 1, 1], ends[c, 1, 2]),
    )


@kernel
def set_axis(ends: Array, c: int, axis: tuple[Triple, Triple]) -> None:
    """Set both ends of the axis of capsule `c`."""
    for k in range(3):
        ends[c, 0, k], ends[c, 1, k] = axis[0][k], axis[1][k]


@kernel
def place(limb: LimbModel, frames: Array, out: Shapes) -> None:
    """Put the ends of a limb's capsules in place in the body frame, by `arm.link_frames`."""
    for c in range(limb.capsule_count):
        capsule = limb.capsules[c]
        a, b = capsule_axis(capsule.ends)
        first, second = out_of_link(frames, capsule.link, a), out_of_link(frames, capsule.link, b)
        set_axis(out.ends, c, (out_of(limb.mount, first), out_of(limb.mount, second)))


@kernel
def capsule_axis(ends: Array) -> tuple[Triple, Triple]:
    """Both ends of a capsule's axis, of ends of shape (2, 3)."""
    return (ends[0, 0], ends[0, 1], ends[0, 2]), (ends[1, 0], ends[1, 1], ends[1, 2])


@kernel
def out_of_link(frames: Array, f: int, p: Triple) -> Triple:
    """Where a point [m] is in the limb base frame that link `f` sees at `p`."""
    x, y, z = p
    return (
        frames[f, 0, 0] + x * frames[f, 1, 0] + y * frames[f, 2, 0] + z * frames[f, 3, 0],
        frames[f, 0, 1] + x * frames[f, 1, 1] + y * frames[f, 2, 1] + z * frames[f, 3, 1],
        frames[f, 0, 2] + x * frames[f, 1, 2] + y * frames[f, 2, 2] + z * frames[f, 3, 2],
    )


@kernel
def place_by_angles(limb: LimbModel, placed: Placed) -> None:
    """Put the capsules of a limb in place by its joint angles."""
    link_frames(limb.arm, placed.q, placed.frames)
    place(limb, placed.frames, placed.in_body)


@kernel
def to_world(limb: LimbModel, base: Pose, in_body: Shapes, in_world: Shapes) -> None:
    """Capsule ends in the world by those in the body frame."""
    for c in range(limb.capsule_count):
        a, b = axis_of(in_body.ends, c)
        set_axis(in_world.ends, c, (out_of(base, a), out_of(base, b)))


@kernel
def changes(ends: Ends, placed: Placed) -> None:
    """Changes of joint angles from the middle to both ends, each less than half a turn."""
    for joint in range(6):
        placed.minus[joint] = wrap(ends.first[joint] - placed.q[joint])
        placed.plus[joint] = wrap(ends.last[joint] - placed.q[joint])


@kernel
def joint_motion(arm: Arm, placed: Placed) -> None:
    """Bounds of the motion of anchors and links by the turns of the joints."""
    link_motion(arm, placed.turns, placed.shift, placed.spin)


@kernel
def seen_from_link(row: int, capsule: LimbCapsule, placed: Placed) -> tuple[float, float]:
    """How far both ends of a capsule move at most, seen from link `row` [m].

    Their anchors move by `shift`, and their link turns by `spin` about them.
    """
    shift, spin, arm = placed.shift, placed.spin[row, capsule.link], capsule.arm
    return (
        placed.share * (shift[row, capsule.anchor[0]] + arm[0] * spin),
        placed.share * (shift[row, capsule.anchor[1]] + arm[1] * spin),
    )


@kernel
def capsule_motion(limb: LimbModel, placed: Placed) -> None:
    """How far each capsule end moves at most in the body frame."""
    motion = placed.in_body.motion
    for c in range(limb.capsule_count):
        motion[c, 0], motion[c, 1] = seen_from_link(0, limb.capsules[c], placed)


@kernel
def moved_by_base(limb: LimbModel, travel: float, swing: float, placed: Placed) -> None:
    """How far each capsule end moves at most in the world if the base moves [m] and turns [rad]."""
    moved, out = placed.in_body.motion, placed.in_world.motion
    for c in range(limb.capsule_count):
        a, b = axis_of(placed.in_body.ends, c)
        out[c, 0] = moved[c, 0] + travel + swing * (length(a) + moved[c, 0])
        out[c, 1] = moved[c, 1] + travel + swing * (length(b) + moved[c, 1])


@kernel
def seen_from_grasp(limb: LimbModel, placed: Placed) -> None:
    """Lower the bounds of motion in the world to those that follow a limb from its grasp."""
    motion = placed.in_world.motion
    wrist_2, wrist_1, fore, upper, end, elbow = grasp_motion(limb.arm, placed.turns)
    for c in range(limb.capsule_count):
        capsule = limb.capsules[c]
        for e in range(2):
            anchor = capsule.anchor[e]
            start, turned = elbow, upper
            if capsule.link == 6:
                start, turned = 0.0, 0.0
            elif capsule.link == 5:
                start, turned = 0.0, wrist_2
            elif capsule.link == 4:
                start, turned = end if anchor == FOREARM_END else 0.0, wrist_1
            elif capsule.link == 3:
                start, turned = end if anchor == FOREARM_END else elbow, fore
            elif capsule.link == 1 or anchor == BASE:
                continue
            motion[c, e] = min(motion[c, e], start + capsule.arm[e] * turned)


@entry
def place_in_body(robots: Any, i: int, placed: Any) -> None:
    """Put the capsules of limb `i` in place in the body frame by its joint angles.

    Rows of `Robot` and `Placed`, shape (1,).
    """
    place_by_angles(robots[0].limbs[i], placed[0])
