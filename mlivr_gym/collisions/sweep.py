"""Swept collision checks of all kinds of motion (compiled).

**Conservative advancement.** A motion is divided into intervals. At the midpoint of an interval the
shapes are placed and compared with everything that they can meet, see `against_boxes`. If every
distance exceeds the radii and the clearance by more than the shapes can move from the midpoint to
either end, see `placement`, they keep the clearance on the whole interval, however thin they are.
If a distance is below the radii and the clearance, the motion is blocked. Otherwise the interval is
bisected, down to `2^-MOST_HALVINGS` of the motion, where an undecided interval counts as blocked.

**Motions.** A limb departs from a grasp along the surface normal, swings along a line in joint
space, or holds its grasp; the base stands still or follows a path. The limb is compared with boxes,
itself, the body, limbs at rest, and one other limb that swings or holds at the same time.

**Rounded corners.** Instead of a line, the joint angles x of a swing and the base path parameter
may round a corner C between a start A and an end B: `x(s) = C + (A - C) f(1 - s) + (B - C) f(s)`,
`f(s) = s^3 (2 - s)`, the B-spline that joins the two lines with continuous second derivatives.
Since `f'(s) + f'(1 - s) = 2`, the derivative lies between `2 (C - A)` and `2 (B - C)`. How far a
link rotates depends on the derivative alone, so bounds for the two lines also hold for the curve.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.collisions.against_boxes import compare_base_with_boxes, compare_limb_with_boxes
from mlivr_gym.collisions.against_robot import (
    compare_limb_with_body,
    compare_limb_with_itself,
    compare_limbs,
)
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.distances import CLEAR, UNDECIDED
from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.collisions.motion import (
    DEPARTS,
    HOLDS,
    MOST_HALVINGS,
    SWINGS,
    Interval,
    LimbMotion,
    SweepScratch,
    SweptMotion,
)
from mlivr_gym.collisions.placement import (
    WRIST_POINT,
    IntervalAngles,
    Placed,
    are_changes_bounded,
    bound_capsules,
    bound_from_grasp,
    bound_in_world,
    bound_links,
    place_by_angles,
    place_in_world,
    split_angles,
)
from mlivr_gym.compiled.bit_sets import EVERY, below, has, only
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.compiled.records import Joints
from mlivr_gym.kinematics.base_path import pose_on_path, travel_seen, turn_seen
from mlivr_gym.kinematics.families import held_turns
from mlivr_gym.kinematics.limb import angles_at
from mlivr_gym.kinematics.poses import along, columns, vector
from mlivr_gym.kinematics.turns import FlangeMotion, line_turns, lower_turns, more_turns

MOST_FIRST_INTERVALS = 512
"""Maximum number of intervals in the initial division of a motion."""

FIRST_TRAVEL = 0.6, 0.3
"""Travel of a swing, and of a limb that holds, per initial interval [m]; affects the speed only."""


@kernel
def set_joints(
    robot: RobotModel, limb: LimbMotion, s: float, scratch: SweepScratch, q: Joints
) -> bool:
    """Set `q` to the joint angles of a limb at a fraction `s` of a motion.

    Returns whether the limb can reach that configuration.
    """
    motion = scratch.motion
    if limb.kind == SWINGS:
        for k in range(6):
            corner = limb.corner[k]
            q[k] = _interpolate(motion.rounded, limb.start[k], corner, limb.end[k], s)
        return True
    if limb.kind == HOLDS:
        pose_on_path(motion.path, _base_parameter(motion, s), scratch.base)
        return angles_at(robot.limbs[limb.limb], scratch.base, limb.flange, limb.branch, 0.0, q)
    flange, lifted = limb.flange, scratch.lifted
    for k in range(3):
        lifted.position[k] = flange.position[k] - s * robot.lift * flange.rotation[k, 2]
        for axis in range(3):
            lifted.rotation[k, axis] = flange.rotation[k, axis]
    return angles_at(robot.limbs[limb.limb], motion.path.first, lifted, limb.branch, 0.0, q)


@kernel
def _interpolate(rounded: bool, start: float, corner: float, end: float, s: float) -> float:
    """Return a coordinate at a fraction `s` of its motion along a line or round a corner."""
    if not rounded:
        return start + s * (end - start)
    rest = 1.0 - s
    before, after = rest * rest * rest * (2.0 - rest), s * s * s * (2.0 - s)
    return corner + before * (start - corner) + after * (end - corner)


@kernel
def _base_parameter(motion: SweptMotion, s: float) -> float:
    """Return the base path parameter at a fraction `s` of a motion."""
    return _interpolate(motion.rounded, motion.begin, motion.corner, motion.finish, s)


@kernel
def _base_rate(motion: SweptMotion) -> float:
    """Return the largest change of the base path parameter per fraction of the motion."""
    if not motion.rounded:
        return abs(motion.finish - motion.begin)
    corner = motion.corner
    return 2.0 * max(abs(corner - motion.begin), abs(motion.finish - corner))


@kernel
def sweep(robot: RobotModel, grid: BoxGrid, clearance: float, scratch: SweepScratch) -> int:
    """Check whether the first limb of a motion keeps the clearance from all it is compared with.

    Returns `CLEAR`; `UNDECIDED` if it comes too close to decide within the depth, or if a
    configuration cannot be reached; else the cause of the collision.
    """
    motion, intervals = scratch.motion, scratch.intervals
    span = _base_rate(motion)
    travel, turn = motion.path.speed * span, motion.path.angle * span
    count = _first_division(robot, travel + turn, scratch)
    shortest = 0.5**MOST_HALVINGS if motion.first.kind == DEPARTS else 0.5 ** (MOST_HALVINGS + 1)
    if not (
        set_joints(robot, motion.first, 0.0, scratch, scratch.first_at_end)
        and set_joints(robot, motion.second, 0.0, scratch, scratch.second_at_end)
    ):
        return UNDECIDED
    for number in range(count):
        if not _set_interval(robot, number, count, scratch):
            return UNDECIDED
        top = 1
        while top > 0:
            top -= 1
            interval = intervals[top]
            if not _place_limb(
                robot, motion.first, interval, scratch, scratch.first, interval.first
            ):
                return UNDECIDED
            result = UNDECIDED
            if scratch.first.is_bounded:
                result = _compare(robot, grid, clearance, (travel, turn), interval, scratch)
            elif interval.limbs and motion.meeting:
                # Where the other limb is in the middle, the halves of the interval have to know.
                other = scratch.second.q
                if not set_joints(robot, motion.second, interval.middle, scratch, other):
                    return UNDECIDED
            if result > UNDECIDED:
                return result
            if result == UNDECIDED:
                if interval.half < shortest:
                    return UNDECIDED
                _halve(top, scratch)
                top += 2
    return CLEAR


@part
def _first_division(robot: RobotModel, travel: float, scratch: SweepScratch) -> int:
    """Return the number of intervals in the initial division of a motion."""
    motion = scratch.motion
    if motion.first.kind == DEPARTS:
        return 1
    _bound_swing(robot, motion.first, scratch, scratch.first)
    _bound_swing(robot, motion.second, scratch, scratch.second)
    if motion.first.kind == SWINGS:
        travel += scratch.first.anchor_travel[0, WRIST_POINT]
    travel_limit = FIRST_TRAVEL[0] if motion.first.kind == SWINGS else FIRST_TRAVEL[1]
    return int(min(max(np.ceil(travel / travel_limit), 1.0), MOST_FIRST_INTERVALS))


@kernel
def _bound_swing(
    robot: RobotModel, limb: LimbMotion, scratch: SweepScratch, placed: Placed
) -> None:
    """Bound the motion of a limb over a whole swing; an interval takes its share of the bounds."""
    if limb.kind == SWINGS:
        for k in range(6):
            placed.to_last[k] = limb.end[k] - limb.start[k]
            if scratch.motion.rounded:
                placed.to_first[k] = 2.0 * (limb.corner[k] - limb.start[k])
                placed.to_last[k] = 2.0 * (limb.end[k] - limb.corner[k])
        arm = robot.limbs[limb.limb].arm
        line_turns(arm, placed.to_last, placed.turns)
        if scratch.motion.rounded:
            more_turns(arm, placed.to_first, placed.turns)
        bound_links(arm, placed)


@part
def _set_interval(robot: RobotModel, number: int, count: int, scratch: SweepScratch) -> bool:
    """Set the lowest interval of the stack to an initial interval, with everything to be compared.

    Returns whether the limbs can reach its end.
    """
    motion, interval = scratch.motion, scratch.intervals[0]
    interval.half = 0.5 / count
    interval.middle = (2 * number + 1) * interval.half
    interval.boxes = EVERY if motion.boxes else 0
    interval.itself = interval.body = EVERY if motion.body else 0
    interval.limbs = EVERY if motion.resting or motion.meeting else 0
    for k in range(6):
        interval.first.first[k], interval.second.first[k] = (
            scratch.first_at_end[k],
            scratch.second_at_end[k],
        )
    at = (number + 1) / count
    reachable = set_joints(robot, motion.first, at, scratch, scratch.first_at_end) and set_joints(
        robot, motion.second, at, scratch, scratch.second_at_end
    )
    for k in range(6):
        interval.first.last[k], interval.second.last[k] = (
            scratch.first_at_end[k],
            scratch.second_at_end[k],
        )
    return reachable


@kernel
def _place_limb(
    robot: RobotModel,
    limb: LimbMotion,
    interval: Interval,
    scratch: SweepScratch,
    placed: Placed,
    ends: IntervalAngles,
) -> bool:
    """Place a limb at the midpoint of an interval; return whether it can reach that configuration.

    Shapes are not placed if its motion has no proved bound, `placed.is_bounded` is then False.
    """
    if not set_joints(robot, limb, interval.middle, scratch, placed.q):
        return False
    arm, placed.is_bounded = robot.limbs[limb.limb].arm, True
    if limb.kind == SWINGS:
        placed.fraction = interval.half
    else:
        placed.fraction = 1.0
        flange = _flange_motion(robot, limb, interval, scratch)
        is_proved = held_turns(arm, placed.q, flange, placed.turns)
        placed.is_bounded = is_proved and are_changes_bounded(ends, placed)
        if not placed.is_bounded:
            return True
        lower_turns(arm, placed.to_first, placed.to_last, placed.turns)
        bound_links(arm, placed)
    place_by_angles(robot.limbs[limb.limb], placed)
    bound_capsules(robot.limbs[limb.limb], placed)
    return True


@kernel
def _flange_motion(
    robot: RobotModel, limb: LimbMotion, interval: Interval, scratch: SweepScratch
) -> FlangeMotion:
    """Bound a flange's motion in the limb base frame from an interval's midpoint to either end."""
    if limb.kind == DEPARTS:
        return FlangeMotion(interval.half * robot.lift, 0.0, 0.0)
    motion = scratch.motion
    half, at = interval.half * _base_rate(motion), _base_parameter(motion, interval.middle)
    _, _, z = columns(limb.flange.rotation)
    wrist = along(vector(limb.flange.position), -robot.limbs[limb.limb].arm.d6, z)
    path = motion.path
    return FlangeMotion(
        travel_seen(path, scratch.base, at, half, wrist),
        turn_seen(path, scratch.base, half, z),
        path.angle * half,
    )


@kernel
def _compare(
    robot: RobotModel,
    grid: BoxGrid,
    clearance: float,
    speed: tuple[float, float],
    interval: Interval,
    scratch: SweepScratch,
) -> int:
    """Make the comparisons that remain for an interval, and remove those that are clear.

    `speed` is how far the base travels [m] and rotates [rad] over the whole motion.
    """
    motion, first = scratch.motion, scratch.first
    limb = robot.limbs[motion.first.limb]
    if interval.boxes:
        result = _compare_with_boxes(robot, grid, clearance, speed, interval, scratch)
        if result > UNDECIDED:
            return result
    if interval.itself:
        result, interval.itself = compare_limb_with_itself(
            limb, first.in_body, first, interval.itself, clearance
        )
        if result > UNDECIDED:
            return result
    if interval.body:
        result, interval.body = compare_limb_with_body(
            robot, limb, first.in_body, interval.body, clearance
        )
        if result > UNDECIDED:
            return result
    if interval.limbs and motion.meeting:
        second, other = scratch.second, robot.limbs[motion.second.limb]
        if not _place_limb(robot, motion.second, interval, scratch, second, interval.second):
            return UNDECIDED
        if not second.is_bounded:
            return UNDECIDED
        result, interval.limbs = compare_limbs(
            limb, first.in_body, other, second.in_body, interval.limbs, clearance
        )
        if result > UNDECIDED:
            return result
    elif interval.limbs:
        result, interval.limbs = _compare_with_resting(
            robot, limb, interval.limbs, clearance, scratch
        )
        if result > UNDECIDED:
            return result
    return (
        UNDECIDED if interval.boxes or interval.itself or interval.body or interval.limbs else CLEAR
    )


@kernel
def _compare_with_boxes(
    robot: RobotModel,
    grid: BoxGrid,
    clearance: float,
    speed: tuple[float, float],
    interval: Interval,
    scratch: SweepScratch,
) -> int:
    """Compare the first limb, and the base if it moves during a swing, with boxes."""
    motion, first, limb = scratch.motion, scratch.first, robot.limbs[scratch.motion.first.limb]
    travel, turn = speed[0] * interval.half, speed[1] * interval.half
    pose_on_path(motion.path, _base_parameter(motion, interval.middle), scratch.base)
    place_in_world(limb, scratch.base, first.in_body, first.in_world)
    bound_in_world(limb, travel, turn, first)
    pending, on_base = interval.boxes, only(limb.capsule_count)
    if motion.first.kind == HOLDS:
        bound_from_grasp(limb, first)
        # Capsules on the flange axis stand still in the world; `check_points` compared them.
        pending &= below(limb.first_on_axis)
    result, undecided = compare_limb_with_boxes(
        limb, first.in_world, pending, grid, clearance, scratch.surface
    )
    if result > UNDECIDED:
        return result
    if motion.first.kind == SWINGS and motion.begin != motion.finish and interval.boxes & on_base:
        result = compare_base_with_boxes(
            robot, scratch.base, (travel, turn), grid, clearance, scratch.surface
        )
        if result == UNDECIDED:
            undecided |= on_base
    interval.boxes = undecided
    return result


@part
def _compare_with_resting(
    robot: RobotModel, limb: LimbModel, pending: int, clearance: float, scratch: SweepScratch
) -> tuple[int, int]:
    """Compare the first limb with limbs at rest; return a result and those that are undecided."""
    undecided, resting = 0, scratch.resting
    for k in range(resting.count):
        if has(pending, k):
            other = robot.limbs[resting.limb[k]]
            result, _ = compare_limbs(
                limb, scratch.first.in_body, other, resting.shapes[k], EVERY, clearance
            )
            if result > UNDECIDED:
                return result, undecided
            if result == UNDECIDED:
                undecided |= only(k)
    return UNDECIDED if undecided else CLEAR, undecided


@part
def _halve(top: int, scratch: SweepScratch) -> None:
    """Replace interval `top` by its two halves, with the limbs at its midpoint as placed now."""
    first, second = scratch.intervals[top], scratch.intervals[top + 1]
    half = 0.5 * first.half
    second.middle, second.half = first.middle + half, half
    first.middle, first.half = first.middle - half, half
    second.boxes, second.itself = first.boxes, first.itself
    second.body, second.limbs = first.body, first.limbs
    split_angles(first.first, second.first, scratch.first)
    split_angles(first.second, second.second, scratch.second)
