"""Distances between pairs of shapes, for explanations, pictures and tests.

This is the plain definition of the collision checks: every pair is compared, without a grid. Only
the body is its exact box here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product
from typing import Any

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.against_boxes import FLUSH
from mlivr_gym.collisions.allowed_collisions import BODY
from mlivr_gym.collisions.distances import segment_box_distance, segments_distance
from mlivr_gym.collisions.limb_shapes import LimbShapes, ShapesOfLimb, cargo_capsules
from mlivr_gym.collisions.placement import Placed, place_in_body
from mlivr_gym.errors import SettingError
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import Anything, FieldPath, ListOf, Numbers
from mlivr_gym.values import MAX_LENGTH, Triple, as_triple
from mlivr_gym.world.boxes import BOX, Box, scene_name

Configuration = tuple[Array, Array, Array]
"""Base position [m] and quaternion w, x, y, z in the world, and joint angles (N, 6) [rad]."""

Pair = tuple[str, str, float]
"""Names of two shapes and the distance between their surfaces [m]."""

PLACE = Numbers((3,), most=MAX_LENGTH, unit="m")
"""Validator of a base position."""


@dataclass(frozen=True)
class Contact:
    """Two shapes that are closer to each other than the clearance."""

    first: str
    """A shape of the robot by its name in the scene: `"limb0/forearm/0"` or `"body"`."""
    second: str
    """Another shape of the robot, or a box: `"box/{id}"`."""
    distance: float
    """Distance between the surfaces [m]. It is negative where a capsule penetrates, and 0 where the
    body penetrates a box."""


def capsule_ends(robot: RobotSpec, shapes: LimbShapes, configuration: Configuration) -> Array:
    """Return the ends of the moving capsules of all limbs in the world, shape (N, c, 2, 3) [m].

    There are at most c capsules on each of N limbs; what a limb has fewer is NaN. Raises a
    `SettingError` if the configuration is not one of the robot.
    """
    position, quaternion, joints = checked_configuration(robot, configuration)
    base = scipy.spatial.transform.Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    most = max(len(limb.names) for limb in shapes.each)
    out, placed = np.full((robot.limbs, most, 2, 3), np.nan), Placed.rows(1)
    for i in range(robot.limbs):
        placed["q"] = joints[i]
        place_in_body(shapes.rows, i, placed)
        count = len(shapes.each[i].names)
        out[i, :count] = placed["in_body"]["ends"][0, :count]
    ends: Array = out @ base.T + position
    return ends


def checked_configuration(robot: RobotSpec, configuration: Any) -> Configuration:
    """Check a configuration of a robot and return it as arrays of finite numbers.

    Raises a `SettingError` if its shape or a number is wrong.
    """
    parts = ListOf(Anything(), 3, 3).read(configuration, FieldPath("configuration", SettingError))
    position, quaternion, joints = parts
    turn = Numbers((4,)).read(quaternion, FieldPath("base quaternion w, x, y, z", SettingError))
    if not np.any(turn):
        raise SettingError("base quaternion w, x, y, z is zero; it must have length 1")
    angles = FieldPath("joint angles, six for each limb,", SettingError)
    return (
        PLACE.read(position, FieldPath("base position", SettingError)),
        turn,
        Numbers((robot.limbs, 6)).read(joints, angles),
    )


def contacts(
    robot: RobotSpec,
    boxes: Sequence[Box],
    configuration: Configuration,
    clearance: float,
    grasps: Sequence[tuple[int, Array, Array]] = (),
) -> list[Contact]:
    """Find all pairs of shapes closer to each other than the clearance [m], the closest first.

    Penetrating pairs are included. All pairs are compared except `ALLOWED_COLLISIONS`. The body is
    its exact box here; the compiled checks compare boxes with capsules that contain the body
    instead, see `limb_shapes.box_capsules`. Of each limb at a grasp, `grasps` has limb, point [m]
    and surface normal in the world: its gripper may touch the boxes behind the surface. Raises a
    `SettingError` if the configuration is not one of the robot.
    """
    shapes, configuration = _shapes(robot), checked_configuration(robot, configuration)
    ends = capsule_ends(robot, shapes, configuration)
    rotation = scipy.spatial.transform.Rotation.from_quat(configuration[1], scalar_first=True)
    pairs = [
        *_robot_distances(robot, shapes, (ends - configuration[0]) @ rotation.as_matrix()),
        *box_distances(robot, boxes, configuration, clearance, grasps),
    ]
    close = [Contact(*pair) for pair in pairs if pair[2] < clearance or pair[2] <= 0.0]
    return sorted(close, key=lambda contact: contact.distance)


def box_distances(
    robot: RobotSpec,
    boxes: Sequence[Box],
    configuration: Configuration,
    clearance: float,
    grasps: Sequence[tuple[int, Array, Array]] = (),
) -> Iterator[Pair]:
    """Yield the distances of the robot from boxes that may be closer than the clearance.

    Parameters are those of `contacts`.
    """
    shapes, (position, quaternion, _) = _shapes(robot), configuration
    ends = capsule_ends(robot, shapes, configuration)
    rotation = scipy.spatial.transform.Rotation.from_quat(quaternion, scalar_first=True)
    at_grasp = {limb: (point, normal) for limb, point, normal in grasps}
    yield from _limb_box_distances(shapes, boxes, ends, at_grasp, clearance)
    yield from _base_box_distances(
        robot, shapes, boxes, (position, rotation.as_matrix()), clearance
    )


def _robot_distances(robot: RobotSpec, shapes: LimbShapes, ends: Array) -> Iterator[Pair]:
    """Yield the distances between the robot's own shapes; `ends` are in the body frame [m]."""
    fixed, half = mount_names(robot), as_triple(shapes.robot["half"])
    for i in range(robot.limbs):
        limb, names = shapes.each[i], _names(shapes.each[i])
        radius = limb.radii
        for c in range(len(names)):
            name = f"limb{i}/{names[c]}"
            p, u = _axis(ends[i, c])
            if limb.links[c] >= 2:
                yield name, BODY, segment_box_distance(p, u, half) - radius[c]
                for m, (mount, row) in enumerate(zip(fixed, shapes.mounts, strict=True)):
                    if limb.links[c] >= shapes.robot["limbs"][i]["first_link"][m]:
                        distance = segments_distance(p, u, *_axis(row["ends"]))
                        yield name, mount, distance - radius[c] - row["radius"]
            for d, j in limb.pairs.tolist():
                if d == c:
                    distance = segments_distance(p, u, *_axis(ends[i, j]))
                    yield name, f"limb{i}/{names[j]}", distance - radius[c] - radius[j]
            for k in range(i + 1, robot.limbs):
                for j, other in enumerate(_names(shapes.each[k])):
                    distance = segments_distance(p, u, *_axis(ends[k, j]))
                    yield name, f"limb{k}/{other}", distance - radius[c] - shapes.each[k].radii[j]


