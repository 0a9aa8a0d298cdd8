"""The shapes of the MuJoCo scene as triangle meshes, link by link, for the page."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple, cast

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mlivr_gym.pictures.limb_meshes import show_limbs
from mlivr_gym.pictures.robot_shapes import geom_corners
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.scene import compile_spec, scene_spec
from mlivr_gym.world.boxes import BOX, scene_name
from mlivr_gym.world.grasp_map import GraspMap

Mesh = trimesh.Trimesh
"""Triangle mesh whose triangles are anticlockwise seen from outside."""

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, from 0 to 1."""


class Solid(NamedTuple):
    """Shapes of one colour that are fixed to a link or to the world."""

    link: str
    """Name of the link in the MuJoCo scene, `"world"` for shapes that do not move."""
    face: str
    """Face of the cabin to which they belong, `""` for none."""
    colour: Colour
    """Their colour."""
    mesh: Mesh
    """Their triangles in the frame of the link."""


def scene_solids(
    grasp_map: GraspMap, robot: RobotSpec, capsules: bool = False
) -> tuple[mujoco.MjModel, list[Solid]]:
    """Return the model of a robot in a module, and its shapes that are seen.

    With `capsules`, limbs have no visual meshes.

    Raises a `SceneError` if MuJoCo refuses the robot.
    """
    spec = scene_spec(grasp_map, robot)
    show_limbs(spec, robot, capsules)
    model = compile_spec(spec)
    faces = {scene_name(BOX, box.id): box.face for box in grasp_map.boxes}
    groups: dict[tuple[str, str, Colour], list[Mesh]] = defaultdict(list)
    for k in range(model.ngeom):
        geom = model.geom(k)
        r, g, b, opacity = geom.rgba.tolist()
        if opacity == 0.0:
            continue  # a mesh is drawn in its place
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat(geom.quat, scalar_first=True).as_matrix()
        pose[:3, 3] = geom.pos
        key = model.body(int(geom.bodyid[0])).name, faces.get(geom.name, ""), (r, g, b, opacity)
        groups[key].append(geom_mesh(model, k).apply_transform(pose))
    return model, [
        Solid(*key, cast(Mesh, trimesh.util.concatenate(made))) for key, made in groups.items()
    ]


def geom_mesh(model: mujoco.MjModel, geom: int) -> Mesh:
    """Return the mesh of a geom in its own frame; vertices at sharp edges are those of one side."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        stored = model.mesh(int(model.geom_dataid[geom]))
        vertices = model.mesh_vert[stored.vertadr[0] :][: stored.vertnum[0]]
        mesh = Mesh(vertices, model.mesh_face[stored.faceadr[0] :][: stored.facenum[0]])
    else:
        mesh = trimesh.convex.convex_hull(geom_corners(model, geom))
    shaded: Mesh = trimesh.graph.smooth_shade(mesh, angle=0.25 * np.pi)
    return shaded
