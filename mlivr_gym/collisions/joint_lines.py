"""Places of the robot on a line in joint space, and how far shapes travel from there (compiled).

Every motion is made of pieces on which the joint angles of limbs change linearly. The base rests;
or it moves straight, and the limbs that hold follow it, see `collisions.following`.

**Travel.** A point that a chain of joints carries is `p = T_1 .. T_n x`. Let joint j be turned by
`d_j` against the middle of a piece. The difference of p from its place in the middle telescopes:
term j changes joint j alone, with the joints before it as they are, which keeps lengths, and those
after it as in the middle. So p is displaced by at most `sum |d_j| r_j`, where `r_j` is its distance
from axis j, **both in the middle**. The sum over the joints between two links bounds the
displacement of a point of one as seen from the other; that over the joints of a limb that holds
from its grasp on bounds it in the world. It is the bound of Schwarzer, Saha and Latombe (IEEE
Transactions on Robotics 21, 2005), with the radii of the present place.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.base_path import BasePath
from mlivr_gym.collisions.following import (
    Following,
    JointAxesSeen,
    bound_changes,
    invert_jacobian,
)
from mlivr_gym.collisions.limb_shapes import LimbModel
from mlivr_gym.collisions.placement import Shapes, axis_of, place
from mlivr_gym.compiled.bit_sets import EMPTY, EVERY, has, only
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Joints, Record, Rows, Vector
from mlivr_gym.kinematics.chain import LIMIT_TOLERANCE, in_window, link_frames
from mlivr_gym.kinematics.limb import Angles, posture_at
from mlivr_gym.kinematics.poses import Pose, cross, into, length, minus, out_of, vector
from mlivr_gym.robot.sizes import MOST_LIMBS

if TYPE_CHECKING:
    from mlivr_gym.values import Triple


class JointLine(Record):
    """A line in joint space of the limbs that take part, and the base."""

    moves: bool
    """Whether the base moves; else it rests."""
    path: BasePath
    """Its straight way, if it moves."""
    follows: int
    """Set of the limbs that hold and follow it."""
    held: Annotated[Rows[Pose], (MOST_LIMBS,)]
    """Flanges of these in the world, with flip 0."""
    branch: Annotated[IntArray, (MOST_LIMBS,), np.int64]
    """Branches of these."""
    flips: Annotated[IntArray, (MOST_LIMBS,), np.int64]
    """Sets of their flips, from which the check takes those that leave the window of joint 6."""
    base: Pose
    """Base in the world while it rests."""
    first: Annotated[Rows[Angles], (MOST_LIMBS,)]
    """Joint angles at the start."""
    last: Annotated[Rows[Angles], (MOST_LIMBS,)]
    """Joint angles at the end."""


class LimbPlace(Record):
    """A limb in the middle of an interval of a line, with bounds of its travel to either end."""

    flips: int
    """Of a limb that follows: set of the flips, 0 and 1, with which joint 6 is in its window."""
    joints: JointAxesSeen
    """Joint axes in the body frame."""
    q: Joints
    """Joint angles [rad]."""
    change: Joints
    """How far each joint turns from the middle to either end [rad]."""
    frames: Annotated[Array, (7, 4, 3)]
    """Link frames in the limb base frame, see `chain.link_frames`."""
    in_body: Shapes
    """Capsules in the body frame, with their travel as seen from the body."""


class BaseMove(Record):
    """How a base that moves straight moves, over its whole way, in its axes at one place of it."""

    shift: Vector
    """Shift [m]."""
    turn: Vector
    """Turn about its axis [rad]."""
    varies: float
    """Speed at which the turn of the axes changes the shift [m]."""


@kernel
def place_limb(
    limb: LimbModel, line: JointLine, middle: float, half: float, capsules: int, to: LimbPlace
) -> None:
    """Place a limb at a fraction of a line, with those of its capsules that are in a set.

    Their travel is bounded as seen from the body.
    """
    first, last = line.first[limb.index].q, line.last[limb.index].q
    for j in range(6):
        to.q[j] = first[j] + middle * (last[j] - first[j])
        to.change[j] = half * abs(last[j] - first[j])
    link_frames(limb.arm, to.q, to.frames)
    _set_axes(limb, to)
    place_capsules(limb, capsules, to)


@kernel
def place_capsules(limb: LimbModel, capsules: int, to: LimbPlace) -> None:
    """Place those capsules of a limb that are in a set, and bound their travel."""
    place(limb, capsules, to.frames, to.in_body.ends)
    for c in range(limb.capsule_count):
        if has(capsules, c):
            axis, link = axis_of(to.in_body.ends, c), limb.capsules[c].link
            for e in range(2):
                to.in_body.motion[c, e] = travel(to, 0, link, axis[e])


@kernel
def _set_axes(limb: LimbModel, to: LimbPlace) -> None:
    """Compute joint axes of a limb from the frames of its links."""
    for j in range(6):
        o = vector(to.frames[j + 1, 0])
        point = out_of(limb.mount, o)
        axis = minus(out_of(limb.mount, vector(to.frames[j + 1, 3])), vector(limb.mount.position))
        for k in range(3):
            to.joints.axis[j, k], to.joints.point[j, k] = axis[k], point[k]


@kernel
def travel(placed: LimbPlace, first: int, stop: int, p: Triple) -> float:
    """Bound how far joints `first` to `stop` - 1 of a limb, counted from 0, move a point [m]."""
    total, joints = 0.0, placed.joints
    for j in range(first, stop):
        if placed.change[j] > 0.0:
            away = cross(vector(joints.axis[j]), minus(p, vector(joints.point[j])))
            total += placed.change[j] * length(away)
    return total


@kernel
def place_follower(
    limb: LimbModel, line: JointLine, base: Pose, floor: float, proof: Following, to: LimbPlace
) -> bool:
    """Place a limb that holds and follows the base; return whether it can hold there.

    That is on its branch, with `|det J|` above a floor [m^3] and the joints in their windows.
    """
    to.flips = hold(limb, line, base, to.q, to.frames)
    for j in range(6):
        to.change[j] = 0.0
    if to.flips == EMPTY:
        return False
    _set_axes(limb, to)
    determinant = invert_jacobian(to.joints, proof)
    return bool(determinant > 0.0 and determinant >= floor)


@kernel
def hold(limb: LimbModel, line: JointLine, base: Pose, q: Joints, frames: Array) -> int:
    """Compute joint angles and link frames of a limb that holds, with flip 0, on its branch.

    Returned are the flips with which all joints are in their windows.
    """
    i, window, flips = limb.index, limb.arm.window, EMPTY
    if not posture_at(limb, base, line.held[i], line.branch[i], q, frames):
        return EMPTY
    for j in range(6):
        q[j] = in_window(q[j], window[j, 0])
        if j < 5 and q[j] > window[j, 1] + LIMIT_TOLERANCE:
            return EMPTY
    for flip in range(2):
        if in_window(q[5] + np.pi * flip, window[5, 0]) <= window[5, 1] + LIMIT_TOLERANCE:
            flips |= only(flip)
    return flips


@kernel
def prove_follower(
    limb: LimbModel, move: BaseMove, half: float, proof: Following, to: LimbPlace
) -> bool:
    """Bound the turns of a placed limb that follows the base over an interval.

    Its inverse Jacobian is in `proof`. Returned is whether it is proved that a solution follows on
    all of the interval.
    """
    shift, turn = vector(move.shift), vector(move.turn)
    if not bound_changes(half, shift, turn, to.joints, proof, to.change):
        return False
    place_capsules(limb, EVERY, to)
    return True


@kernel
def may_leave(limb: LimbModel, flips: int, place: LimbPlace) -> int:
    """Return the joints that may leave their windows on an interval, with some flip of a set."""
    window, leaving = limb.arm.window, EMPTY
    for j in range(6):
        for flip in range(2):
            q = place.q[j]
            if j == 5:
                q = in_window(q + np.pi * flip, window[5, 0])
            low, high = q - place.change[j], q + place.change[j]
            leaves = low < window[j, 0] - LIMIT_TOLERANCE or high > window[j, 1] + LIMIT_TOLERANCE
            if leaves and (j < 5 or has(flips, flip)):
                leaving |= only(j)
    return leaving


@kernel
def reached(limb: LimbModel, flips: int, place: LimbPlace, q: Joints) -> int:
    """Return those flips of a set with which angles at an end are reached inside the windows.

    They are the angles in the windows, with flip 0; if a joint has left its window since the
    middle, that is another winding, farther away than the joint turns.
    """
    low = limb.arm.window[5, 0]
    for j in range(5):
        if abs(q[j] - place.q[j]) > place.change[j] + LIMIT_TOLERANCE:
            return EMPTY
    for flip in range(2):
        first, last = place.q[5] + np.pi * flip, q[5] + np.pi * flip
        away = abs(in_window(last, low) - in_window(first, low))
        if away > place.change[5] + LIMIT_TOLERANCE:
            flips &= ~only(flip)
    return flips


@kernel
def turn_monotonically(joints: int, half: float, proof: Following, place: LimbPlace) -> bool:
    """Return whether each joint of a set turns one way on an interval: to where it is at an end."""
    monotone = True
    for j in range(6):
        if has(joints, j):
            monotone = monotone and place.change[j] < 2.0 * half * abs(proof.rate[j])
    return monotone


@kernel
def set_move(line: JointLine, base: Pose, move: BaseMove) -> None:
    """Set how a base that moves straight moves at a place on its way."""
    path = line.path
    shift = into(base, minus(vector(path.last.position), vector(path.first.position)))
    for k in range(3):
        move.shift[k], move.turn[k] = shift[k], path.angle * path.axis[k]
    move.varies = length(cross(vector(move.turn), shift))


@kernel
def base_travel(move: BaseMove, half: float, p: Triple) -> float:
    """Bound how far a point of the body travels with a base that moves straight [m].

    Seen from the body its velocity is the shift, which turns, plus that of the turn, which rests.
    """
    shift, turned = vector(move.shift), cross(vector(move.turn), p)
    speed = length((shift[0] + turned[0], shift[1] + turned[1], shift[2] + turned[2]))
    return half * (speed + half * move.varies)
