"""Which shapes of a robot come near what, one pair after the other: for explanations, pictures and tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mlivr_gym.collision_kernels import FLUSH, axis_of, frames_of_angles, place
from mlivr_gym.distance_kernels import segment_box_apart, segments_apart
from mlivr_gym.limb_shapes import LimbShapes
from mlivr_gym.robot import RobotSpec
from mlivr_gym.shapes import BOX, Box, scene_name

Array = NDArray[np.float64]

Configuration = tuple[Array, Array, Array]
"""Base position [m], base quaternion w, x, y, z, and joint angles (N, 6) [rad]."""


@dataclass(frozen=True)
class Contact:
    """Two shapes that are nearer than the clearance.

    Attributes:
        first: A shape of the robot, as the scene names it: `"limb0/forearm/0"` or `"body"`.
        second: Another of its shapes, or a box: `"box/{id}"`.
        distance: Distance of the surfaces [m], negative where they overlap.
    """

    first: str
    second: str
    distance: float


def capsule_ends(robot: RobotSpec, shapes: LimbShapes, configuration: Configuration) -> Array:
    """Ends of the limbs' moving capsules in the world [m], shape (N, c, 2, 3)."""
    position, quaternion, joints = configuration
    base = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    out = np.empty((robot.limbs, len(shapes), 2, 3))
    frames = np.empty((7, 4, 3))
    for i in range(robot.limbs):
        frames_of_angles(np.ascontiguousarray(joints[i]), robot.limb.lengths, frames)
        place(frames, shapes.arrays, robot.mount_rotations[i], robot.mount_positions[i], out[i])
    return out @ base.T + position


def contacts(
    robot: RobotSpec,
    boxes: Sequence[Box],
    configuration: Configuration,
    clearance: float,
    grasps: Sequence[tuple[int, Array, Array]] = (),
) -> list[Contact]:
    """Every pair of shapes that is compared and nearer than the clearance, the nearest first.

    Against boxes the body is the sphere round it.

    Args:
        robot: The robot.
        boxes: What stands round it.
        configuration: Where it is.
        clearance: Least distance [m].
        grasps: Limb, point [m] and surface normal of each limb at a grasp: its gripper may come near what lies behind.
    """
    shapes = LimbShapes(robot)
    ends = capsule_ends(robot, shapes, configuration)
    radius, names = shapes.arrays[2], _names(shapes)
    base = Rotation.from_quat(configuration[1], scalar_first=True).as_matrix()
    local = (ends - configuration[0]) @ base
    mounts, mount_radius, half, least = shapes.fixed
    per_limb = len(mount_radius) // robot.limbs
    at_grasp = {limb: (point, normal) for limb, point, normal in grasps}
    found = []
    for i in range(robot.limbs):
        for c in range(len(shapes)):
            name = f"limb{i}/{names[c]}"
            p, u = axis_of(local[i], c)
            if shapes.arrays[0][c] >= 2:
                found.append((name, "body", np.sqrt(segment_box_apart(p, u, tuple(half))) - radius[c]))
                for m in range(len(mount_radius)):
                    if shapes.arrays[0][c] >= least[i, m]:
                        apart = np.sqrt(segments_apart(p, u, *axis_of(mounts, m))) - radius[c] - mount_radius[m]
                        found.append((name, f"limb{m // per_limb}/base/{m % per_limb}", apart))
            for d, j in shapes.arrays[3].tolist():
                if d == c:
                    apart = np.sqrt(segments_apart(p, u, *axis_of(local[i], j))) - radius[c] - radius[j]
                    found.append((name, f"limb{i}/{names[j]}", apart))
            for k in range(i + 1, robot.limbs):
                for j in range(len(shapes)):
                    apart = np.sqrt(segments_apart(p, u, *axis_of(local[k], j))) - radius[c] - radius[j]
                    found.append((name, f"limb{k}/{names[j]}", apart))
            for box in boxes:
                if c >= shapes.first_gripper and i in at_grasp and _behind(box, *at_grasp[i]):
                    continue
                turned = np.array(box.rotation)
                start, end = (ends[i, c] - np.array(box.centre)) @ turned
                apart = np.sqrt(segment_box_apart(tuple(start), tuple(end - start), box.half)) - radius[c]
                found.append((name, scene_name(BOX, box.id), apart))
    for box in boxes:
        start = (configuration[0] - np.array(box.centre)) @ np.array(box.rotation)
        apart = np.sqrt(segment_box_apart(tuple(start), (0.0, 0.0, 0.0), box.half)) - shapes.body_radius
        found.append(("body", scene_name(BOX, box.id), apart))
    near = [Contact(first, second, float(apart)) for first, second, apart in found if apart < clearance]
    return sorted(near, key=lambda contact: contact.distance)


def _names(shapes: LimbShapes) -> list[str]:
    """Names of a limb's moving capsules: link and number on it."""
    return [f"{name}/{shapes.names[:c].count(name)}" for c, name in enumerate(shapes.names)]


def _behind(box: Box, point: Array, normal: Array) -> bool:
    reach = np.abs(np.array(box.rotation).T @ normal) @ np.array(box.half)
    return float((np.array(box.centre) - point) @ normal + reach) <= FLUSH
