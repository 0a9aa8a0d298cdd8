"""Where the robot is on an interval of a line, and whether limbs that hold follow there (compiled).

Limbs are placed in the middle of the interval. Of a base that moves straight they are placed once
for each interval, and that they follow is proved once, whatever they are then compared with.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.against_boxes import GraspSurface
from mlivr_gym.collisions.base_path import pose_on_path
from mlivr_gym.collisions.compared import Compared, LineInterval, RestingLimbs
from mlivr_gym.collisions.distances import CLEAR, SELF, UNDECIDED
from mlivr_gym.collisions.following import Following, invert_jacobian
from mlivr_gym.collisions.joint_lines import (
    BaseMove,
    JointLine,
    LimbPlace,
    hold,
    may_leave,
    place_capsules,
    place_follower,
    place_limb,
    prove_follower,
    reached,
    set_move,
    turn_monotonically,
)
from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.compiled.bit_sets import BRANCHES, EMPTY, EVERY, has
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Joints, Record, Rows
from mlivr_gym.kinematics.forms import NUMERIC
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.robot.sizes import MOST_CAPSULES, MOST_LIMBS

MOST_HALVINGS = 10
"""An undecided interval of half length `2^-MOST_HALVINGS` of a line counts as a collision."""

STORED = 32
"""Intervals with smaller numbers are stored for each limb and branch, of a base that moves
straight."""

PLACES = MOST_LIMBS * (1 + BRANCHES * STORED)
"""Number of places of limbs: one of each limb, and those that are stored."""

UNKNOWN, PLACED, PROVED, NOT_PROVED, GONE = range(5)
"""What is known of a limb in a stored interval: nothing; its place in the middle; that it follows
on all of it; that this is not proved; that it cannot hold in the middle."""


class LineScratch(Record):
    """A line, what is compared on it, and the scratch of its check."""

    line: JointLine
    compared: Compared
    surface: GraspSurface
    """The grasp at which the gripper of the first limb is, if any."""
    resting: RestingLimbs
    """The limbs at rest."""
    placed: Annotated[Rows[LimbPlace], (PLACES,)]
    """Limbs in the middles of intervals."""
    at: Annotated[IntArray, (MOST_LIMBS,), np.int64]
    """For each limb, where its place in the present interval is among them."""
    known: Annotated[IntArray, (MOST_LIMBS * BRANCHES, STORED), np.int8]
    """What is known of limbs on each branch in stored intervals."""
    floor: float
    """Least `|det J|` of limbs that follow, in the middles of intervals [m^3]."""
    proof: Following
    """Proof that a limb follows."""
    base: Pose
    """Base in the present interval."""
    end: Pose
    """Base at an end of it."""
    q: Joints
    """Joint angles there [rad]."""
    frames: Annotated[Array, (7, 4, 3)]
    """Link frames there, see `chain.link_frames`."""
    travel: Annotated[Array, (MOST_CAPSULES, 2)]
    """How far the capsules of a limb travel in the world at most [m]."""
    move: BaseMove
    """How it moves straight there."""
    intervals: Annotated[Rows[LineInterval], (MOST_HALVINGS + 2,)]
    """Stack of intervals."""
    pending: LineInterval
    """The comparisons that remain for all of several lines."""


@kernel
def place_robot(robot: RobotModel, interval: LineInterval, scratch: LineScratch) -> int:
    """Place the limbs and the base that an interval needs.

    Returns `CLEAR`; `UNDECIDED` if it is not proved that all limbs that follow do so on all of it;
    `SELF` if one of them cannot hold in its middle.
    """
    line, compared, base = scratch.line, scratch.compared, scratch.base
    in_world = interval.base
    for i in range(robot.limb_count):
        in_world = in_world or interval.boxes[i] != 0
    if line.moves:
        pose_on_path(line.path, interval.middle, base)
        set_move(line, base, scratch.move)
    elif in_world:
        for k in range(3):
            base.position[k] = line.base.position[k]
            for c in range(3):
                base.rotation[k, c] = line.base.rotation[k, c]
    result = CLEAR
    for i in range(robot.limb_count):
        # All capsules of a limb are needed where others are compared with them.
        capsules = interval.boxes[i] | interval.body[i]
        if interval.itself[i] or (interval.limbs and i in (compared.first, compared.second)):
            capsules = EVERY
        if capsules or has(compared.placed, i):
            result = max(result, _place_limb(i, robot, interval, capsules, scratch))
            if result > UNDECIDED:
                return result
    return result


@kernel
def _place_limb(
    i: int, robot: RobotModel, interval: LineInterval, capsules: int, scratch: LineScratch
) -> int:
    """Place a limb in the middle of an interval, unless it is stored; see `place_robot`."""
    line, limb, number = scratch.line, robot.limbs[i], interval.number
    scratch.at[i] = i
    if not line.moves:
        place_limb(limb, line, interval.middle, interval.half, capsules, scratch.placed[i])
        return CLEAR
    follows = has(line.follows, i)
    slot, known = i * BRANCHES + (line.branch[i] if follows else 0), UNKNOWN
    if number < STORED:
        scratch.at[i] = MOST_LIMBS + slot * STORED + number
        known = scratch.known[slot, number]
    place = scratch.placed[scratch.at[i]]
    if known == PLACED and follows:
        invert_jacobian(place.joints, scratch.proof)
    elif known == UNKNOWN:
        known = PLACED
        if not follows:
            place_limb(limb, line, interval.middle, interval.half, EVERY, place)
        elif not place_follower(limb, line, scratch.base, scratch.floor, scratch.proof, place):
            known = GONE
        elif interval.half == 0.0:
            place_capsules(limb, EVERY, place)
    if follows:
        line.flips[i] &= place.flips
        if known == GONE or line.flips[i] == EMPTY:
            known = GONE
        elif known == PLACED and interval.half > 0.0:
            known = _follow(limb, interval, place, scratch)
    if number < STORED:
        scratch.known[slot, number] = known
    if known == GONE:
        return SELF
    return UNDECIDED if known == NOT_PROVED else CLEAR


@kernel
def _follow(limb: LimbModel, interval: LineInterval, place: LimbPlace, scratch: LineScratch) -> int:
    """Prove that a placed limb follows on all of an interval; return what is then known of it.

    Where a joint may leave its window, the ends of the interval decide, or its halves.
    """
    line, half, i = scratch.line, interval.half, limb.index
    if not prove_follower(limb, scratch.move, half, scratch.proof, place):
        return NOT_PROVED
    # The branches of arms that are solved numerically are named at each place anew.
    if limb.arm.form.kind != NUMERIC and may_leave(limb, line.flips[i], place) == EMPTY:
        return PROVED
    for side in range(2):
        pose_on_path(line.path, interval.middle + (2 * side - 1) * half, scratch.end)
        line.flips[i] &= hold(limb, line, scratch.end, scratch.q, scratch.frames)
        if line.flips[i]:
            line.flips[i] = reached(limb, line.flips[i], place, scratch.q)
    if line.flips[i] == EMPTY:
        return GONE
    leaving = may_leave(limb, line.flips[i], place)
    return PROVED if turn_monotonically(leaving, half, scratch.proof, place) else NOT_PROVED
