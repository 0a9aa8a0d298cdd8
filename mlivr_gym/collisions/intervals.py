"""The check whether the robot keeps the clearance on a line in joint space (compiled).

An interval of the line is checked in its middle: the shapes are placed there, and each distance is
compared with the radii and the clearance, and with these plus how far the shapes may travel from
the middle to either end, see `joint_lines`. What is farther apart than the latter is clear on the
whole interval, however thin a box is; what is closer than the former is a collision. What is left
undecided is compared again on both halves, down to a half length of `2^-MOST_HALVINGS`, where it
counts as a collision. So is an interval on which it is not proved that a limb that holds follows
the base.

This one check serves all motions: departures, changes between folds, swings, and supports that
carry the base or follow it. Of a base that moves straight, limbs are placed once in the middle of
each interval, whatever they are then compared with.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from mlivr_gym.collisions.against_boxes import (
    compare_base_with_boxes,
    compare_limb_with_boxes,
)
from mlivr_gym.collisions.against_robot import (
    compare_limb_with_body,
    compare_limb_with_itself,
    compare_limbs,
)
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.compared import (
    LineInterval,
    begin_comparing,
    copy_pending,
)
from mlivr_gym.collisions.distances import CLEAR, UNDECIDED
from mlivr_gym.collisions.joint_lines import (
    LimbPlace,
    base_travel,
    travel,
)
from mlivr_gym.collisions.limb_shapes import LimbModel, RobotModel
from mlivr_gym.collisions.placement import axis_of
from mlivr_gym.collisions.places import MOST_HALVINGS, LineScratch, place_robot
from mlivr_gym.compiled.bit_sets import EMPTY, EVERY, has, only
from mlivr_gym.compiled.kernels import kernel, part
from mlivr_gym.kinematics.poses import length, minus, vector

FIRST_TURN = 4.0
"""Sum of the turns of a limb up to which a line is one interval at first [rad]; affects the speed
only."""

FIRST_SHIFT = 0.5
"""Shift of a base that moves straight up to which its way is one interval at first [m], likewise a
turn of one radian; affects the speed only."""

HALFWAY = 3
"""Link from which on the travel of a limb that follows is bounded from its grasp, and not from the
body."""

WHOLE = cast(int, np.int64(0))
"""In place of the number of an interval: a line is to be proved, not looked at in places."""


@kernel
def check_line(
    robot: RobotModel, grid: BoxGrid, clearance: float, before: int, scratch: LineScratch
) -> int:
    """Check whether the robot keeps the clearance along the line in `scratch`.

    It is proved on the `WHOLE` line, or else looked at in the middles of the intervals of numbers
    below `before`. This is quick, and a line on which there is a collision is not clear. Returns
    `CLEAR`; `UNDECIDED` if it comes too close to decide; else the cause of the collision.
    """
    first, stop = 1, before
    if before == WHOLE:
        first = _first_parts(robot, scratch)
        stop = 2 * first
    for number in range(first, stop):
        interval, parts = scratch.intervals[0], 1
        while 2 * parts <= number:
            parts *= 2
        begin_comparing(robot, scratch.compared, interval)
        interval.number, interval.middle = number, (number - parts + 0.5) / parts
        interval.half = 0.5 / parts if before == WHOLE else 0.0
        result = check_pending(robot, grid, clearance, scratch)
        if result != CLEAR:
            return result
    return CLEAR


@part
def _first_parts(robot: RobotModel, scratch: LineScratch) -> int:
    """Return into how many intervals, a power of two, the line is divided at first.

    Little can be told of all of a long line at once.
    """
    line, most, parts = scratch.line, 0.0, 1
    if line.moves:
        path = line.path
        shift = length(minus(vector(path.last.position), vector(path.first.position)))
        most = FIRST_TURN * (shift / FIRST_SHIFT + path.angle)
    for i in range(robot.limb_count):
        if has(scratch.compared.boxes | scratch.compared.itself, i) and not line.moves:
            turned = 0.0
            for j in range(6):
                turned += abs(line.last[i].q[j] - line.first[i].q[j])
            most = max(most, turned)
    while most > FIRST_TURN * parts:
        parts *= 2
    return parts


@part
def check_pending(robot: RobotModel, grid: BoxGrid, clearance: float, scratch: LineScratch) -> int:
    """Make the comparisons of the first interval in `scratch`, whole or a part of a line.

    Of a middle alone, whose half length is 0, only a collision can be told.
    """
    intervals, top = scratch.intervals, 1
    while top > 0:
        top -= 1
        interval = intervals[top]
        result = place_robot(robot, interval, scratch)
        if result == CLEAR or (result == UNDECIDED and interval.half == 0.0):
            result = _compare(robot, grid, clearance, interval, scratch)
        if result > UNDECIDED:
            return result
        if result == UNDECIDED and interval.half > 0.0:
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
    place_robot(robot, interval, scratch)
    return _compare(robot, grid, clearance, interval, scratch)


@part
def _halve(first: LineInterval, second: LineInterval) -> None:
    """Replace an interval by its first half, and set another one to its second half."""
    half = 0.5 * first.half
    second.middle, second.half = first.middle + half, half
    first.middle, first.half = first.middle - half, half
    first.number *= 2
    second.number = first.number + 1
    copy_pending(first, second)


@part
def _compare(
    robot: RobotModel, grid: BoxGrid, clearance: float, interval: LineInterval, scratch: LineScratch
) -> int:
    """Make the comparisons that remain for an interval, and remove those that are clear."""
    if interval.base:
        half = interval.half if scratch.line.moves else 0.0
        result = compare_base_with_boxes(
            robot, scratch.base, scratch.move, half, grid, clearance, scratch.surface
        )
        if result > UNDECIDED:
            return result
        interval.base = result == UNDECIDED
    undecided = interval.base
    for i in range(robot.limb_count):
        result = _compare_limb(i, robot, grid, clearance, interval, scratch)
        if result > UNDECIDED:
            return result
        undecided = undecided or result == UNDECIDED
    if interval.limbs:
        result = _compare_others(robot, clearance, interval, scratch)
        if result > UNDECIDED:
            return result
        undecided = undecided or result == UNDECIDED
    return UNDECIDED if undecided else CLEAR


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
        _set_travel(limb, interval, placed, scratch)
        result, interval.boxes[i] = compare_limb_with_boxes(
            limb,
            placed.in_body.ends,
            scratch.travel,
            scratch.base,
            interval.boxes[i],
            grid,
            clearance,
            scratch.surface,
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


@part
def _set_travel(
    limb: LimbModel, interval: LineInterval, placed: LimbPlace, scratch: LineScratch
) -> None:
    """Bound how far the capsules of a limb that are compared with boxes travel in the world."""
    follows, out = has(scratch.line.follows, limb.index), scratch.travel
    for c in range(limb.capsule_count):
        if not has(interval.boxes[limb.index], c):
            continue
        link, axis = limb.capsules[c].link, axis_of(placed.in_body.ends, c)
        for e in range(2):
            if follows and link >= HALFWAY:
                # Seen from its grasp, the joints beyond the link move it.
                out[c, e] = travel(placed, link, 6, axis[e])
                continue
            out[c, e] = placed.in_body.motion[c, e]
            if scratch.line.moves:
                out[c, e] += base_travel(scratch.move, interval.half, axis[e])


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
