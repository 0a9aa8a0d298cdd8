"""Candidate base poses of a stance, from the relative geometry of its grasps alone (compiled).

The body's z axis lies along the mean outward normal of the held points; with two limbs, along its
part perpendicular to the line through the grasps. The yaw (and, for N > 2, the sense of z) follows
from the Procrustes fit of the mounts' azimuths to the grasps. The origin is the centroid of the
grasps plus a height along that direction, after a roll about the line from the centroid to the
grasp of the first limb. Between opposite walls the mean normal vanishes; there the rolls about that
line span a full turn, starting from the rail of the first grasp.

The first limb of two is limb 0: the line reverses when they are exchanged, so no side of the module
is favoured. Of more limbs that are alike it is the one with the grasp closest to the centroid, so
that a cyclic relabelling of the limbs changes nothing, see `relabelling`.

Poses are computed in the frame of the first grasp from coordinates rounded to `RESOLUTION`, so that
stances of the same relative geometry have the same ones to the last bit. A pose is named by its
number, roll by roll and in each by its height, which is all that a table needs to recover it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.bit_sets import EMPTY
from mlivr_gym.compiled.kernels import entry, kernel, part
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.poses import Pose, along, columns, cross, dot, into, minus, turn, vector
from mlivr_gym.postures.records import MapPoints, PostureRule, StanceGeometry
from mlivr_gym.postures.relabelling import turns_to_mounts
from mlivr_gym.robot.fields import geometric_order
from mlivr_gym.robot.sizes import MOST_LIMBS
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.world.grasp_map import GraspMap

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

RESOLUTION = 1e-7
"""Relative positions [m] and directions are rounded to this."""

TIE = 1e-9
"""Relative difference up to which margins, and fits of the mounts, count as equal."""

MIX = np.random.default_rng(0).integers(1, 2**62, (MOST_LIMBS, 3, 3))
"""Weights of the rounded coordinates of limbs in the code of a geometry."""

OPPOSED = 0.2
"""A mean surface normal shorter than this marks a stance between opposite walls."""

OPPOSED_HEIGHTS = (0.15, 0.25, 0.35, 0.45)
"""Candidate distances of the base from the line through the grasps between opposite walls [m]."""

OPPOSED_ROLLS = geometric_order(2.0 * np.pi * np.arange(12) / 12)
"""Candidate rolls between opposite walls [rad], over a full turn."""


def candidates_of(robot: RobotSpec) -> tuple[tuple[Sequence[float], Sequence[float]], ...]:
    """Return a robot's candidate heights [m] and rolls [rad], and those between opposite walls."""
    return (robot.heights, robot.rolls), (OPPOSED_HEIGHTS, OPPOSED_ROLLS)


def pose_rules(robot: RobotSpec) -> Any:
    """Return a record of `PostureRule`, shape (1,), with the candidates of a robot."""
    out, limbs = PostureRule.rows(1), robot.limbs
    for kind, (heights, rolls) in enumerate(candidates_of(robot)):
        out["height_count"][0, kind], out["roll_count"][0, kind] = len(heights), len(rolls)
        out["heights"][0, kind, : len(heights)] = heights
        out["rolls"][0, kind, : len(rolls)] = rolls
    turns = turns_to_mounts(limbs)
    out["mounts"][0, :limbs] = turns[:, :2, 0] if robot.is_symmetric else robot.mount_directions
    out["finds_first"] = limbs > 2 and robot.is_symmetric
    out["turns"][0, :limbs] = turns[-np.arange(limbs)]
    out["tool_length"] = robot.tool_length
    return out


def bases_at(
    grasp_map: GraspMap, robot: RobotSpec, stances: IntArray, numbers: IntArray
) -> tuple[Array, Array]:
    """Return base poses of stances in the world by their numbers among the candidates, (k,).

    They equal those of `Postures` to the last bit. Stances are point indices, shape (k, N);
    returned are positions [m], shape (k, 3), and rotations, shape (k, 3, 3), NaN for no candidate.
    """
    points = MapPoints(grasp_map.positions, grasp_map.rotations)
    out, geometry = Pose.rows(len(stances)), StanceGeometry.rows(1)
    chosen = np.ascontiguousarray(stances), np.asarray(numbers)
    set_bases(*chosen, points, pose_rules(robot), geometry, out)
    return out["position"].copy(), out["rotation"].copy()


