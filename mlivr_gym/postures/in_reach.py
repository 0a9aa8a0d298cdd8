"""Sets of points that can be held at once as far as reach and `w_m` tell (compiled).

Of a stance only which points are held is looked at, not which limb holds which. A set is in reach
if from one of the base poses that the solver tries, for some order of the limbs, every limb reaches
its point with the `w_m` that a stance needs. That is true of every node, whatever stands around it,
so what is not in reach is none.

The robot looks the same after a turn by one limb and after a half turn about the line about which
it rolls, so orders of the points about the body count once that differ by where they begin and by
which way round they run. That line is the one to the point nearest to the centroid, see `turns`; of
points that are equally near any may be meant.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import Annotated, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Record, Rows, Vector
from mlivr_gym.kinematics.families import branch_terms
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.limb import flange_seen
from mlivr_gym.kinematics.poses import (
    Pose,
    along,
    columns,
    cross,
    dot,
    length,
    minus,
    turn,
    vector,
)
from mlivr_gym.postures.base_frames import OPPOSED
from mlivr_gym.postures.records import PostureRule, set_candidates
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.values import Triple

SLACK = 1e-6
"""Share by which `w_m` may fall short, and by which directions count as equal: postures are worked
out on rounded figures."""

MOST_FRAMES = 24
"""Most unrolled body axes of a set: both senses of the orders of five limbs."""

UNKNOWN = -1
"""Number of body axes that were not worked out yet."""

CELLS = 256
"""Cells of joint 3 and of joint 5 over which `farthest_flange` takes bounds."""


class ReachQuery(Record):
    """What a set of points is asked."""

    rule: PostureRule
    """Which base poses are tried, and the `w_m` that a stance needs."""
    farthest: float
    """A bound of the distance of a flange from the base origin at that `w_m` [m]."""
    target: Vector
    """Where the base is to be [m]."""
    tolerance: float
    """How near to it [m]; infinite for anywhere."""


class ReachScratch(Record):
    """Room for one set."""

    points: Annotated[IntArray, (8,), np.int64]
    """Its points."""
    centre: Vector
    """Their centroid [m]."""
    normal: Vector
    """Their mean normal."""
    frame_count: int
    """Number of unrolled body axes, `UNKNOWN` until they are needed."""
    frames: Annotated[Rows[Pose], (MOST_FRAMES,)]
    """These axes."""
    order: Annotated[IntArray, (MOST_FRAMES,), np.int64]
    """Order of the points that each belongs to."""
    base: Pose
    """A base pose that is tried."""
    terms: Annotated[Array, (4, 4)]


class _World(NamedTuple):
    """What all sets share."""

    robot: RobotModel
    grasps: Rows[Grasp]
    query: ReachQuery
    orders: IntArray


def orders_of(limbs: int) -> IntArray:
    """Orders of N points about the body, first point and sense apart, shape (k, N)."""
    rest = [one for one in permutations(range(1, limbs)) if limbs < 3 or one[0] < one[-1]]
    return np.array([(0, *one) for one in rest], dtype=np.int64)


def farthest_flange(limb: Limb, characteristic_length: float, w_m: float) -> float:
    """An upper bound of the flange's distance from the limb's mount where `w_m` is met [m].

    `w_m` asks for `|s3 s5 u| >= c = w_m l_c^3 / |a2 a3|`. In the arm's plane the flange lies at
    most `D + sqrt(d5^2 + d6^2 s5^2)` from the shoulder, with `D` the distance to the forearm end,
    and `|u| - d6 |s5|` or more from joint 1's axis; across it at most `d4 + d6 |c5|`. The largest
    of what follows is taken over cells of joints 3 and 5, in each with the best ends.
    """
    d1, a2, a3, d4, d5, d6 = np.abs(limb.lengths)
    q3, q5 = (np.linspace(0.0, top, CELLS + 1) for top in (np.pi, 0.5 * np.pi))
    forearm = np.sqrt(np.maximum(a2**2 + a3**2 + 2.0 * a2 * a3 * np.cos(q3[:-1]), 0.0))[:, None]
    middle = (q3[:-1] <= 0.5 * np.pi) & (q3[1:] >= 0.5 * np.pi)
    s3 = np.where(middle, 1.0, np.maximum(np.sin(q3[:-1]), np.sin(q3[1:])))[:, None]
    s5, c5 = np.sin(q5[1:]), np.cos(q5[:-1])
    u = w_m * characteristic_length**3 / (a2 * a3 * s3 * s5)
    possible = u <= forearm + d5
    if not possible.any():
        return 0.0
    plane = forearm + np.sqrt(d5**2 + (d6 * s5) ** 2)
    radial = np.maximum(u - d6 * s5, 0.0)
    height = np.sqrt(np.maximum(plane**2 - radial**2, 0.0))
    square = plane**2 + d1**2 + 2.0 * d1 * height + (d4 + d6 * c5) ** 2
    return float(np.sqrt(square[possible].max()))


def reach_queries(
    robot: RobotSpec,
    w_m: float,
    tries: Sequence[Array],
    target: Array | None = None,
    tolerance: float = np.inf,
) -> Any:
    """A row of `ReachQuery`, shape (1,).

    Parameters
    ----------
    robot
        The robot.
    w_m
        Least limb manipulability.
    tries
        What is tried, see `records.set_candidates`.
    target
        Where the base is to be [m], shape (3,); None for anywhere.
    tolerance
        How near to it [m].
    """
    out = ReachQuery.rows(1)
    set_candidates(out["rule"][0], tries)
    out["rule"]["thresholds"]["w_m"] = w_m
    # The limbs are equal: other robots are not asked, see `PostureSolver.in_reach`.
    limbs_reach = farthest_flange(robot.limb, robot.characteristic_length, w_m)
    out["farthest"] = robot.mount_radius + limbs_reach
    out["target"], out["tolerance"] = 0.0 if target is None else target, tolerance
    return out


@entry
def sets_in_reach(
    start: int,
    stop: int,
    sets: IntArray,
    world: tuple[Rows[RobotModel], Rows[Grasp], Rows[ReachQuery], IntArray],
    out: BoolArray,
    scratch_rows: Rows[ReachScratch],
) -> None:
    """Which sets from `start` to `stop` are in reach.

    Parameters
    ----------
    start
        First set.
    stop
        One past the last.
    sets
        Points of each, shape (k, N).
    world
        A row of `RobotModel`, the map's points as rows of `Grasp`, a row of `ReachQuery`,
        the orders of the points that are tried, see `orders_of`.
    out
        Filled, shape (k,).
    scratch_rows
        A row of `ReachScratch`, shape (1,).
    """
    scratch = scratch_rows[0]
    robots, grasps, queries, orders = world
    shared = _World(robots[0], grasps, queries[0], orders)
    for s in range(start, stop):
        for i in range(sets.shape[1]):
            scratch.points[i] = sets[s, i]
        out[s] = _set_in_reach(shared, scratch)


@kernel
def _set_in_reach(world: _World, scratch: ReachScratch) -> bool:
    """Whether the set in the room is in reach."""
    query, rule, count = world.query, world.query.rule, world.orders.shape[1]
    _middle(world, scratch)
    centre, normal = vector(scratch.centre), vector(scratch.normal)
    opposed = length(normal) < OPPOSED * (1.0 + SLACK)
    upright = length(normal) >= OPPOSED * (1.0 - SLACK)
    highest = rule.heights[rule.height_count - 1]
    if opposed:
        highest = max(highest, rule.wide_heights[rule.wide_height_count - 1])
    if length(minus(vector(query.target), centre)) > query.tolerance + highest:
        return False
    nearest = np.inf
    for k in range(count):
        nearest = min(nearest, _away(k, centre, world, scratch))
    if upright:
        scratch.frame_count, level = UNKNOWN, True
        for k in range(count):
            if _away(k, centre, world, scratch) > nearest + SLACK:
                continue
            line = _line(k, centre, world, scratch)
            if _rolled(line, _unit(normal), level, False, world, scratch):
                return True
            level = False
    if opposed:
        for k in range(count):
            if _away(k, centre, world, scratch) > nearest + SLACK:
                continue
            scratch.frame_count = UNKNOWN
            line, rail = (
                _line(k, centre, world, scratch),
                vector(world.grasps[scratch.points[k]].rail),
            )
            out = _unit(_across(rail, line))
            if length(_across(rail, line)) ** 2 < SLACK:
                out = _unit(
                    _across(cross(vector(world.grasps[scratch.points[k]].normal), rail), line)
                )
            if _rolled(line, out, True, True, world, scratch):
                return True
    return False


@kernel
def _middle(world: _World, scratch: ReachScratch) -> None:
    """Centroid and mean normal of the points in the room."""
    count = world.orders.shape[1]
    for axis in range(3):
        scratch.centre[axis], scratch.normal[axis] = 0.0, 0.0
        for i in range(count):
            grasp = world.grasps[scratch.points[i]]
            scratch.centre[axis] += grasp.point[axis] / count
            scratch.normal[axis] += grasp.normal[axis] / count


@kernel
def _away(k: int, centre: Triple, world: _World, scratch: ReachScratch) -> float:
    """Distance of point `k` from the centroid [m]."""
    return length(minus(vector(world.grasps[scratch.points[k]].point), centre))


@kernel
def _line(k: int, centre: Triple, world: _World, scratch: ReachScratch) -> Triple:
    """The line from the centroid to the grasp of point `k`, about which the body rolls."""
    grasp = world.grasps[scratch.points[k]]
    line = minus(vector(grasp.point), centre)
    return vector(grasp.rail) if length(line) ** 2 < 1e-12 else _unit(line)


@kernel
def _unit(v: Triple) -> Triple:
    """A vector by its length."""
    return along((0.0, 0.0, 0.0), 1.0 / length(v), v)


@kernel
def _across(v: Triple, axis: Triple) -> Triple:
    """Part of a vector at right angles to a unit axis."""
    return along(v, -dot(v, axis), axis)


@kernel
def _set_frames(out: Triple, world: _World, scratch: ReachScratch) -> bool:
    """Unrolled body axes for all orders of the points, both senses where they fit equally well.

    Returns
    -------
    bool
        Whether these are all; not if the points of an order lie in no direction from the centroid.
    """
    e1 = _across((1.0, 0.0, 0.0), out)
    if length(e1) < 0.5:
        e1 = _across((0.0, 1.0, 0.0), out)
    e1 = _unit(e1)
    e2, count = cross(out, e1), world.orders.shape[1]
    scratch.frame_count = 0
    for order in range(len(world.orders)):
        # The fit of the mounts' azimuths to the grasps, and that of the robot turned over.
        along_x, along_y, over_x, over_y = 0.0, 0.0, 0.0, 0.0
        for i in range(count):
            point = world.grasps[scratch.points[world.orders[order, i]]].point
            grasp = minus(vector(point), vector(scratch.centre))
            x, y = dot(grasp, e1), dot(grasp, e2)
            c, s = np.cos(2.0 * np.pi * i / count), np.sin(2.0 * np.pi * i / count)
            along_x, along_y = along_x + x * c + y * s, along_y + y * c - x * s
            over_x, over_y = over_x + x * c - y * s, over_y + y * c + x * s
        fits = np.hypot(along_x, along_y), np.hypot(over_x, over_y)
        if max(fits[0], fits[1]) < SLACK:
            return False
        for over in range(2):
            if fits[over] >= fits[1 - over] * (1.0 - SLACK) - SLACK:
                yaw = np.arctan2(along_y, along_x)
                z = out
                if over:
                    yaw, z = np.arctan2(over_y, over_x), along((0.0, 0.0, 0.0), -1.0, out)
                x_axis = along(along((0.0, 0.0, 0.0), np.cos(yaw), e1), np.sin(yaw), e2)
                _set_frame(x_axis, z, order, scratch)
    return True


@kernel
def _set_frame(x: Triple, z: Triple, order: int, scratch: ReachScratch) -> None:
    """One more of the unrolled body axes."""
    y, rotation = cross(z, x), scratch.frames[scratch.frame_count].rotation
    for axis in range(3):
        rotation[axis, 0], rotation[axis, 1], rotation[axis, 2] = x[axis], y[axis], z[axis]
    scratch.order[scratch.frame_count] = order
    scratch.frame_count += 1


@kernel
def _rolled(
    line: Triple, out: Triple, level: bool, opposed: bool, world: _World, scratch: ReachScratch
) -> bool:
    """Whether the set is in reach from a base pose rolled about a line.

    Parameters
    ----------
    line
        Roll axis.
    out
        Outward direction before the roll.
    level
        Whether a roll of zero counts, which is the same about every line.
    opposed
        Whether rolls and heights are those between opposite walls.
    world
        What all sets share.
    scratch
        The set; its unrolled body axes are worked out if they are needed.
    """
    query, rule, base = world.query, world.query.rule, scratch.base
    roll_count = rule.wide_roll_count if opposed else rule.roll_count
    height_count = rule.wide_height_count if opposed else rule.height_count
    target, centre = vector(query.target), vector(scratch.centre)
    for r in range(roll_count):
        roll = rule.wide_rolls[r] if opposed else rule.rolls[r]
        if roll == 0.0 and not level:
            continue
        cosine, sine = np.cos(roll), np.sin(roll)
        up = turn(line, cosine, sine, out)
        for h in range(height_count):
            height = rule.wide_heights[h] if opposed else rule.heights[h]
            position = along(centre, height, up)
            if length(minus(target, position)) > query.tolerance + SLACK:
                continue
            if not _none_too_far(position, world, scratch):
                continue
            if scratch.frame_count == UNKNOWN and not _set_frames(out, world, scratch):
                return True
            for axis in range(3):
                base.position[axis] = position[axis]
            for f in range(scratch.frame_count):
                _turn_frame(line, cosine, sine, scratch.frames[f], base)
                if _all_reach(scratch.order[f], world, scratch):
                    return True
    return False


@kernel
def _turn_frame(line: Triple, cosine: float, sine: float, frame: Pose, base: Pose) -> None:
    """Turn unrolled body axes about a line, into a base pose."""
    x, y, z = columns(frame.rotation)
    axes = turn(line, cosine, sine, x), turn(line, cosine, sine, y), turn(line, cosine, sine, z)
    for axis in range(3):
        for column in range(3):
            base.rotation[axis, column] = axes[column][axis]


@kernel
def _none_too_far(position: Triple, world: _World, scratch: ReachScratch) -> bool:
    """Whether no flange is farther from the base than a limb reaches."""
    for i in range(world.orders.shape[1]):
        flange = vector(world.grasps[scratch.points[i]].flange.position)
        if length(minus(flange, position)) > world.query.farthest + SLACK:
            return False
    return True


@kernel
def _all_reach(order: int, world: _World, scratch: ReachScratch) -> bool:
    """Whether each limb reaches its point with the `w_m` asked for."""
    robot, least = world.robot, world.query.rule.thresholds.w_m * (1.0 - SLACK)
    for i in range(robot.limb_count):
        limb, point = robot.limbs[i], scratch.points[world.orders[order, i]]
        unit = abs(limb.arm.a2 * limb.arm.a3) / robot.characteristic_length**3
        seen, _ = flange_seen(limb, scratch.base, world.grasps[point].flange)
        branch_terms(limb.arm, seen, scratch.terms)
        square = -1.0
        for row in range(4):
            square = max(square, scratch.terms[row, 3])
        if square <= 0.0 or unit * np.sqrt(square) < least:
            return False
    return True
