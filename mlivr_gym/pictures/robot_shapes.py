"""The shapes of the robot in matplotlib: solid, as pale ghosts, or as projected outlines."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration, capsule_ends, mount_names
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.pictures.figures import box_faces
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.specification import LIMB_COLOURS, RobotSpec
from mlivr_gym.world.boxes import Box

BODY_COLOUR, MOUNT_COLOUR, GRIPPER_COLOUR, JOINT_COLOUR = "#d8d8de", "#9aa0a6", "#3a3a40", "#70757c"
"""Colours of body, mounts, grippers and joints; links have two shades of the limb's colour."""

JOINT_RADIUS = 0.025
"""Radius of the rods that represent the joints between the capsules of the links [m]."""

GHOST_PALENESS = 0.72
"""Share of white in the colours of a ghost."""

_LIGHT = np.array([0.35, -0.55, 0.76])
_ROUND = 14


class Part(NamedTuple):
    """A shape of the robot."""

    name: str
    """Its name in the scene, as `"limb0/forearm/0"` or `"body"`."""
    colour: str
    """Its colour."""
    faces: Array
    """Corners of its faces in the world frame, shape (f, 4, 3) [m]."""


def capsule_faces(ends: Array, radius: float, around: int = _ROUND) -> Array:
    """Compute the corners of the faces of a capsule, shape (f, 4, 3) [m].

    `ends` are the ends of its axis, shape (2, 3) [m]; it has `around` faces round the axis.
    """
    rings = max(around // 4, 2)
    along = ends[1] - ends[0]
    size = float(np.linalg.norm(along))
    z = along / size if size > 1e-9 else np.array([0.0, 0.0, 1.0])
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    rise = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 2 * rings + 1)
    rise = np.insert(rise, rings, 0.0)  # the cylinder has a ring at each end
    angle = np.linspace(0.0, 2.0 * np.pi, around + 1)
    ring = np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * np.cross(z, x)
    middle = np.where(np.arange(len(rise)) <= rings, 0, 1)
    corners = (
        ends[middle][:, None]
        + radius * np.cos(rise)[:, None, None] * ring
        + radius * np.sin(rise)[:, None, None] * z
    )
    faces: Array = np.stack(
        [corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]], axis=2
    ).reshape(-1, 4, 3)
    return faces


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
    parts = [Part("body", BODY_COLOUR, box_faces(body))]
    for name, mount in zip(mount_names(robot), shapes.mounts, strict=True):
        ends = mount["ends"] @ rotation.T + position
        parts.append(Part(name, MOUNT_COLOUR, capsule_faces(ends, float(mount["radius"]))))
    for i, limb in enumerate(capsule_ends(robot, shapes, configuration)):
        names, radii = shapes.each[i].names, shapes.each[i].radii
        for c, link in enumerate(names):
            name = f"limb{i}/{link}/{names[:c].count(link)}"
            parts.append(Part(name, _link_colour(i, link), capsule_faces(limb[c], float(radii[c]))))
        middle = position + rotation @ robot.mount_positions[i]
        parts += _joints(i, [np.stack([middle, middle]), *limb[: len(names)]])
    return parts


def _joints(limb: int, axes: Sequence[Array]) -> list[Part]:
    """Return the rods that connect the axes of a limb's shapes, shapes (2, 3) [m], in order."""
    samples = [np.linspace(start, end, 101) for start, end in axes]
    rods = [capsule_faces(_nearest_pair(*pair), JOINT_RADIUS) for pair in pairwise(samples)]
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


def draw_robot(axes: Any, parts: Sequence[Part]) -> None:
    """Draw parts of a robot in 3-D axes as shaded solids."""
    faces = np.concatenate([part.faces for part in parts])
    shades = [_lit(part.colour, part.faces) for part in parts]
    _add_faces(axes, faces, np.concatenate(shades), 5.0)


def draw_ghost(axes: Any, parts: Sequence[Part]) -> None:
    """Draw parts of a robot in 3-D axes as a ghost: pale, without shading, in the background."""
    faces = np.concatenate([part.faces for part in parts])
    colours = [pale(part.colour, GHOST_PALENESS) for part in parts for _ in part.faces]
    _add_faces(axes, faces, colours, 1.2)


def _add_faces(axes: Any, faces: Array, colours: Any, zorder: float) -> None:
    """Add faces of shape (f, 4, 3) [m] to 3-D axes."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    style = {"facecolors": colours, "edgecolors": colours, "linewidths": 0.3}
    axes.add_collection3d(Poly3DCollection(faces, zorder=zorder, **style))


def _lit(colour: str, faces: Array) -> Array:
    """Return the shaded colour of each face under a lamp behind the viewer, shape (f, 3)."""
    from matplotlib.colors import to_rgb

    across = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    size = np.linalg.norm(across, axis=1, keepdims=True)
    normals = across / np.where(size > 1e-12, size, 1.0)
    outward = np.sign(((faces.mean(axis=1) - faces.mean(axis=(0, 1))) * normals).sum(axis=1))
    bright = 0.84 + 0.16 * (normals @ _LIGHT) * np.where(outward == 0.0, 1.0, outward)
    lit: Array = np.clip(bright[:, None] * np.array(to_rgb(colour)), 0.0, 1.0)
    return lit


def outline(faces: Array, across: Array) -> Array:
    """Compute the outline of a convex shape in an orthographic projection, shape (k, 2) [m].

    `faces` are the corners of its faces, shape (f, 4, 3) [m]; `across` are the horizontal and
    vertical axis of the picture in the world frame, shape (2, 3).
    """
    projected = faces.reshape(-1, 3) @ across.T
    corners: Array = projected[scipy.spatial.ConvexHull(projected).vertices]
    return corners
