"""The robot's shapes as matplotlib draws them: solid or as a ghost, and outlines seen from afar."""

from __future__ import annotations

from collections.abc import Collection, Sequence
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
"""Colours of body, mounts, grippers and joints; links have two shades of their limb's."""

JOINT_RADIUS = 0.025
"""Radius of the rods that stand for the joints between the links' shapes [m]."""

TOUCHING_COLOUR = "#e8590c"
"""Colour of shapes that touch something: of no limb among the first two."""

GHOST_PALENESS = 0.72
"""Share of white in a ghost."""

_LIGHT = np.array([0.35, -0.55, 0.76])
_ROUND = 14


class Part(NamedTuple):
    """A shape of the robot."""

    name: str
    """As the scene names it: `"limb0/forearm/0"` or `"body"`."""
    colour: str
    """Its colour."""
    faces: Array
    """Corners of its faces in the world, shape (f, 4, 3) [m]."""
    axes: Array
    """Axis of a capsule, shape (1, 2, 3), or the edges of the body, shape (12, 2, 3) [m]."""
    radius: float = 0.0
    """Radius of a capsule [m]."""
    box: Box | None = None
    """The body as a box."""


def capsule_faces(ends: Array, radius: float, around: int = _ROUND) -> Array:
    """Corners of faces on a capsule, shape (f, 4, 3) [m], by the ends of its axis, (2, 3) [m]."""
    rings = max(around // 4, 2)
    along = ends[1] - ends[0]
    size = float(np.linalg.norm(along))
    z = along / size if size > 1e-9 else np.array([0.0, 0.0, 1.0])
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    rise = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 2 * rings + 1)
    rise = np.insert(rise, rings, 0.0)  # the ring about either end
    turn = np.linspace(0.0, 2.0 * np.pi, around + 1)
    ring = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * np.cross(z, x)
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
    """Every shape of a robot in a configuration: body, mounts and links, and rods between them.

    The shapes that collisions are checked with leave the joints out; the rods, which are checked
    with nothing, stand for these.

    Raises
    ------
    SettingError
        If the configuration is none of the robot.
    """
    shapes = LimbShapes(robot)
    position, quaternion, _ = configuration
    turn = scipy.spatial.transform.Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    size = tuple(shapes.robot["half"].tolist())
    body = Box("body", "obstacle", tuple(np.array(position).tolist()), size, Box.rows(turn))
    faces = box_faces(body)
    edges = np.stack([faces[:4], np.roll(faces[:4], -1, axis=1)], axis=2).reshape(-1, 2, 3)
    parts = [Part("body", BODY_COLOUR, faces, edges, box=body)]
    for name, mount in zip(mount_names(robot), shapes.mounts, strict=True):
        ends = mount["ends"] @ turn.T + position
        parts.append(_capsule(name, MOUNT_COLOUR, ends, float(mount["radius"])))
    for i, limb in enumerate(capsule_ends(robot, shapes, configuration)):
        names, radii = shapes.each[i].names, shapes.each[i].radii
        for c, link in enumerate(names):
            name = f"limb{i}/{link}/{names[:c].count(link)}"
            parts.append(_capsule(name, _tint(i, link), limb[c], float(radii[c])))
        middle = position + turn @ robot.mount_positions[i]
        parts += _joints(i, [np.stack([middle, middle]), *limb[: len(names)]])
    return parts


def _joints(limb: int, axes: Sequence[Array]) -> list[Part]:
    """Rods from each axis of a limb's shapes, shapes (2, 3) [m], to the next."""
    share = np.linspace(0.0, 1.0, 101)[:, None]
    places = [a + share * (b - a) for a, b in axes]
    rods = []
    for k, (here, there) in enumerate(pairwise(places)):
        apart = scipy.spatial.distance.cdist(here, there)
        first, second = np.unravel_index(int(np.argmin(apart)), apart.shape)
        ends = np.stack([here[first], there[second]])
        rods.append(_capsule(f"limb{limb}/joint/{k}", JOINT_COLOUR, ends, JOINT_RADIUS))
    return rods


def _capsule(name: str, colour: str, ends: Array, radius: float) -> Part:
    return Part(name, colour, capsule_faces(ends, radius), ends[None], radius)


def _tint(limb: int, link: str) -> str:
    """Colour of a link: two shades of the limb's in turn, as in the scene."""
    if link == "gripper":
        return GRIPPER_COLOUR
    return LIMB_COLOURS[limb] if LINKS.index(link) % 2 == 0 else pale(LIMB_COLOURS[limb], 0.4)


def pale(colour: str, share: float) -> str:
    """A colour mixed with a share of white."""
    from matplotlib.colors import to_hex, to_rgb

    red, green, blue = ((1.0 - share) * part + share for part in to_rgb(colour))
    return str(to_hex((red, green, blue)))


def draw_robot(
    axes: Any, parts: Sequence[Part], touching: Collection[str] = (), *, zorder: float = 5.0
) -> None:
    """Draw parts of a robot as solids in 3-D axes, lit, those whose names are given in orange."""
    faces = np.concatenate([part.faces for part in parts])
    given = [TOUCHING_COLOUR if part.name in touching else part.colour for part in parts]
    lit = [_lit(colour, part.faces) for colour, part in zip(given, parts, strict=True)]
    colours = np.concatenate(lit)
    _add_faces(axes, faces, colours, zorder)


def draw_ghost(axes: Any, parts: Sequence[Part], *, zorder: float = 1.2) -> None:
    """Draw parts of a robot in 3-D axes as a ghost: pale and flat, behind what is drawn later."""
    faces = np.concatenate([part.faces for part in parts])
    colours = [pale(part.colour, GHOST_PALENESS) for part in parts for _ in part.faces]
    _add_faces(axes, faces, colours, zorder)


def _add_faces(axes: Any, faces: Array, colours: Any, zorder: float) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    style = {"facecolors": colours, "edgecolors": colours, "linewidths": 0.3}
    axes.add_collection3d(Poly3DCollection(faces, zorder=zorder, **style))


def _lit(colour: str, faces: Array) -> Array:
    """Red, green and blue of each face under a lamp over the viewer's shoulder, shape (f, 3)."""
    from matplotlib.colors import to_rgb

    across = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    size = np.linalg.norm(across, axis=1, keepdims=True)
    normals = across / np.where(size > 1e-12, size, 1.0)
    outward = np.sign(((faces.mean(axis=1) - faces.mean(axis=(0, 1))) * normals).sum(axis=1))
    bright = 0.84 + 0.16 * (normals @ _LIGHT) * np.where(outward == 0.0, 1.0, outward)
    lit: Array = np.clip(bright[:, None] * np.array(to_rgb(colour)), 0.0, 1.0)
    return lit


def outline(faces: Array, across: Array) -> Array:
    """Outline of a convex shape seen from afar, shape (k, 2) [m].

    Parameters
    ----------
    faces
        Corners of its faces, shape (f, 4, 3) [m].
    across
        The picture's horizontal and vertical axis in the world, shape (2, 3).
    """
    seen = faces.reshape(-1, 3) @ across.T
    corners: Array = seen[scipy.spatial.ConvexHull(seen).vertices]
    return corners
