"""Which shapes of a robot are close to what, pair by pair: for explanations, pictures and tests."""

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
from mlivr_gym.collisions.limb_shapes import LimbShapes, ShapesOfLimb
from mlivr_gym.collisions.placement import Placed, place_in_body
from mlivr_gym.errors import SettingError
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import Anything, FieldPath, Listed
from mlivr_gym.values import LONGEST, Triple, numbers, triple
from mlivr_gym.world.boxes import BOX, Box, scene_name

Configuration = tuple[Array, Array, Array]
"""Base position [m] and quaternion w, x, y, z in the world, and joint angles (N, 6) [rad]."""

Pair = tuple[str, str, float]
"""Names of two shapes and the distance of their surfaces [m]."""


@dataclass(frozen=True)
class Contact:
    """Two shapes that are closer than the clearance.

    Attributes
    ----------
    first
        A shape of the robot, as the scene names it: `"limb0/forearm/0"` or `"body"`.
    second
        Another of its shapes, or a box: `"box/{id}"`.
    distance
        Distance of the surfaces [m], negative where a capsule overlaps, 0 where the body
        reaches into a box.
    """

    first: str
    second: str
    distance: float


def capsule_ends(robot: RobotSpec, shapes: LimbShapes, configuration: Configuration) -> Array:
    """Ends of the limbs' moving capsules in the world [m], shape (N, c, 2, 3).

    If limbs have different numbers of capsules, c is the largest, and what is not there is NaN.

    Raises
    ------
    SettingError
        If the configuration is none of the robot.
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
    """A configuration of a robot, of finite numbers.

    Raises
    ------
    SettingError
        If it is none.
    """
    parts = Listed(Anything(), 3, 3).read(configuration, FieldPath("configuration", SettingError))
    position, quaternion, joints = parts
    turn = numbers(quaternion, (4,), "base quaternion w, x, y, z", SettingError)
    if not np.any(turn):
        raise SettingError("base quaternion w, x, y, z is zero; it must have length 1")
    return (
        numbers(position, (3,), "base position", SettingError, LONGEST),
        turn,
        numbers(joints, (robot.limbs, 6), "joint angles, six a limb,", SettingError),
    )


def contacts(
    robot: RobotSpec,
    boxes: Sequence[Box],
    configuration: Configuration,
    clearance: float,
    grasps: Sequence[tuple[int, Array, Array]] = (),
) -> list[Contact]:
    """Every pair of shapes that is compared and closer than the clearance, the closest first.

    Pairs that overlap count too. All are compared but those of `ALLOWED_COLLISIONS`. The body
    is the box that it is; the compiled checks take capsules that contain it where they compare it
    with boxes, `limb_shapes.round_cube`.

    Parameters
    ----------
    robot
        The robot.
    boxes
        What stands round it.
    configuration
        Where it is.
    clearance
        Least distance [m].
    grasps
        Limb, and point [m] and surface normal in the world, of each limb at a grasp: its
        gripper may come close to what lies behind.

    Raises
    ------
    SettingError
        If the configuration is none of the robot.
    """
    shapes, configuration = _shapes(robot), checked_configuration(robot, configuration)
    ends = capsule_ends(robot, shapes, configuration)
    base = scipy.spatial.transform.Rotation.from_quat(
        configuration[1], scalar_first=True
    ).as_matrix()
    at_grasp = {limb: (point, normal) for limb, point, normal in grasps}
    found = [
        *_among_themselves(robot, shapes, (ends - configuration[0]) @ base),
        *_limbs_with_boxes(shapes, boxes, ends, at_grasp, clearance),
        *_base_with_boxes(robot, shapes, boxes, (configuration[0], base), clearance),
    ]
    close = [Contact(*pair) for pair in found if pair[2] < clearance or pair[2] <= 0.0]
    return sorted(close, key=lambda contact: contact.distance)


def _among_themselves(robot: RobotSpec, shapes: LimbShapes, ends: Array) -> Iterator[Pair]:
    """Distances of the robot's shapes from each other; `ends` of capsules in the body frame."""
    fixed, half = mount_names(robot), triple(shapes.robot["half"])
    for i in range(robot.limbs):
        limb, names = shapes.each[i], _names(shapes.each[i])
        radius = limb.radii
        for c in range(len(names)):
            name = f"limb{i}/{names[c]}"
            p, u = _axis(ends[i, c])
            if limb.links[c] >= 2:
                yield name, BODY, segment_box_distance(p, u, half) - radius[c]
                for m, (mount, row) in enumerate(zip(fixed, shapes.mounts, strict=True)):
                    if limb.links[c] >= shapes.robot["limbs"][i]["least_link"][m]:
                        apart = segments_distance(p, u, *_axis(row["ends"]))
                        yield name, mount, apart - radius[c] - row["radius"]
            for d, j in limb.pairs.tolist():
                if d == c:
                    apart = segments_distance(p, u, *_axis(ends[i, j]))
                    yield name, f"limb{i}/{names[j]}", apart - radius[c] - radius[j]
            for k in range(i + 1, robot.limbs):
                for j, other in enumerate(_names(shapes.each[k])):
                    apart = segments_distance(p, u, *_axis(ends[k, j]))
                    yield name, f"limb{k}/{other}", apart - radius[c] - shapes.each[k].radii[j]


