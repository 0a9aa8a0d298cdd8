"""Necessary reach condition for sets of graspable points to be held at once (compiled).

Only the points of a stance matter here, not which limb holds which. A set is in reach if, from one
of the candidate base poses and for some assignment of the points to the limbs, every limb reaches
its point with the threshold of `w_m`. Every node satisfies this whatever its surroundings, so a set
out of reach contains the points of no node.

A robot whose limbs are alike looks the same after a cyclic relabelling of them, and, if their first
joints turn freely, after a half turn about its roll axis. Orders of the points around its body
therefore count once if they differ only in their first point or their sense. Its roll axis passes
through the point closest to the centroid, see `solver`; of points at equal distances each is
evaluated. That of a robot whose limbs differ passes through the point of limb 0.
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
from mlivr_gym.postures.base_frames import OPPOSED, perpendicular, scaled_to_one
from mlivr_gym.postures.records import PostureRule, set_candidates
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.values import Triple

SLACK = 1e-6
"""Relative tolerance of `w_m` and of equal directions, since postures use rounded coordinates."""

MOST_FRAMES = 48
"""Maximum number of body axes of a set: both senses of all cyclic orders of five limbs."""

UNKNOWN = -1
"""Value of `ReachScratch.frame_count` while the body axes are not computed."""


class ReachQuery(Record):
    """The reach condition that sets of points must meet."""

    rule: PostureRule
    """Candidate base poses, and the threshold of `w_m`."""
    mounts: Annotated[Array, (8, 2)]
    """Directions of the mounts across the body's z axis."""
    begins_with_limb_0: bool
    """Whether the roll axis is that of limb 0, and not of the limb closest to the centroid."""
    farthest: float
    """Upper bound of the distance of a flange from the base origin at that threshold [m]."""
    target: Vector
    """Requested base position [m]."""
    tolerance: float
    """Maximum distance of the base from it [m]; infinite for any position."""


class ReachScratch(Record):
    """Scratch for one set."""

    points: Annotated[IntArray, (8,), np.int64]
    """Points of the set."""
    centre: Vector
    """Their centroid [m]."""
    normal: Vector
    """Their mean surface normal."""
    frame_count: int
    """Number of body axes at roll zero; `UNKNOWN` until they are computed."""
    frames: Annotated[Rows[Pose], (MOST_FRAMES,)]
    """These body axes."""
    first: int
    """Point of limb 0 in the orders that count; `UNKNOWN` for any."""
    order: Annotated[IntArray, (MOST_FRAMES,), np.int64]
    """Index of the order of the points for which each was computed."""
    base: Pose
    """Candidate base pose."""
    terms: Annotated[Array, (4, 4)]
    """Terms of the inverse kinematics of each class of branches."""


class _ReachWorld(NamedTuple):
    """What all sets share: robot, graspable points, query, and orders of the points."""

    robot: RobotModel
    grasps: Rows[Grasp]
    query: ReachQuery
    orders: IntArray


def orders_of(robot: RobotSpec) -> IntArray:
    """Return the orders of N points around the body, shape (k, N).

    Orders that differ only in their first point are listed once if the limbs are alike, and those
    that differ only in their sense if no first joint is held, too.
    """
    every, limbs = list(permutations(range(robot.limbs))), robot.limbs
    if robot.is_symmetric:
        turns = limbs > 2 and robot.limb.base_in_mount is None and robot.mounts is None
        every = [one for one in every if one[0] == 0 and (not turns or one[1] < one[-1])]
    return np.array(every, dtype=np.int64)


def reach_queries(
    robot: RobotSpec,
    w_m: float,
    heights_and_rolls: Sequence[Array],
    target: Array | None = None,
    tolerance: float = np.inf,
) -> Any:
    """Return the reach condition of a robot as a record of `ReachQuery`, shape (1,).

    `w_m` is the threshold of limb manipulability; for the heights and rolls of the candidates see
    `records.set_candidates`. A base position `target` (3,) [m] may be requested, from which the
    base is at most `tolerance` away [m].
    """
    out = ReachQuery.rows(1)
    set_candidates(out["rule"][0], heights_and_rolls)
    out["rule"]["thresholds"]["w_m"] = w_m
    out["farthest"] = max(
        float(np.linalg.norm(place)) + limb.farthest_flange(robot.characteristic_length, w_m)
        for place, limb in zip(robot.mount_positions, robot.every_limb, strict=True)
    )
    angles = 2.0 * np.pi * np.arange(robot.limbs) / robot.limbs
    even = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    out["mounts"][0, : robot.limbs] = even if robot.is_symmetric else robot.mount_directions
    out["begins_with_limb_0"] = not robot.is_symmetric
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
    """Find which sets of points (k, N) from `start` to `stop`, excluded, are in reach.

    `world` has a record of `RobotModel`, the map's points as records of `Grasp`, a record of
    `ReachQuery`, and the orders of the points from `orders_of`. `out`, shape (k,), is filled.
    """
    scratch = scratch_rows[0]
    robots, grasps, queries, orders = world
    shared = _ReachWorld(robots[0], grasps, queries[0], orders)
    for s in range(start, stop):
        for i in range(sets.shape[1]):
            scratch.points[i] = sets[s, i]
        out[s] = _set_in_reach(shared, scratch)