@entry
def set_bases(
    stances: IntArray, numbers: IntArray, points: MapPoints, rules: Any, scratch: Any, bases: Any
) -> None:
    """Write base poses by number, see `bases_at`, as records of `Pose`."""
    rule, geometry = rules[0], scratch[0]
    for k in range(len(stances)):
        set_stance(points, rule, stances[k], geometry)
        if 0 <= numbers[k] < pose_count(geometry, rule):
            set_pose(geometry, rule, numbers[k], bases[k])
            place(geometry, bases[k], bases[k])
            turn_to_first(geometry, rule, bases[k])
        else:
            for axis in range(3):
                bases[k].position[axis] = np.nan
                for column in range(3):
                    bases[k].rotation[axis, column] = np.nan


@entry
def set_codes(
    stances: IntArray, points: MapPoints, rules: Any, scratch: Any, codes: IntArray, first: IntArray
) -> None:
    """Write the first limb of each stance, and a code that is the same for the same geometry, (k,).

    The code is a sum of the rounded coordinates by random weights, modulo 2^64: two relative
    geometries that differ have the same one by chance in 2^-62 of all cases.
    """
    rule, geometry = rules[0], scratch[0]
    for k in range(len(stances)):
        set_stance(points, rule, stances[k], geometry)
        first[k], codes[k] = geometry.first, 0
        for limb in range(1, stances.shape[1]):
            grasp = geometry.grasps[limb]
            for axis in range(3):
                for kind, value in enumerate(
                    (grasp.point[axis], grasp.rail[axis], grasp.normal[axis])
                ):
                    codes[k] += int(np.rint(value / RESOLUTION)) * MIX[limb, axis, kind]


@kernel
def set_stance(
    points: MapPoints, rule: PostureRule, stance: IntArray, geometry: StanceGeometry
) -> None:
    """Set the grasps of a stance, as they are seen from that of its first limb, and its axes."""
    limbs, first = len(stance), 0
    if rule.finds_first and not rule.is_given:
        first = first_limb(points.positions, stance, geometry.keys)
    geometry.first, frame, point = first, geometry.place, stance[first]
    for axis in range(3):
        frame.position[axis] = 0.0 if rule.is_given else points.positions[point, axis]
        for column in range(3):
            same = 1.0 if axis == column else 0.0
            here = points.rotations[point, axis, column]
            frame.rotation[axis, column] = same if rule.is_given else here
    for limb in range(limbs):
        point = stance[(first + limb) % limbs]
        rail, _, normal = columns(points.rotations[point])
        away = minus(vector(points.positions[point]), vector(frame.position))
        if not rule.is_given:
            away = rounded(into(frame, away))
            rail = scaled_to_one(rounded(into(frame, rail)))
            normal = scaled_to_one(rounded(into(frame, normal)))
        _set_grasp(away, rail, normal, rule.tool_length, geometry.grasps[limb])
    if not rule.is_given:
        _set_axes(rule, limbs, geometry)


@kernel
def first_limb(positions: Array, stance: IntArray, keys: Array) -> int:
    """Return the limb from which on the rule counts the limbs of a stance.

    It is the limb whose point is closest to the centroid. Among limbs at equal distances, it is the
    one from which on, limb by limb, the distances from the centroid and then the distances to the
    next point are smaller. Only in stances that are images of themselves the axes of the map
    decide: the lower x, y, z. `keys` is scratch, shape (5, at least N).
    """
    limbs, first = len(stance), EMPTY
    for axis in range(3):
        total = positions[stance[0], axis]
        for limb in range(1, limbs):
            total += positions[stance[limb], axis]
        for limb in range(limbs):
            here, after = positions[stance[limb], axis], positions[stance[(limb + 1) % limbs], axis]
            keys[2 + axis, limb] = here
            away, apart = here - total / limbs, after - here
            keys[0, limb] = away * away + (keys[0, limb] if axis else 0.0)
            keys[1, limb] = apart * apart + (keys[1, limb] if axis else 0.0)
    for limb in range(limbs):
        for kind in range(2):
            keys[kind, limb] = np.rint(np.sqrt(keys[kind, limb]) / RESOLUTION)
    for limb in range(1, limbs):
        if _comes_before(limb, first, limbs, keys):
            first = limb
    return first


