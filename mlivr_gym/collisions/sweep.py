"""Checks of whole motions: one driver for all of them (compiled).

**Advancement.** A motion is cut into intervals. At the middle of one the shapes are put in place
and compared with everything they can meet, see `against_boxes`. If every distance exceeds radii and
clearance by more than the shapes can move from the middle to either end, see `placing`, nothing
comes closer than the clearance anywhere on the interval, however thin it is: no step can skip a
shape. If a distance is below radii and clearance the motion is blocked; otherwise the interval is
halved, down to `2^-DEPTH` of the motion, where the answer errs on the safe side. On the halves only
what was not clear on the whole is compared again.

**Motions.** A limb departs from a grasp along the surface normal, swings along a line in joint
space, or holds its grasp; the base rests or follows a path. It is compared with boxes, with itself
and the body, with limbs at rest, and with one other limb that swings or holds meanwhile.

**Corners.** Instead of a line, joint angles x of a swing and the base parameter may round a corner
C between start A and end B: `x(s) = C + (A - C) f(1 - s) + (B - C) f(s)`, `f(s) = s^3 (2 - s)`, the
B-spline that joins lines smoothly to the second derivative. Since `f'(s) + f'(1 - s) = 2`, its
derivative lies between `2 (C - A)` and `2 (B - C)`, and what bounds the motion on lines along these
bounds that on the curve: how far a link turns between two postures depends on them alone.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.collisions.against_boxes import against_boxes, base_against_boxes
from mlivr_gym.collisions.against_robot import against_body, against_itself, against_limb
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.distances import CLEAR, UNDECIDED
from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.collisions.motion import (
    DEPARTS,
    DEPTH,
    HOLDS,
    SWINGS,
    Interval,
    LimbMotion,
    Sweep,
    SweptMotion,
)
from mlivr_gym.collisions.placement import (
    WRIST_POINT,
    Ends,
    Placed,
    capsule_motion,
    changes,
    joint_motion,
    moved_by_base,
    place_by_angles,
    seen_from_grasp,
    to_world,
)
from mlivr_gym.compiled.bit_sets import EVERY, below, has, only
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.compiled.records import Joints
from mlivr_gym.kinematics.base_path import pose_on_path, travel_seen, turn_seen
from mlivr_gym.kinematics.families import held_turns, line_turns, lower_turns, more_turns
from mlivr_gym.kinematics.limb import angles_at
from mlivr_gym.kinematics.poses import along, columns, vector
from mlivr_gym.kinematics.turns import FlangeMotion

MOST_PIECES = 512
"""Most intervals of the first division."""

FIRST_INTERVAL = 0.6, 0.3
"""Travel that an interval of the first division covers [m], of a swing and of a limb that holds.