def _limbs_with_boxes(
    shapes: LimbShapes,
    boxes: Sequence[Box],
    ends: Array,
    at_grasp: dict[int, tuple[Array, Array]],
    clearance: float,
) -> Iterator[Pair]:
    """Distances of the limbs' moving capsules from boxes that may be closer than the clearance."""
    for i, parts in enumerate(shapes.each):
        radius, names = parts.radii, _names(parts)
        limb, gripper = ends[i, : len(names)], int(shapes.robot["limbs"][i]["gripper"])
        around = _around(limb, radius, boxes, clearance)
        for c, axis in enumerate(limb):
            for box in (boxes[b] for b in around[c]):
                if c >= gripper and i in at_grasp and _behind(box, *at_grasp[i]):
                    continue
                yield f"limb{i}/{names[c]}", scene_name(BOX, box.id), _to_box(axis, box) - radius[c]


def _base_with_boxes(
    robot: RobotSpec,
    shapes: LimbShapes,
    boxes: Sequence[Box],
    base: tuple[Array, Array],
    clearance: float,
) -> Iterator[Pair]:
    """Distances of body and mounts from boxes that may be closer than the clearance."""
    position, rotation = base
    half, names = shapes.robot["half"], mount_names(robot)
    body = Box(BODY, "obstacle", tuple(position.tolist()), tuple(half.tolist()), Box.rows(rotation))
    for box in boxes:
        if _to_box(np.stack([position, position]), box) - np.linalg.norm(half) < clearance:
            # Two boxes are nearest, or first overlap, at an edge of one of them.
            edges = [(axis, box) for axis in _edges(body)] + [(axis, body) for axis in _edges(box)]
            yield BODY, scene_name(BOX, box.id), min(_to_box(*pair) for pair in edges)
    axes, radius = position + shapes.mounts["ends"] @ rotation.T, shapes.mounts["radius"]
    for m, around in enumerate(_around(axes, radius, boxes, clearance)):
        for box in (boxes[b] for b in around):
            yield names[m], scene_name(BOX, box.id), _to_box(axes[m], box) - radius[m]


def _around(axes: Array, radius: Array, boxes: Sequence[Box], clearance: float) -> list[list[int]]:
    """Indices of the boxes that each capsule may touch, or come closer to than the clearance.

    They are told by the ball round it; `axes` are the ends of the capsules, shape (c, 2, 3) [m],
    `radius` has shape (c,) [m].
    """
    if not boxes:
        return [[] for _ in axes]
    from_centres = axes.mean(axis=1)[:, None] - np.array([box.centre for box in boxes])
    inside = np.einsum("cbi,bij->cbj", from_centres, np.array([box.rotation for box in boxes]))
    beside = np.maximum(np.abs(inside) - np.array([box.half for box in boxes]), 0.0)
    reach = radius + 0.5 * np.linalg.norm(axes[:, 1] - axes[:, 0], axis=1) + max(0.0, clearance)
    close = np.linalg.norm(beside, axis=2) <= reach[:, None] + 1e-9
    return [np.flatnonzero(row).tolist() for row in close]


def _to_box(axis: Array, box: Box) -> float:
    """Distance of a segment, shape (2, 3), from a box [m]; 0 where it reaches into it."""
    start, end = (axis - np.array(box.centre)) @ np.array(box.rotation)
    return float(segment_box_distance(tuple(start), tuple(end - start), box.half))


def _axis(ends: Array) -> tuple[Triple, Triple]:
    """One end of a segment, shape (2, 3), and the vector from there to the other."""
    return triple(ends[0]), triple(ends[1] - ends[0])


def _edges(box: Box) -> Array:
    """The twelve edges of a box, shape (12, 2, 3) [m]."""
    corners = np.array(list(product((-1.0, 1.0), repeat=3)))
    ends = [(a, b) for a, b in combinations(corners, 2) if (a != b).sum() == 1]
    edges: Array = np.array(box.centre) + (np.array(ends) * box.half) @ np.array(box.rotation).T
    return edges


def mount_names(robot: RobotSpec) -> list[str]:
    """Names of the capsules fixed to the body, limb by limb."""
    counts = [sum(c.link == "base" for c in mount.capsules or ()) for mount in robot.mounted]
    return [f"limb{i}/base/{m}" for i, count in enumerate(counts) for m in range(count)]


@lru_cache(maxsize=8)
def _shapes(robot: RobotSpec) -> LimbShapes:
    """A robot's shapes, worked out once."""
    return LimbShapes(robot)


def _names(shapes: ShapesOfLimb) -> list[str]:
    """Names of a limb's moving capsules: link and number on it."""
    return [f"{name}/{shapes.names[:c].count(name)}" for c, name in enumerate(shapes.names)]


def _behind(box: Box, point: Array, normal: Array) -> bool:
    reach = np.abs(np.array(box.rotation).T @ normal) @ np.array(box.half)
    return float((np.array(box.centre) - point) @ normal + reach) <= FLUSH