@kernel
def _comes_before(one: int, other: int, limbs: int, keys: Array) -> bool:
    """Return whether the keys of all limbs from one on, by kind, are smaller than from another."""
    for kind in range(len(keys)):
        for i in range(limbs):
            a, b = keys[kind, (one + i) % limbs], keys[kind, (other + i) % limbs]
            if a != b:
                return bool(a < b)
    return False


@part
def _set_grasp(
    point: Triple, rail: Triple, normal: Triple, tool_length: float, grasp: Grasp
) -> None:
    """Set a grasp by its point, rail and normal, as `grasp_rows` does."""
    into_surface = (-normal[0], -normal[1], -normal[2])
    place, side = along(point, tool_length, normal), cross(into_surface, rail)
    for k in range(3):
        grasp.point[k], grasp.rail[k], grasp.normal[k] = point[k], rail[k], normal[k]
        grasp.flange.position[k] = place[k]
    set_columns(grasp.flange.rotation, rail, side, into_surface)


@kernel
def _set_axes(rule: PostureRule, limbs: int, geometry: StanceGeometry) -> None:
    """Set centroid, body axes at roll zero, outward direction and roll axis of a stance."""
    grasps = geometry.grasps
    x, y, z = vector(grasps[0].point)
    for limb in range(1, limbs):
        point = grasps[limb].point
        x, y, z = x + point[0], y + point[1], z + point[2]
    centroid = x / limbs, y / limbs, z / limbs
    rail, first_normal = vector(grasps[0].rail), vector(grasps[0].normal)
    line, outward = minus(vector(grasps[0].point), centroid), first_normal
    if dot(line, line) < 1e-12:
        line = rail
    line = scaled_to_one(line)
    for limb in range(1, limbs):
        outward = along(outward, 1.0, vector(grasps[limb].normal))
    outward = outward[0] / limbs, outward[1] / limbs, outward[2] / limbs
    if limbs == 2:
        outward = perpendicular(outward, line)
    opposed = dot(outward, outward) < OPPOSED * OPPOSED
    # Where the rail lies along the axis it is projected on, the direction across it serves.
    side = cross(first_normal, rail)
    if opposed:
        outward = perpendicular(rail, line)
        if dot(outward, outward) < 1e-6:
            outward = perpendicular(side, line)
    outward = scaled_to_one(outward)
    e1 = perpendicular(rail, outward)
    if dot(e1, e1) < 1e-6:
        e1 = perpendicular(side, outward)
    e1 = scaled_to_one(e1)
    e2 = cross(outward, e1)
    for k in range(3):
        geometry.centroid[k], geometry.out[k], geometry.line[k] = centroid[k], outward[k], line[k]
    geometry.opposed = 1 if opposed else 0
    cosine, sine, is_mirrored = _fit_yaw(rule, limbs, geometry, e1, e2)
    forward = (
        cosine * e1[0] + sine * e2[0],
        cosine * e1[1] + sine * e2[1],
        cosine * e1[2] + sine * e2[2],
    )
    up = (-outward[0], -outward[1], -outward[2]) if is_mirrored else outward
    set_columns(geometry.frame, forward, cross(up, forward), up)


