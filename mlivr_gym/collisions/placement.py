"""Where the capsules of a limb are, and bounds of how far they move (compiled).

**Bounds of motion.** Each capsule end has an anchor: the limb base, the elbow E, the forearm end F
or the wrist point W. It moves at most as far as the anchor moves, plus its distance from the anchor
times the rotation of its link. Joints 2 to 4 are parallel to each other and perpendicular to joint
1, so link k up to 4 rotates by `hypot(q1, q2 + .. + qk)`, and joint 5 adds its rotation; the bounds
of E, F and W follow from each other in this order. When two links of one limb are compared, the
motion of one is bounded as seen from the other: only the joints between them count. On a line in
joint space these rotations are exact. For a limb with a given flange motion (it holds a point, or
departs along the normal) `kinematics.turns` proves bounds of its joint rotations.

On a moving base a point at distance rho from the base origin moves in the world by at most `v +
omega rho` more. For a limb that holds, a second bound starts at its grasp, which stands still: the
flange does not move in the world, wrist 2 rotates with joint 6 alone, wrist 1 with joints 5 and 6,
and so on. The smaller of the two bounds is used.
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
"""Anchors of capsule ends: limb base, elbow, forearm end and wrist point."""

ROUNDING = 1e-6
"""How far a joint may turn beyond its bound by rounding [rad]."""


class Shapes(Record):
    """The capsules of a limb at one configuration."""

    ends: Annotated[Array, (MOST_CAPSULES, 2, 3)]
    """Ends of their axes [m]."""
    motion: Annotated[Array, (MOST_CAPSULES, 2)]
    """Upper bound of how far each end moves [m]."""


class IntervalAngles(Record):
    """Joint angles of a limb at both ends of an interval."""

    first: Joints
    """Joint angles at the start [rad]."""
    last: Joints
    """Joint angles at the end [rad]."""


class Placed(Record):
    """A limb at the midpoint of an interval, with bounds of its motion from there to either end."""

    q: Joints
    """Joint angles at the midpoint [rad]."""
    to_first: Joints
    """Changes of the joint angles from the midpoint to the start [rad]."""
    to_last: Joints
    """Changes of the joint angles from the midpoint to the end [rad]."""
    turns: Turns
    """Upper bounds of the joint rotations from the midpoint to either end [rad]."""
    is_bounded: bool
    """Whether these bounds are proved."""
    frames: Annotated[Array, (7, 4, 3)]
    """Link frames in the limb base frame, see `families.link_frames`."""
    in_body: Shapes
    """Its capsules in the body frame."""
    in_world: Shapes
    """Its capsules in the world frame."""
    anchor_travel: Annotated[Array, (5, 4)]
    """Upper bound of the displacement of each anchor, as seen from each of the links 0 to 4 [m]."""
    link_turn: Annotated[Array, (5, 7)]
    """Upper bound of the rotation of each link, as seen from each of the links 0 to 4 [rad]."""
    fraction: float
    """Factor to apply to both; it is below 1 where they bound the whole of a swing."""


@kernel
def axis_of(ends: Array, c: int) -> tuple[Triple, Triple]:
    """Return both ends of the axis of capsule `c` from ends of shape (c, 2, 3)."""
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
    """Compute the capsule ends of a limb in the body frame from its link frames."""
    for c in range(limb.capsule_count):
        capsule = limb.capsules[c]
        a, b = capsule_axis(capsule.ends)
        first, second = out_of_link(frames, capsule.link, a), out_of_link(frames, capsule.link, b)
        set_axis(out.ends, c, (out_of(limb.mount, first), out_of(limb.mount, second)))


@kernel
def capsule_axis(ends: Array) -> tuple[Triple, Triple]:
    """Return both ends of a capsule's axis from an array of shape (2, 3)."""
    return (ends[0, 0], ends[0, 1], ends[0, 2]), (ends[1, 0], ends[1, 1], ends[1, 2])


@kernel
def out_of_link(frames: Array, f: int, p: Triple) -> Triple:
    """Return a point of the frame of link `f` in the limb base frame [m]."""
    x, y, z = p
    return (
        frames[f, 0, 0] + x * frames[f, 1, 0] + y * frames[f, 2, 0] + z * frames[f, 3, 0],
        frames[f, 0, 1] + x * frames[f, 1, 1] + y * frames[f, 2, 1] + z * frames[f, 3, 1],
        frames[f, 0, 2] + x * frames[f, 1, 2] + y * frames[f, 2, 2] + z * frames[f, 3, 2],
    )


@kernel
def place_by_angles(limb: LimbModel, placed: Placed) -> None:
    """Compute the capsule ends of a limb in the body frame from its joint angles."""
    link_frames(limb.arm, placed.q, placed.frames)
    place(limb, placed.frames, placed.in_body)