@kernel
def _set_in_reach(world: _ReachWorld, scratch: ReachScratch) -> bool:
    """Return whether the set of points in the scratch is in reach."""
    query, rule, count = world.query, world.query.rule, world.orders.shape[1]
    _set_centroid(world, scratch)
    centre, normal = vector(scratch.centre), vector(scratch.normal)
    opposed = length(normal) < OPPOSED * (1.0 + SLACK)
    upright = length(normal) >= OPPOSED * (1.0 - SLACK)
    highest = rule.heights[rule.height_count - 1]
    if opposed:
        highest = max(highest, rule.opposed_heights[rule.opposed_height_count - 1])
    if length(minus(vector(query.target), centre)) > query.tolerance + highest:
        return False
    nearest = np.inf
    for k in range(count):
        nearest = min(nearest, _centroid_distance(k, centre, world, scratch))
    scratch.first = UNKNOWN
    if query.begins_with_limb_0:
        nearest = np.inf
    if upright:
        scratch.frame_count, with_zero_roll = UNKNOWN, True
        for k in range(count):
            if _centroid_distance(k, centre, world, scratch) > nearest + SLACK:
                continue
            if query.begins_with_limb_0:
                scratch.frame_count, scratch.first, with_zero_roll = UNKNOWN, k, True
            line = _roll_axis(k, centre, world, scratch)
            if _is_reached_about(
                line, scaled_to_one(normal), with_zero_roll, False, world, scratch
            ):
                return True
            with_zero_roll = False
    if opposed:
        for k in range(count):
            if _centroid_distance(k, centre, world, scratch) > nearest + SLACK:
                continue
            scratch.frame_count = UNKNOWN
            if query.begins_with_limb_0:
                scratch.first = k
            line, rail = (
                _roll_axis(k, centre, world, scratch),
                vector(world.grasps[scratch.points[k]].rail),
            )
            out = scaled_to_one(perpendicular(rail, line))
            if length(perpendicular(rail, line)) ** 2 < SLACK:
                out = scaled_to_one(
                    perpendicular(cross(vector(world.grasps[scratch.points[k]].normal), rail), line)
                )
            if _is_reached_about(line, out, True, True, world, scratch):
                return True
    return False


@kernel
def _set_centroid(world: _ReachWorld, scratch: ReachScratch) -> None:
    """Compute the centroid and mean normal of the points in the scratch."""
    count = world.orders.shape[1]
    for axis in range(3):
        scratch.centre[axis], scratch.normal[axis] = 0.0, 0.0
        for i in range(count):
            grasp = world.grasps[scratch.points[i]]
            scratch.centre[axis] += grasp.point[axis] / count
            scratch.normal[axis] += grasp.normal[axis] / count


@kernel
def _centroid_distance(k: int, centre: Triple, world: _ReachWorld, scratch: ReachScratch) -> float:
    """Return the distance of point `k` from the centroid [m]."""
    return length(minus(vector(world.grasps[scratch.points[k]].point), centre))


@kernel
def _roll_axis(k: int, centre: Triple, world: _ReachWorld, scratch: ReachScratch) -> Triple:
    """Return the unit vector from the centroid to point `k`, about which the body rolls."""
    grasp = world.grasps[scratch.points[k]]
    line = minus(vector(grasp.point), centre)
    return vector(grasp.rail) if length(line) ** 2 < 1e-12 else scaled_to_one(line)