@part
def _fit_yaw(
    rule: PostureRule, limbs: int, geometry: StanceGeometry, e1: Triple, e2: Triple
) -> tuple[float, float, bool]:
    """Fit the mounts' azimuths to the grasps by Procrustes, in axes across the body's z axis.

    Returned are cosine and sine of the yaw, and whether the reversed order of the mounts fits
    better.
    """
    fit_c = fit_s = mirrored_c = mirrored_s = 0.0
    for limb in range(limbs):
        c, s = rule.mounts[limb, 0], rule.mounts[limb, 1]
        grasp = minus(vector(geometry.grasps[limb].point), vector(geometry.centroid))
        u, v = dot(grasp, e1), dot(grasp, e2)
        fit_c, fit_s = fit_c + (u * c + v * s), fit_s + (v * c - u * s)
        mirrored_c, mirrored_s = mirrored_c + (u * c - v * s), mirrored_s + (v * c + u * s)
    size = np.sqrt(fit_c * fit_c + fit_s * fit_s)
    mirrored_size = np.sqrt(mirrored_c * mirrored_c + mirrored_s * mirrored_s)
    is_mirrored = mirrored_size > size * (1.0 + TIE) + TIE
    if is_mirrored:
        fit_c, fit_s, size = mirrored_c, mirrored_s, mirrored_size
    if size == 0.0:
        return 1.0, fit_s, is_mirrored
    return fit_c / size, fit_s / size, is_mirrored


@kernel
def pose_count(geometry: StanceGeometry, rule: PostureRule) -> int:
    """Return the number of candidate base poses of a stance."""
    return int(rule.roll_count[geometry.opposed] * rule.height_count[geometry.opposed])


@kernel
def set_pose(geometry: StanceGeometry, rule: PostureRule, number: int, base: Pose) -> None:
    """Set `base` to a candidate base pose of a stance, in the frame of its first grasp."""
    kind, line, (x, y, z) = geometry.opposed, vector(geometry.line), columns(geometry.frame)
    roll = rule.rolls[kind, number // rule.height_count[kind]]
    height = rule.heights[kind, number % rule.height_count[kind]]
    c, s = math.cos(roll), math.sin(roll)
    up = turn(line, c, s, vector(geometry.out))
    set_columns(base.rotation, turn(line, c, s, x), turn(line, c, s, y), turn(line, c, s, z))
    for k in range(3):
        base.position[k] = height * up[k] + geometry.centroid[k]


@kernel
def place(geometry: StanceGeometry, base: Pose, out: Pose) -> None:
    """Set `out` to a base pose of the frame of a stance in the world, as if limb 0 came first."""
    frame = geometry.place.rotation
    there, (x, y, z) = turned(frame, vector(base.position)), columns(base.rotation)
    for k in range(3):
        out.position[k] = geometry.place.position[k] + there[k]
    set_columns(out.rotation, turned(frame, x), turned(frame, y), turned(frame, z))


@kernel
def turn_to_first(geometry: StanceGeometry, rule: PostureRule, base: Pose) -> None:
    """Turn the base about its z axis so that the first limb comes where limb 0 was."""
    x, y, z = columns(rule.turns[geometry.first])
    frame = base.rotation
    set_columns(frame, turned(frame, x), turned(frame, y), turned(frame, z))


@kernel
def turned(frame: Array, v: Triple) -> Triple:
    """Return a vector of a frame, shape (3, 3), in the axes outside it."""
    x, y, z = v
    return (
        frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z,
        frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z,
        frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z,
    )


@kernel
def set_columns(frame: Array, x: Triple, y: Triple, z: Triple) -> None:
    """Write the columns of a frame, shape (3, 3)."""
    for k in range(3):
        frame[k, 0], frame[k, 1], frame[k, 2] = x[k], y[k], z[k]


@kernel
def rounded(v: Triple) -> Triple:
    """Return a vector with each coordinate at the closest multiple of `RESOLUTION`."""
    return (
        int(np.rint(v[0] / RESOLUTION)) * RESOLUTION,
        int(np.rint(v[1] / RESOLUTION)) * RESOLUTION,
        int(np.rint(v[2] / RESOLUTION)) * RESOLUTION,
    )


@kernel
def scaled_to_one(v: Triple) -> Triple:
    """Return a vector scaled to length 1."""
    size = np.sqrt(dot(v, v))
    return v[0] / size, v[1] / size, v[2] / size


@kernel
def perpendicular(v: Triple, axis: Triple) -> Triple:
    """Return the part of a vector that is perpendicular to a unit axis."""
    share = dot(v, axis)
    return v[0] - axis[0] * share, v[1] - axis[1] * share, v[2] - axis[2] * share
