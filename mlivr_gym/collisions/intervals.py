"""The check whether the robot keeps the clearance on a line in joint space (compiled).

An interval of the line is checked in its middle: the shapes are placed there, and each distance is
compared with the radii and the clearance, and with these plus how far the shapes may travel from
the middle to either end, see `joint_lines`. What is farther apart than the latter is clear on the
whole interval, however thin it is; what is closer than the former is a collision. What is left
undecided is compared again on both halves, down to `2^-MOST_HALVINGS` of the line, where it counts
as a collision. So is an interval on which it is not proved that a limb that holds follows the base.

This one check serves all motions: departures, changes between folds, swings, and supports that
carry the base or follow it. Of a base that moves straight, limbs are placed once in the middle of
each interval, whatever they are then compared with.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.against_boxes import (
    GraspSurface,
    compare_with_grid,
)
from mlivr_gym.collisions.against_robot import (
    compare_limb_with_body,
    compare_limb_with_itself,
    compare_limbs,
)
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.compared import (
    Compared,
    LineInterval,
    RestingLimbs,
    begin_comparing,
    copy_pending,
)
from mlivr_gym.collisions.distances import CLEAR, SELF, UNDECIDED
from mlivr_gym.collisions.joint_lines import (
    STRAIGHT,
    BaseMove,
    JointLine,
    LimbPlace,
    carried,
    hold,
    may_leave,
    place_base,
    place_capsules,
    place_follower,
    place_limb,
    prove_follower,
    reached,
    set_move,
    travel,
    turn_one_way,
)
from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.collisions.placement import axis_of, capsule_axis
from mlivr_gym.compiled.bit_sets import BRANCHES, EMPTY, EVERY, has, only
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.compiled.records import Joints, Record, Rows
from mlivr_gym.kinematics.base_path import pose_on_path
from mlivr_gym.kinematics.following import Following, invert_jacobian
from mlivr_gym.kinematics.forms import NUMERIC
from mlivr_gym.kinematics.poses import Pose, length, minus, out_of, vector
from mlivr_gym.robot.specification import MOST_LIMBS

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

MOST_HALVINGS = 10
"""An undecided interval of `2^-MOST_HALVINGS` of a line counts as a collision."""

FIRST_TURN = 4.0
"""Sum of the turns of a limb up to which a line is one interval at first [rad]; affects the speed
only."""

FIRST_SHIFT = 0.5
"""Shift of a base that moves straight up to which its way is one interval at first [m], likewise a
turn of one radian; affects the speed only."""

HALFWAY = 3
"""Link from which on the travel of a limb that follows is bounded from its grasp, and not from the
body."""

FAR = 0.35
"""Travel from which on an interval is halved in any case [m]; affects the speed only."""


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
    """Least `|det J|` of limbs that follow [m^3]."""
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
    move: BaseMove
    """How it moves straight there."""
    intervals: Annotated[Rows[LineInterval], (MOST_HALVINGS + 2,)]
    """Stack of intervals."""
    pending: LineInterval
    """The comparisons that remain for all of several lines."""
    is_leader: bool
    """Whether it was the base or its leader, without the other limbs, that was not clear."""


@kernel
def check_line(robot: RobotModel, grid: BoxGrid, clearance: float, scratch: LineScratch) -> int:
    """Check whether the robot keeps the clearance along the line in `scratch`.

    Returns `CLEAR`; `UNDECIDED` if it comes too close to decide; else the cause of the collision.
    """
    line, most, parts = scratch.line, 0.0, 1
    if line.leader == STRAIGHT:
        path = line.path
        shift = length(minus(vector(path.last.position), vector(path.first.position)))
        most = FIRST_TURN * (shift / FIRST_SHIFT + path.angle)
    for i in range(robot.limb_count):
        if has(scratch.compared.boxes | scratch.compared.itself, i) and line.leader != STRAIGHT:
            turned = 0.0
            for j in range(6):
                turned += abs(line.last[i].q[j] - line.first[i].q[j])
            most = max(most, turned)
    # Little can be told of all of a long line at once.
    while most > FIRST_TURN * parts:
        parts *= 2
    for k in range(parts):
        interval = scratch.intervals[0]
        begin_comparing(robot, scratch.compared, interval)
        interval.middle, interval.half = (k + 0.5) / parts, 0.5 / parts
        interval.number = parts + k
        result = check_pending(robot, grid, clearance, scratch)
        if result != CLEAR:
            return result
    return CLEAR


@part
def check_pending(robot: RobotModel, grid: BoxGrid, clearance: float, scratch: LineScratch) -> int:
    """Make the comparisons of the first interval in `scratch`, the whole line; see `check_line`."""
    intervals, top = scratch.intervals, 1
    while top > 0:
        top -= 1
        interval = intervals[top]
        result = _place(robot, interval, scratch)
        if result == CLEAR:
            result = _compare(robot, grid, clearance, interval, scratch)
        if result > UNDECIDED:
            return result
        if result == UNDECIDED:
            if interval.half <= 0.5**MOST_HALVINGS:
                return UNDECIDED
            _halve(interval, intervals[top + 1])
            top += 2
    return CLEAR


@kernel
def check_around(robot: RobotModel, grid: BoxGrid, clearance: float, scratch: LineScratch) -> int:
    """Check the middle of the line in `scratch`, and all that is as near to it in each joint.

    Returns `CLEAR` if the robot keeps the clearance at all joint angles that differ from those in
    the middle by no more than the ends do, in each joint on its own, so on any curve through them;
    the cause of a collision in the middle; else `UNDECIDED`. The comparisons are those of the first
    interval, where those that are undecided remain.
    """
    interval = scratch.intervals[0]
    _place(robot, interval, scratch)
    return _compare(robot, grid, clearance, interval, scratch)


@kernel
def check_middles(
    robot: RobotModel, grid: BoxGrid, clearance: float, count: int, scratch: LineScratch
) -> int:
    """Check the line in `scratch` in the middles of its intervals of numbers below `count`.

    Returns the cause of a collision there, or else `CLEAR`. This is quick, and a line on which
    there is a collision is not clear.
    """
    interval, parts = scratch.intervals[0], 1
    for number in range(1, count):
        if number == 2 * parts:
            parts *= 2
        begin_comparing(robot, scratch.compared, interval)
        interval.middle, interval.half = (number - parts + 0.5) / parts, 0.0
        interval.number = number
        result = _place(robot, interval, scratch)
        if result <= UNDECIDED:
            result = _compare(robot, grid, clearance, interval, scratch)
        if result > UNDECIDED:
            return result
    return CLEAR


@part
def _halve(first: LineInterval, second: LineInterval) -> None:
    """Replace an interval by its first half, and set another one to its second half."""
    half = 0.5 * first.half
    second.middle, second.half = first.middle + half, half
    first.middle, first.half = first.middle - half, half
    first.number *= 2
    second.number = first.number + 1
    copy_pending(first, second)


@kernel
def _place(robot: RobotModel, interval: LineInterval, scratch: LineScratch) -> int:
    """Place the limbs and the base that an interval needs.

    Returns `CLEAR`; `UNDECIDED` if it is not proved that all limbs that follow do so on all of it;
    `SELF` if one of them cannot hold in its middle.
    """
    line, compared, base = scratch.line, scratch.compared, scratch.base
    in_world = interval.base
    for i in range(robot.limb_count):
        in_world = in_world or interval.boxes[i] != 0
    if line.leader == STRAIGHT:
        pose_on_path(line.path, interval.middle, base)
        set_move(line, base, scratch.move)
    result = CLEAR
    for i in range(robot.limb_count):
        # All capsules of a limb are needed where others are compared with them.
        capsules = interval.boxes[i] | interval.body[i]
        if interval.itself[i] or (interval.limbs and i in (compared.first, compared.second)):
            capsules = EVERY
        if capsules or has(compared.placed, i) or (in_world and i == line.leader):
            result = max(result, _place_limb(i, robot, interval, capsules, scratch))
            if result > UNDECIDED:
                return result
    if in_world and line.leader >= 0:
        leader = robot.limbs[line.leader]
        place_base(leader, scratch.placed[line.leader], line.grasp, base)
    elif in_world and line.leader != STRAIGHT:
        for k in range(3):
            base.position[k] = line.base.position[k]
            for c in range(3):
                base.rotation[k, c] = line.base.rotation[k, c]
    return result


@kernel
def _place_limb(
    i: int, robot: RobotModel, interval: LineInterval, capsules: int, scratch: LineScratch
) -> int:
    """Place a limb in the middle of an interval, unless it is stored; results as of `_place`."""
    line, limb, number = scratch.line, robot.limbs[i], interval.number
    scratch.at[i] = i
    if line.leader != STRAIGHT:
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
    return PROVED if turn_one_way(leaving, half, scratch.proof, place) else NOT_PROVED


@part
def _compare(
    robot: RobotModel, grid: BoxGrid, clearance: float, interval: LineInterval, scratch: LineScratch
) -> int:
    """Make the comparisons that remain for an interval, and remove those that are clear.

    The base and its leader come first.
    """
    scratch.is_leader = True
    if interval.base:
        result = _compare_base(robot, grid, clearance, interval.half, scratch)
        if result > UNDECIDED:
            return result
        interval.base = result == UNDECIDED
    leader, undecided = scratch.line.leader, interval.base
    if leader >= 0:
        result = _compare_limb(leader, robot, grid, clearance, interval, scratch)
        if result > UNDECIDED:
            return result
        undecided = undecided or result == UNDECIDED
    leads = undecided
    scratch.is_leader = False
    for i in range(robot.limb_count):
        if i != leader:
            result = _compare_limb(i, robot, grid, clearance, interval, scratch)
            if result > UNDECIDED:
                return result
            undecided = undecided or result == UNDECIDED
    if interval.limbs:
        result = _compare_others(robot, clearance, interval, scratch)
        if result > UNDECIDED:
            return result
        undecided = undecided or result == UNDECIDED
    scratch.is_leader = leads
    return UNDECIDED if undecided else CLEAR


@kernel
def _compare_base(
    robot: RobotModel, grid: BoxGrid, clearance: float, half: float, scratch: LineScratch
) -> int:
    """Compare the body and the mounts with boxes."""
    undecided = False
    for c in range(robot.base_capsule_count):
        capsule = robot.base_capsules[c]
        a, b = capsule_axis(capsule.ends)
        moves = _with_base(half, a, scratch), _with_base(half, b, scratch)
        is_far = max(moves[0], moves[1]) > FAR
        if is_far:
            moves = 0.0, 0.0
        axis, at_grasp = (out_of(scratch.base, a), out_of(scratch.base, b)), c < 0
        inner = capsule.radius + clearance
        result = compare_with_grid(axis, inner, moves, grid, scratch.surface, at_grasp)
        if result > UNDECIDED:
            return result
        undecided = undecided or is_far or result == UNDECIDED
    return UNDECIDED if undecided else CLEAR


@kernel
def _with_base(half: float, p: Triple, scratch: LineScratch) -> float:
    """Bound how far a point of the body travels in the world on half an interval [m]."""
    leader = scratch.line.leader
    if leader >= 0:
        return travel(scratch.placed[leader], 0, 6, p)
    return carried(scratch.move, half, p) if leader == STRAIGHT else 0.0


@kernel
def _compare_limb(
    i: int,
    robot: RobotModel,
    grid: BoxGrid,
    clearance: float,
    interval: LineInterval,
    scratch: LineScratch,
) -> int:
    """Compare one limb with boxes, itself and the body."""
    limb, placed = robot.limbs[i], scratch.placed[scratch.at[i]]
    if interval.boxes[i]:
        result, interval.boxes[i] = _compare_with_boxes(
            limb, interval, placed, grid, clearance, scratch
        )
        if result > UNDECIDED:
            return result
    if interval.itself[i]:
        result, interval.itself[i] = compare_limb_with_itself(
            limb, placed, interval.itself[i], clearance
        )
        if result > UNDECIDED:
            return result
    if interval.body[i]:
        result, interval.body[i] = compare_limb_with_body(
            robot, limb, placed.in_body, interval.body[i], clearance
        )
        if result > UNDECIDED:
            return result
    undecided = interval.boxes[i] != 0 or interval.itself[i] != 0 or interval.body[i] != 0
    return UNDECIDED if undecided else CLEAR


@kernel
def _compare_with_boxes(
    limb: LimbModel,
    interval: LineInterval,
    placed: LimbPlace,
    grid: BoxGrid,
    clearance: float,
    scratch: LineScratch,
) -> tuple[int, int]:
    """Compare capsules of a limb with boxes; return a result and those that are undecided."""
    line, base, half, undecided = scratch.line, scratch.base, interval.half, EMPTY
    holds = line.leader == limb.index or has(line.follows, limb.index)
    for c in range(limb.capsule_count):
        if not has(interval.boxes[limb.index], c):
            continue
        capsule, (a, b) = limb.capsules[c], axis_of(placed.in_body.ends, c)
        if holds and (capsule.link >= HALFWAY or line.leader >= 0):
            # Seen from its grasp, the joints beyond the link move it.
            at_a, at_b = travel(placed, capsule.link, 6, a), travel(placed, capsule.link, 6, b)
        else:
            at_a = placed.in_body.motion[c, 0] + _with_base(half, a, scratch)
            at_b = placed.in_body.motion[c, 1] + _with_base(half, b, scratch)
        # Of what travels far only a collision in the middle can be told, without a wide search.
        is_far = max(at_a, at_b) > FAR
        moves = (0.0, 0.0) if is_far else (at_a, at_b)
        axis, at_grasp = (
            (out_of(base, a), out_of(base, b)),
            scratch.surface.applies and c >= limb.gripper,
        )
        inner = capsule.radius + clearance
        result = compare_with_grid(axis, inner, moves, grid, scratch.surface, at_grasp)
        if result > UNDECIDED:
            return result, undecided
        if is_far or result == UNDECIDED:
            undecided |= only(c)
    return UNDECIDED if undecided else CLEAR, undecided


@kernel
def _compare_others(
    robot: RobotModel, clearance: float, interval: LineInterval, scratch: LineScratch
) -> int:
    """Compare the first limb with the second one, or with the limbs at rest."""
    compared, resting = scratch.compared, scratch.resting
    limb, placed = robot.limbs[compared.first], scratch.placed[scratch.at[compared.first]]
    if compared.second >= 0:
        result, interval.limbs = compare_limbs(
            limb,
            placed.in_body,
            robot.limbs[compared.second],
            scratch.placed[scratch.at[compared.second]].in_body,
            interval.limbs,
            clearance,
        )
        return result
    undecided = EMPTY
    for k in range(resting.count):
        if has(interval.limbs, k):
            other = robot.limbs[resting.limb[k]]
            result, _ = compare_limbs(
                limb, placed.in_body, other, resting.shapes[k], EVERY, clearance
            )
            if result > UNDECIDED:
                return result
            if result == UNDECIDED:
                undecided |= only(k)
    interval.limbs = undecided
    return UNDECIDED if undecided else CLEAR
