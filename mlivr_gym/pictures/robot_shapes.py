"""The shapes of the robot in matplotlib: convex, with shaded faces and projected outlines."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration, capsule_ends, mount_names
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.pictures.figures import box_corners
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.specification import LIMB_COLOURS, RobotSpec
from mlivr_gym.world.boxes import Box

BODY_COLOUR, MOUNT_COLOUR, GRIPPER_COLOUR, JOINT_COLOUR = "#d8d8de", "#9aa0a6", "#3a3a40", "#70757c"
"""Colours of body, mounts, grippers and joints; links have two shades of the limb's colour."""

JOINT_RADIUS = 0.025
"""Radius of the rods that represent the joints between the capsules of the links [m]."""

_LIGHT = np.array([0.35, -0.55, 0.76])
_ROUND = 14


class Part(NamedTuple):
    """A convex shape of one colour."""

    name: str
    """Its name in the scene, as `"limb0/forearm/0"` or `"body"`."""
    colour: str
    """Its colour."""
    corners: Array
    """Positions in the world frame whose convex hull it is, shape (k, 3) [m]."""


def capsule_corners(ends: Array, radius: float, around: int = _ROUND) -> Array:
    """Return positions on a capsule, whose convex hull it nearly is, shape (k, 3) [m].

    `ends` are the ends of its axis, shape (2, 3) [m]; it has `around` corners round the axis.
    """
    along = ends[1] - ends[0]
    rise = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 4 * max(around // 8, 1) + 1)
    rise, angle = np.meshgrid(rise, np.linspace(0.0, 2.0 * np.pi, around, endpoint=False))
    ball = [np.sin(rise), np.cos(rise) * np.cos(angle), np.cos(rise) * np.sin(angle)]
    # The first right-singular vector is the direction of the axis.
    ball = np.stack(ball, axis=-1).reshape(-1, 3) @ np.linalg.svd(along[None])[2]
    ahead = ball @ along
    halves = zip(ends, (ahead <= 1e-9, ahead >= -1e-9), strict=True)
    return np.concatenate([end + radius * ball[half] for end, half in halves])


def robot_parts(robot: RobotSpec, configuration: Configuration) -> list[Part]:
    """Return all shapes of a robot in a configuration: body, mounts, links and joints.

    The joints are drawn as rods, which no collision check uses: the collision shapes of the links
    leave gaps there. Raises a `SettingError` if the configuration does not fit the robot.
    """
    shapes = LimbShapes(robot)
    position, quaternion, _ = configuration
    rotation = scipy.spatial.transform.Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    size = tuple(shapes.robot["half"].tolist())
    body = Box("body", "obstacle", tuple(np.array(position).tolist()), size, Box.rows(rotation))
    parts = [Part("body", BODY_COLOUR, box_corners(body))]
    for name, mount in zip(mount_names(robot), shapes.mounts, strict=True):
        ends = mount["ends"] @ rotation.T + position
        parts.append(Part(name, MOUNT_COLOUR, capsule_corners(ends, float(mount["radius"]))))
    for i, limb in enumerate(capsule_ends(robot, shapes, configuration)):
        names, radii = shapes.each[i].names, shapes.each[i].radii
        for c, link in enumerate(names):
            name = f"limb{i}/{link}/{names[:c].count(link)}"
            corners = capsule_corners(limb[c], float(radii[c]))
            parts.append(Part(name, _link_colour(i, link), corners))
        middle = position + rotation @ robot.mount_positions[i]
        parts += _joints(i, [np.stack([middle, middle]), *limb[: len(names)]])
    return parts


def _joints(limb: int, axes: Sequence[Array]) -> list[Part]:
    """Return the rods that connect the axes of a limb's shapes, shapes (2, 3) [m], in order."""
    samples = [np.linspace(start, end, 101) for start, end in axes]
    rods = [capsule_corners(_nearest_pair(*pair), JOINT_RADIUS) for pair in pairwise(samples)]
    return [Part(f"limb{limb}/joint/{k}", JOINT_COLOUR, rod) for k, rod in enumerate(rods)]


def _nearest_pair(first: Array, second: Array) -> Array:
    """Return the two closest positions of two sets, shapes (k, 3), as rows, shape (2, 3) [m]."""
    distances = scipy.spatial.distance.cdist(first, second)
    i, j = np.unravel_index(int(np.argmin(distances)), distances.shape)
    return np.stack([first[i], second[j]])


def _link_colour(limb: int, link: str) -> str:
    """Return the colour of a link: two shades of the limb's colour alternate, as in the scene."""
    if link == "gripper":
        return GRIPPER_COLOUR
    return LIMB_COLOURS[limb] if LINKS.index(link) % 2 == 0 else pale(LIMB_COLOURS[limb], 0.4)


def pale(colour: str, share: float) -> str:
    """Mix a colour with a share of white."""
    from matplotlib.colors import to_hex, to_rgb

    red, green, blue = ((1.0 - share) * part + share for part in to_rgb(colour))
    return str(to_hex((red, green, blue)))


def shaded_faces(part: Part) -> tuple[Array, Array]:
    """Return the triangles of a shape, shape (f, 3, 3) [m], and their shaded colours, (f, 3)."""
    from matplotlib.colors import to_rgb

    hull = scipy.spatial.ConvexHull(part.corners)
    bright = 0.84 + 0.16 * (hull.equations[:, :3] @ _LIGHT)
    faces: Array = part.corners[hull.simplices]
    return faces, np.clip(bright[:, None] * np.array(to_rgb(part.colour)), 0.0, 1.0)


def outline(corners: Array, across: Array) -> Array:
    """Compute the outline of a convex shape in an orthographic projection, shape (k, 2) [m].

    `corners` have shape (f, 3) [m]; `across` are the horizontal and vertical axis of the picture in
    the world frame, shape (2, 3).
    """
    projected = corners @ across.T
    edge: Array = projected[scipy.spatial.ConvexHull(projected).vertices]
    return edge