def _limb_box_distances(
    shapes: LimbShapes,
    boxes: Sequence[Box],
    ends: Array,
    at_grasp: dict[int, tuple[Array, Array]],
    clearance: float,
) -> Iterator[Pair]:
    """Yield the distances of moving capsules from boxes that may be closer than the clearance."""
    for i, parts in enumerate(shapes.each):
        radius, names = parts.radii, _names(parts)
        limb, gripper = ends[i, : len(names)], int(shapes.robot["limbs"][i]["gripper"])
        around = _boxes_nearby(limb, radius, boxes, clearance)
        for c, axis in enumerate(limb):
            for box in (boxes[b] for b in around[c]):
                if c >= gripper and i in at_grasp and lies_behind(box, *at_grasp[i]):
                    continue
                yield (
                    f"limb{i}/{names[c]}",
                    scene_name(BOX, box.id),
                    _box_distance(axis, box) - radius[c],
                )


def _base_box_distances(
    robot: RobotSpec,
    shapes: LimbShapes,
    boxes: Sequence[Box],
    base: tuple[Array, Array],
    clearance: float,
) -> Iterator[Pair]:
    """Yield the distances of body and mounts from boxes that may be closer than the clearance."""
    position, rotation = base
    half, names = shapes.robot["half"], mount_names(robot)
    centre, reach = np.stack([position, position])[None], np.array([np.linalg.norm(half)])
    for box in (boxes[b] for b in _boxes_nearby(centre, reach, boxes, clearance)[0]):
        place = tuple(position.tolist()), tuple(half.tolist()), Box.rows(rotation)
        body = Box(BODY, "obstacle", *place)
        # The closest, or first common, points of two boxes lie on an edge of one of them.
        edges = [(axis, box) for axis in _edges(body)] + [(axis, body) for axis in _edges(box)]
        yield BODY, scene_name(BOX, box.id), min(_box_distance(*pair) for pair in edges)
    axes, radius = position + shapes.mounts["ends"] @ rotation.T, shapes.mounts["radius"]
    for m, around in enumerate(_boxes_nearby(axes, radius, boxes, clearance)):
        for box in (boxes[b] for b in around):
            yield names[m], scene_name(BOX, box.id), _box_distance(axes[m], box) - radius[m]