A matter of speed only.
"""


@kernel
def joints_at(robot: RobotModel, limb: LimbMotion, s: float, scratch: Sweep, q: Joints) -> bool:
    """Joint angles of a limb at a share `s` of a motion, into `q`; whether it can be there."""
    motion = scratch.motion
    if limb.kind == SWINGS:
        for k in range(6):
            corner = limb.corner[k]
            q[k] = _between(motion.rounded, limb.start[k], corner, limb.end[k], s)
        return True
    if limb.kind == HOLDS:
        pose_on_path(motion.path, _base_at(motion, s), scratch.base)
        return angles_at(robot.limbs[limb.limb], scratch.base, limb.flange, limb.branch, 0.0, q)
    flange, lifted = limb.flange, scratch.lifted
    for k in range(3):
        lifted.position[k] = flange.position[k] - s * robot.lift * flange.rotation[k, 2]
        for axis in range(3):
            lifted.rotation[k, axis] = flange.rotation[k, axis]
    return angles_at(robot.limbs[limb.limb], motion.path.first, lifted, limb.branch, 0.0, q)


@kernel
def _between(rounded: bool, start: float, corner: float, end: float, s: float) -> float:
    """Where a coordinate is at a share `s` of its way in a line or round a corner."""
    if not rounded:
        return start + s * (end - start)
    rest = 1.0 - s
    before, after = rest * rest * rest * (2.0 - rest), s * s * s * (2.0 - s)
    return corner + before * (start - corner) + after * (end - corner)


@kernel
def _base_at(motion: SweptMotion, s: float) -> float:
    """Where the base is on its path at a share `s` of a motion."""
    return _between(motion.rounded, motion.begin, motion.corner, motion.finish, s)


@kernel
def _base_span(motion: SweptMotion) -> float:
    """How fast the base goes along its path at most, by the share of the motion."""
    if not motion.rounded:
        return abs(motion.finish - motion.begin)
    corner = motion.corner
    return 2.0 * max(abs(corner - motion.begin), abs(motion.finish - corner))


@kernel
def sweep(robot: RobotModel, grid: BoxGrid, clearance: float, scratch: Sweep) -> int:
    """Whether the first limb of a motion keeps clear of what it is compared with.

    Returns
    -------
    int
        `CLEAR`, `UNDECIDED` (too close for the depth, or out of reach on the way), or the cause.
    """
    motion, intervals = scratch.motion, scratch.intervals
    span = _base_span(motion)
    travel, swing = motion.path.speed * span, motion.path.angle * span
    pieces = _pieces(robot, travel + swing, scratch)
    shortest = 0.5**DEPTH if motion.first.kind == DEPARTS else 0.5 ** (DEPTH + 1)
    if not (
        joints_at(robot, motion.first, 0.0, scratch, scratch.first_ahead)
        and joints_at(robot, motion.second, 0.0, scratch, scratch.second_ahead)
    ):
        return UNDECIDED
    for piece in range(pieces):
        if not _first_interval(robot, piece, pieces, scratch):
            return UNDECIDED
        top = 1
        while top > 0:
            top -= 1
            here = intervals[top]
            if not _place_limb(robot, motion.first, here, scratch, scratch.first, here.first):
                return UNDECIDED
            answer = UNDECIDED
            if scratch.first.proved:
                answer = _compare(robot, grid, clearance, (travel, swing), here, scratch)
            if answer > UNDECIDED:
                return answer
            if answer == UNDECIDED:
                if here.half < shortest:
                    return UNDECIDED
                _halve(top, scratch)
                top += 2
    return CLEAR


@part
def _pieces(robot: RobotModel, travel: float, scratch: Sweep) -> int:
    """Number of intervals of the first division."""
    motion = scratch.motion
    if motion.first.kind == DEPARTS:
        return 1
    _whole_motion(robot, motion.first, scratch, scratch.first)
    _whole_motion(robot, motion.second, scratch, scratch.second)
    if motion.first.kind == SWINGS:
        travel += scratch.first.shift[0, WRIST_POINT]
    interval = FIRST_INTERVAL[0] if motion.first.kind == SWINGS else FIRST_INTERVAL[1]
    return int(min(max(np.ceil(travel / interval), 1.0), MOST_PIECES))


@kernel
def _whole_motion(robot: RobotModel, limb: LimbMotion, scratch: Sweep, placed: Placed) -> None:
    """Bounds for the whole of a swing, of which an interval has its share."""
    if limb.kind == SWINGS:
        for k in range(6):
            placed.plus[k] = limb.end[k] - limb.start[k]
            if scratch.motion.rounded:
                placed.minus[k] = 2.0 * (limb.corner[k] - limb.start[k])
                placed.plus[k] = 2.0 * (limb.end[k] - limb.corner[k])
        arm = robot.limbs[limb.limb].arm
        line_turns(arm, placed.plus, placed.turns)
        if scratch.motion.rounded:
            more_turns(arm, placed.minus, placed.turns)
        joint_motion(arm, placed)


@part
def _first_interval(robot: RobotModel, piece: int, pieces: int, scratch: Sweep) -> bool:
    """Put a piece of the first division on the stack; whether the limbs can be at its end."""
    motion, here = scratch.motion, scratch.intervals[0]
    here.half = 0.5 / pieces
    here.middle = (2 * piece + 1) * here.half
    here.boxes = EVERY if motion.boxes else 0
    here.itself = here.body = EVERY if motion.body else 0
    here.limbs = EVERY if motion.resting or motion.meeting else 0
    for k in range(6):
        here.first.first[k], here.second.first[k] = scratch.first_ahead[k], scratch.second_ahead[k]
    at = (piece + 1) / pieces
    there = joints_at(robot, motion.first, at, scratch, scratch.first_ahead) and joints_at(
        robot, motion.second, at, scratch, scratch.second_ahead
    )
    for k in range(6):
        here.first.last[k], here.second.last[k] = scratch.first_ahead[k], scratch.second_ahead[k]
    return there


@kernel
def _place_limb(
    robot: RobotModel,
    limb: LimbMotion,
    here: Interval,
    scratch: Sweep,
    placed: Placed,
    ends: Ends,
) -> bool:
    """Put a limb in place in the middle of an interval; whether it can be there.

    Where `placed.proved` is false it is not known how far it moves, and it is not put in place.
    """
    if not joints_at(robot, limb, here.middle, scratch, placed.q):
        return False
    arm, placed.proved = robot.limbs[limb.limb].arm, True
    if limb.kind == SWINGS:
        placed.share = here.half
    else:
        placed.share = 1.0
        flange = _flange_motion(robot, limb, here, scratch)
        placed.proved = held_turns(arm, placed.q, flange, placed.turns)
        if not placed.proved:
            return True
        changes(ends, placed)
        lower_turns(arm, placed.minus, placed.plus, placed.turns)
        joint_motion(arm, placed)
    place_by_angles(robot.limbs[limb.limb], placed)
    capsule_motion(robot.limbs[limb.limb], placed)
    return True


@kernel
def _flange_motion(
    robot: RobotModel, limb: LimbMotion, here: Interval, scratch: Sweep
) -> FlangeMotion:
    """How a flange moves in the limb base frame from the middle of an interval to either end."""
    if limb.kind == DEPARTS:
        return FlangeMotion(here.half * robot.lift, 0.0, 0.0)
    motion = scratch.motion
    half, at = here.half * _base_span(motion), _base_at(motion, here.middle)
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
    here: Interval,
    scratch: Sweep,
) -> int:
    """Compare what is left of an interval; what is decided is left out of its sets.

    `speed` is how far the base travels [m] and turns [rad] on the whole motion.
    """
    motion, first = scratch.motion, scratch.first
    limb = robot.limbs[motion.first.limb]
    if here.boxes:
        answer = _compare_with_boxes(robot, grid, clearance, speed, here, scratch)
        if answer > UNDECIDED:
            return answer
    if here.itself:
        answer, here.itself = against_itself(limb, first.in_body, first, here.itself, clearance)
        if answer > UNDECIDED:
            return answer
    if here.body:
        answer, here.body = against_body(robot, limb, first.in_body, here.body, clearance)
        if answer > UNDECIDED:
            return answer
    if here.limbs and motion.meeting:
        second, other = scratch.second, robot.limbs[motion.second.limb]
        if not _place_limb(robot, motion.second, here, scratch, second, here.second):
            return UNDECIDED
        if not second.proved:
            return UNDECIDED
        answer, here.limbs = against_limb(
            limb, first.in_body, other, second.in_body, here.limbs, clearance
        )
        if answer > UNDECIDED:
            return answer
    elif here.limbs:
        answer, here.limbs = _compare_with_resting(robot, limb, here.limbs, clearance, scratch)
        if answer > UNDECIDED:
            return answer
    return UNDECIDED if here.boxes or here.itself or here.body or here.limbs else CLEAR


@kernel
def _compare_with_boxes(
    robot: RobotModel,
    grid: BoxGrid,
    clearance: float,
    speed: tuple[float, float],
    here: Interval,
    scratch: Sweep,
) -> int:
    """Compare the first limb, and a base that moves while it swings, with boxes."""
    motion, first, limb = scratch.motion, scratch.first, robot.limbs[scratch.motion.first.limb]
    travel, swing = speed[0] * here.half, speed[1] * here.half
    pose_on_path(motion.path, _base_at(motion, here.middle), scratch.base)
    to_world(limb, scratch.base, first.in_body, first.in_world)
    moved_by_base(limb, travel, swing, first)
    todo, on_base = here.boxes, only(limb.capsule_count)
    if motion.first.kind == HOLDS:
        seen_from_grasp(limb, first)
        # The hand stands still in the world and was compared when the point was chosen.
        todo &= below(limb.hand)
    answer, undecided = against_boxes(limb, first.in_world, todo, grid, clearance, scratch.behind)
    if answer > UNDECIDED:
        return answer
    if motion.first.kind == SWINGS and motion.begin != motion.finish and here.boxes & on_base:
        answer = base_against_boxes(
            robot, scratch.base, (travel, swing), grid, clearance, scratch.behind
        )
        if answer == UNDECIDED:
            undecided |= on_base
    here.boxes = undecided
    return answer


@part
def _compare_with_resting(
    robot: RobotModel, limb: LimbModel, todo: int, clearance: float, scratch: Sweep
) -> tuple[int, int]:
    """Compare the first limb with limbs at rest; an answer, and those that are undecided."""
    undecided, resting = 0, scratch.resting
    for k in range(resting.count):
        if has(todo, k):
            other = robot.limbs[resting.limb[k]]
            found, _ = against_limb(
                limb, scratch.first.in_body, other, resting.shapes[k], EVERY, clearance
            )
            if found > UNDECIDED:
                return found, undecided
            if found == UNDECIDED:
                undecided |= only(k)
    return UNDECIDED if undecided else CLEAR, undecided


@part
def _halve(top: int, scratch: Sweep) -> None:
    """Put both halves of interval `top`, where the limbs are now, in its place and the next."""
    first, second = scratch.intervals[top], scratch.intervals[top + 1]
    half = 0.5 * first.half
    second.middle, second.half = first.middle + half, half
    first.middle, first.half = first.middle - half, half
    second.boxes, second.itself = first.boxes, first.itself
    second.body, second.limbs = first.body, first.limbs
    _share(first.first, second.first, scratch.first)
    _share(first.second, second.second, scratch.second)


@kernel
def _share(first: Ends, second: Ends, placed: Placed) -> None:
    """Joint angles at the ends of two halves, those of the whole in `first`."""
    for k in range(6):
        second.first[k], second.last[k] = placed.q[k], first.last[k]
        first.last[k] = placed.q[k]