@kernel
def _set_frames(out: Triple, world: _ReachWorld, scratch: ReachScratch) -> bool:
    """Compute the body axes at roll zero for all orders of the points.

    Where both senses of an order fit equally well, both are included. Returned is False if the
    points of an order do not determine the yaw.
    """
    e1 = perpendicular((1.0, 0.0, 0.0), out)
    if length(e1) < 0.5:
        e1 = perpendicular((0.0, 1.0, 0.0), out)
    e1 = scaled_to_one(e1)
    e2, count = cross(out, e1), world.orders.shape[1]
    scratch.frame_count = 0
    for order in range(len(world.orders)):
        if scratch.first != UNKNOWN and world.orders[order, 0] != scratch.first:
            continue
        # Procrustes fits of the mounts' azimuths to the grasps, for both senses of the body z axis.
        along_x, along_y, over_x, over_y = 0.0, 0.0, 0.0, 0.0
        for i in range(count):
            grasp = world.grasps[scratch.points[world.orders[order, i]]]
            offset = minus(vector(grasp.point), vector(scratch.centre))
            x, y = dot(offset, e1), dot(offset, e2)
            c, s = world.query.mounts[i, 0], world.query.mounts[i, 1]
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
    """Append body axes to those of the set."""
    y, rotation = cross(z, x), scratch.frames[scratch.frame_count].rotation
    for axis in range(3):
        rotation[axis, 0], rotation[axis, 1], rotation[axis, 2] = x[axis], y[axis], z[axis]
    scratch.order[scratch.frame_count] = order
    scratch.frame_count += 1


@kernel
def _is_reached_about(
    line: Triple,
    out: Triple,
    with_zero_roll: bool,
    opposed: bool,
    world: _ReachWorld,
    scratch: ReachScratch,
) -> bool:
    """Return whether the set is in reach from a base pose rolled about a line.

    `line` is the roll axis, `out` the outward direction before the roll. Roll zero, which is the
    same about every line, is looked at if `with_zero_roll`; if `opposed`, rolls and heights are
    those between opposite walls. Body axes are computed if they are needed.
    """
    query, rule, base = world.query, world.query.rule, scratch.base
    roll_count = rule.opposed_roll_count if opposed else rule.roll_count
    height_count = rule.opposed_height_count if opposed else rule.height_count
    target, centre = vector(query.target), vector(scratch.centre)
    for r in range(roll_count):
        roll = rule.opposed_rolls[r] if opposed else rule.rolls[r]
        if roll == 0.0 and not with_zero_roll:
            continue
        cosine, sine = np.cos(roll), np.sin(roll)
        up = turn(line, cosine, sine, out)
        for h in range(height_count):
            height = rule.opposed_heights[h] if opposed else rule.heights[h]
            position = along(centre, height, up)
            if length(minus(target, position)) > query.tolerance + SLACK:
                continue
            if not _is_within_bound(position, world, scratch):
                continue
            if scratch.frame_count == UNKNOWN and not _set_frames(out, world, scratch):
                return True
            for axis in range(3):
                base.position[axis] = position[axis]
            for f in range(scratch.frame_count):
                _roll_frame(line, cosine, sine, scratch.frames[f], base)
                if _all_limbs_reach(scratch.order[f], world, scratch):
                    return True
    return False


@kernel
def _roll_frame(line: Triple, cosine: float, sine: float, frame: Pose, base: Pose) -> None:
    """Roll body axes about a line into the rotation of a base pose."""
    x, y, z = columns(frame.rotation)
    axes = turn(line, cosine, sine, x), turn(line, cosine, sine, y), turn(line, cosine, sine, z)
    for axis in range(3):
        for column in range(3):
            base.rotation[axis, column] = axes[column][axis]


@kernel
def _is_within_bound(position: Triple, world: _ReachWorld, scratch: ReachScratch) -> bool:
    """Return whether no flange is farther from the base than any limb can reach."""
    for i in range(world.orders.shape[1]):
        flange = vector(world.grasps[scratch.points[i]].flange.position)
        if length(minus(flange, position)) > world.query.farthest + SLACK:
            return False
    return True


@kernel
def _all_limbs_reach(order: int, world: _ReachWorld, scratch: ReachScratch) -> bool:
    """Return whether every limb reaches its point with the threshold of `w_m`."""
    robot, least = world.robot, world.query.rule.thresholds.w_m * (1.0 - SLACK)
    for i in range(robot.limb_count):
        limb, point = robot.limbs[i], scratch.points[world.orders[order, i]]
        unit = limb.arm.links / robot.characteristic_length**3
        seen, _ = flange_seen(limb, scratch.base, world.grasps[point].flange)
        branch_terms(limb.arm, seen, scratch.terms)
        square = -1.0
        for row in range(4):
            square = max(square, scratch.terms[row, 3])
        if square <= 0.0 or unit * np.sqrt(square) < least:
            return False
    return True
