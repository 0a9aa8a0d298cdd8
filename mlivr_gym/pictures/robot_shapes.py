"""The robot of the MuJoCo scene in matplotlib: its collision shapes and rods, which are convex."""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import scipy

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration, checked_configuration
from mlivr_gym.pictures.limb_meshes import show_limbs
from mlivr_gym.robot.specification import RobotSpec

_SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))
_LIGHT = np.array([0.35, -0.55, 0.76])

ROUND = 20
"""Number of corners round a capsule or a cylinder."""


class Part(NamedTuple):
    """A convex shape of one colour."""

    name: str
    """Its name in the scene, as `"limb0/forearm/0"` or `"body"`."""
    colour: str
    """Its colour."""
    corners: Array
    """Positions in the world frame whose convex hull it is, shape (k, 3) [m]."""


def geom_corners(model: Any, geom: int) -> Array:
    """Return positions on a box, capsule or cylinder, whose convex hull it nearly is, (k, 3) [m].

    `geom` is its index in a `mujoco.MjModel`; positions are in the frame of the geom.
    """
    import mujoco

    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        corners: Array = _SIGNS * size
        return corners
    rounded = kind == mujoco.mjtGeom.mjGEOM_CAPSULE
    rises = np.linspace(0.0, 0.5 * np.pi, 5) if rounded else np.zeros(1)
    rise, angle = np.meshgrid(rises, np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False))
    half = np.stack([np.cos(rise) * np.cos(angle), np.cos(rise) * np.sin(angle), np.sin(rise)])
    half = size[0] * half.reshape(3, -1).T + (0.0, 0.0, size[1])
    return np.concatenate([half, half * (1.0, 1.0, -1.0)])


@lru_cache(maxsize=8)
def _model(robot: RobotSpec) -> Any:
    """Return the model of a robot alone, without meshes, which are not convex."""
    from mlivr_gym.simulation.scene import compile_spec, robot_alone  # imports MuJoCo, hence GL

    spec = robot_alone(robot)
    show_limbs(spec, robot, capsules=True)
    return compile_spec(spec)


def robot_parts(robot: RobotSpec, configuration: Configuration) -> list[Part]:
    """Return all shapes of a robot in a configuration: body, mounts, links and joints.

    Raises a `SettingError` if the configuration does not fit the robot.
    """
    from matplotlib.colors import to_hex

    from mlivr_gym.simulation.gl import mujoco
    from mlivr_gym.simulation.scene import set_configuration

    model, parts = _model(robot), []
    data = mujoco.MjData(model)
    set_configuration(model, data, *checked_configuration(robot, configuration))
    for k in range(model.ngeom):
        corners = geom_corners(model, k) @ data.geom_xmat[k].reshape(3, 3).T + data.geom_xpos[k]
        parts.append(Part(model.geom(k).name, str(to_hex(model.geom_rgba[k])), corners))
    return parts


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