@kernel
def place_in_world(limb: LimbModel, base: Pose, in_body: Shapes, in_world: Shapes) -> None:
    """Compute the capsule ends of a limb in the world frame from those in the body frame."""
    for c in range(limb.capsule_count):
        a, b = axis_of(in_body.ends, c)
        set_axis(in_world.ends, c, (out_of(base, a), out_of(base, b)))


@kernel
def are_changes_bounded(ends: IntervalAngles, placed: Placed) -> bool:
    """Set the changes of the joint angles from midpoint to both ends, each below half a turn.

    Returned is whether each is within the bound of its turn. It is unless the angles at an end are
    those of another solution, see `kinematics.numeric`.
    """
    turns, excess = placed.turns, -np.inf
    for joint, most in enumerate((turns.q1, turns.q2, turns.q3, turns.q4, turns.q5, turns.q6)):
        before = wrap(ends.first[joint] - placed.q[joint])
        after = wrap(ends.last[joint] - placed.q[joint])
        placed.to_first[joint], placed.to_last[joint] = before, after
        excess = max(excess, max(abs(before), abs(after)) - most)
    return excess <= ROUNDING


@kernel
def split_angles(first: IntervalAngles, second: IntervalAngles, placed: Placed) -> None:
    """Set the joint angles at the ends of both halves, from those of the whole in `first`."""
    for k in range(6):
        second.first[k], second.last[k] = placed.q[k], first.last[k]
        first.last[k] = placed.q[k]


@kernel
def bound_links(arm: Arm, placed: Placed) -> None:
    """Bound the displacements of anchors and rotations of links by the joint rotations."""
    link_motion(arm, placed.turns, placed.anchor_travel, placed.link_turn)


@kernel
def motion_from_link(row: int, capsule: LimbCapsule, placed: Placed) -> tuple[float, float]:
    """Return upper bounds of how far both ends of a capsule move, as seen from link `row` [m]."""
    travel, turn = placed.anchor_travel, placed.link_turn[row, capsule.link]
    anchors, distances = capsule.anchors, capsule.anchor_distances
    return (
        placed.fraction * (travel[row, anchors[0]] + distances[0] * turn),
        placed.fraction * (travel[row, anchors[1]] + distances[1] * turn),
    )


@kernel
def bound_capsules(limb: LimbModel, placed: Placed) -> None:
    """Bound how far each capsule end of a limb moves in the body frame."""
    motion = placed.in_body.motion
    for c in range(limb.capsule_count):
        motion[c, 0], motion[c, 1] = motion_from_link(0, limb.capsules[c], placed)


@kernel
def bound_in_world(limb: LimbModel, travel: float, turn: float, placed: Placed) -> None:
    """Bound how far each capsule end moves in the world while the base also moves.

    The base travels by `travel` [m] and rotates by `turn` [rad] at most.
    """
    moved, out = placed.in_body.motion, placed.in_world.motion
    for c in range(limb.capsule_count):
        a, b = axis_of(placed.in_body.ends, c)
        out[c, 0] = moved[c, 0] + travel + turn * (length(a) + moved[c, 0])
        out[c, 1] = moved[c, 1] + travel + turn * (length(b) + moved[c, 1])


@kernel
def bound_from_grasp(limb: LimbModel, placed: Placed) -> None:
    """Lower the bounds of motion in the world to those that follow a limb from its grasp."""
    motion = placed.in_world.motion
    wrist_2, wrist_1, fore, upper, end, elbow = grasp_motion(limb.arm, placed.turns)
    for c in range(limb.capsule_count):
        capsule = limb.capsules[c]
        for e in range(2):
            anchor = capsule.anchors[e]
            travel, turn = elbow, upper
            if capsule.link == 6:
                travel, turn = 0.0, 0.0
            elif capsule.link == 5:
                travel, turn = 0.0, wrist_2
            elif capsule.link == 4:
                travel, turn = end if anchor == FOREARM_END else 0.0, wrist_1
            elif capsule.link == 3:
                travel, turn = end if anchor == FOREARM_END else elbow, fore
            elif capsule.link == 1 or anchor == BASE:
                continue
            motion[c, e] = min(motion[c, e], travel + capsule.anchor_distances[e] * turn)


@entry
def place_in_body(robots: Any, i: int, placed: Any) -> None:
    """Compute the capsule ends of limb `i` in the body frame from its joint angles.

    `robots` is a record of `RobotModel` and `placed` a record of `Placed`, each of shape (1,).
    """
    place_by_angles(robots[0].limbs[i], placed[0])