def _boxes_nearby(
    axes: Array, radius: Array, boxes: Sequence[Box], clearance: float
) -> list[list[int]]:
    """Return the indices of the boxes that may be closer to each capsule than the clearance.

    They are selected by the bounding ball of the capsule. `axes` holds the ends of the capsules,
    shape (c, 2, 3) [m]; `radius` has shape (c,) [m].
    """
    if not boxes:
        return [[] for _ in axes]
    from_centres = axes.mean(axis=1)[:, None] - np.array([box.centre for box in boxes])
    inside = np.einsum("cbi,bij->cbj", from_centres, np.array([box.rotation for box in boxes]))
    outside = np.maximum(np.abs(inside) - np.array([box.half for box in boxes]), 0.0)
    reach = radius + 0.5 * np.linalg.norm(axes[:, 1] - axes[:, 0], axis=1) + max(0.0, clearance)
    close = np.linalg.norm(outside, axis=2) <= reach[:, None] + 1e-9
    return [np.flatnonzero(row).tolist() for row in close]


def _box_distance(axis: Array, box: Box) -> float:
    """Return the distance of a segment, shape (2, 3), from a box [m]; 0 if they intersect."""
    start, end = (axis - np.array(box.centre)) @ np.array(box.rotation)
    return float(segment_box_distance(tuple(start), tuple(end - start), box.half))


def _axis(ends: Array) -> tuple[Triple, Triple]:
    """Return one end of a segment, shape (2, 3), and the vector to its other end."""
    return as_triple(ends[0]), as_triple(ends[1] - ends[0])


def _edges(box: Box) -> Array:
    """Return the twelve edges of a box [m], shape (12, 2, 3)."""
    corners = np.array(list(product((-1.0, 1.0), repeat=3)))
    ends = [(a, b) for a, b in combinations(corners, 2) if (a != b).sum() == 1]
    edges: Array = np.array(box.centre) + (np.array(ends) * box.half) @ np.array(box.rotation).T
    return edges


def mount_names(robot: RobotSpec) -> list[str]:
    """Return the names of the capsules fixed to the body, limb by limb, then those of the cargo."""
    counts = [sum(c.link == "base" for c in mount.capsules or ()) for mount in robot.mounted]
    names = [f"limb{i}/base/{m}" for i, count in enumerate(counts) for m in range(count)]
    return names + [f"cargo/{m}" for m in range(len(cargo_capsules(robot)[1]))]


@lru_cache(maxsize=8)
def _shapes(robot: RobotSpec) -> LimbShapes:
    """Return a robot's collision shapes, cached."""
    return LimbShapes(robot)


def _names(shapes: ShapesOfLimb) -> list[str]:
    """Return the names of a limb's moving capsules: the link, and the number on that link."""
    return [f"{name}/{shapes.names[:c].count(name)}" for c, name in enumerate(shapes.names)]


def lies_behind(box: Box, point: Array, normal: Array) -> bool:
    """Return whether a box protrudes by at most `FLUSH` from the surface at a point."""
    reach = np.abs(np.array(box.rotation).T @ normal) @ np.array(box.half)
    return float((np.array(box.centre) - point) @ normal + reach) <= FLUSH
