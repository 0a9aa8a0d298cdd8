"""Functions that draw module, points, robot and plans on a page, as named nodes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import cast

import numpy as np
import trimesh
from matplotlib.colors import to_rgba, to_rgba_array
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions import Configuration
from mlivr_gym.extensions.viewer.page import Colour, Page
from mlivr_gym.motion import Plan
from mlivr_gym.pictures import Camera, Route
from mlivr_gym.pictures.camera import FIELD_OF_VIEW
from mlivr_gym.pictures.figures import BASE_COLOUR, GOAL_COLOUR
from mlivr_gym.pictures.limb_meshes import show_limbs
from mlivr_gym.pictures.rendering import MARGIN
from mlivr_gym.pictures.robot_shapes import geom_corners
from mlivr_gym.pictures.route import GOAL_OPACITY, PATH_RADIUS
from mlivr_gym.robot import RobotSpec
from mlivr_gym.robot.rigid import rigid
from mlivr_gym.simulation import compile_spec, scene_spec, set_configuration
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.scene import COLOURS
from mlivr_gym.world import BOX, Box, GraspMap, scene_name

POINT_RADIUS, POINT_HEIGHT = 0.028, 0.012
"""Size of a graspable point [m], larger than in the MuJoCo scene so that it can be clicked."""

OCCUPIED_SCALE = 1.8
"""Factor by which occupied points are enlarged: they are as dark as the tracks."""

POINT_COLOUR, OCCUPIED_COLOUR = "#f2bf1a", "#1b1b1f"
"""Colours of points, and of occupied ones."""

AZIMUTH, ELEVATION = 80.0, -4.0
"""Angles of the initial line of sight [deg]."""


def draw_stage(page: Page, grasp_map: GraspMap, robot: RobotSpec, capsules: bool) -> mujoco.MjModel:
    """Draw module, points and robot, with lamps; return the model of module and robot."""
    page.scene.add_light_ambient("/sky", intensity=1.0)
    for name, strength, position in (
        ("lamp", 1.7, (-2.0, -3.5, 8.0)),  # from above
        ("fill", 0.6, (5.0, -2.0, -5.0)),
    ):
        page.scene.add_light_directional(
            f"/{name}", intensity=strength, position=position, cast_shadow=False
        )
    model, solids = scene_solids(grasp_map, robot, capsules)
    folders = {f"module/{face}" for face in ("rest", *grasp_map.faces)}
    links = {_node(model.body(k).name) for k in range(1, model.nbody)}
    for folder in ("module", "robot", *folders, *links):
        page.clear(folder)
    for k, ((node, colour), meshes) in enumerate(solids.items()):
        page.mesh(f"{node}/{k}", cast(trimesh.Trimesh, trimesh.util.concatenate(meshes)), colour)
    draw_points(page, grasp_map)
    return model


def draw_world(page: Page, obstacles: Sequence[Box], goal: Array, tolerance: float) -> None:
    """Draw obstacles and the goal region, a ball about a position [m]."""
    page.ball("goal", goal, tolerance, to_rgba(GOAL_COLOUR, GOAL_OPACITY))
    page.clear("obstacles")
    for k, box in enumerate(obstacles):
        mesh = trimesh.creation.box(
            2.0 * np.array(box.half), rigid(np.array(box.rotation), box.centre)
        )
        page.mesh(f"obstacles/{k}", mesh, COLOURS[box.kind])


def scene_solids(
    grasp_map: GraspMap, robot: RobotSpec, capsules: bool
) -> tuple[mujoco.MjModel, dict[tuple[str, Colour], list[trimesh.Trimesh]]]:
    """Return the model of a robot in a module, and the meshes of its geoms by node and colour.

    With `capsules`, limbs have no visual meshes. Raises a `SceneError` if MuJoCo refuses the robot.
    """
    spec = scene_spec(grasp_map, robot)
    show_limbs(spec, robot, capsules)
    model = compile_spec(spec)
    walls = {scene_name(BOX, box.id): f"module/{box.face or 'rest'}" for box in grasp_map.boxes}
    solids: dict[tuple[str, Colour], list[trimesh.Trimesh]] = defaultdict(list)
    for k in range(model.ngeom):
        geom = model.geom(k)
        r, g, b, opacity = geom.rgba.tolist()
        if opacity > 0.0:  # otherwise a mesh is drawn in its place
            node = walls.get(geom.name) or _node(model.body(int(geom.bodyid[0])).name)
            turn = Rotation.from_quat(geom.quat, scalar_first=True).as_matrix()
            mesh = geom_mesh(model, k).apply_transform(rigid(turn, geom.pos))
            solids[node, (r, g, b, opacity)].append(mesh)
    return model, solids


def geom_mesh(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh:
    """Return the mesh of a geom in its own frame, with triangles anticlockwise from outside."""
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
        hull: trimesh.Trimesh = trimesh.Trimesh(geom_corners(model, geom)).convex_hull
        return hull
    stored = model.mesh(int(model.geom_dataid[geom]))
    vertices = model.mesh_vert[stored.vertadr[0] :][: stored.vertnum[0]]
    return trimesh.Trimesh(vertices, model.mesh_face[stored.faceadr[0] :][: stored.facenum[0]])


def draw_points(page: Page, grasp_map: GraspMap) -> None:
    """Draw the graspable points as nodes `points/FACE`."""
    disc = trimesh.creation.cylinder(POINT_RADIUS, POINT_HEIGHT, sections=20)
    for face, chosen in points_by_face(grasp_map).items():
        quaternions = Rotation.from_matrix(grasp_map.rotations[chosen]).as_quat(scalar_first=True)
        page.nodes[f"points/{face}"] = page.scene.add_batched_meshes_simple(
            f"/points/{face}",
            disc.vertices,
            disc.faces,
            quaternions,
            grasp_map.positions[chosen],
            batched_colors=np.zeros((len(chosen), 3), dtype=np.uint8),
            batched_scales=np.ones(len(chosen), dtype=np.float32),
            lod="off",
            flat_shading=True,
            cast_shadow=False,
            receive_shadow=False,
        )


def colour_points(page: Page, grasp_map: GraspMap, occupied: Collection[int]) -> None:
    """Set the colours of the graspable points; occupied ones are dark, and larger."""
    is_occupied = np.isin(np.arange(len(grasp_map)), list(occupied))
    scales = np.where(is_occupied, OCCUPIED_SCALE, 1.0).astype(np.float32)
    # Unlike all others, the colours of batched meshes must be linear: the sRGB curve is inverted.
    share = to_rgba_array(np.where(is_occupied, OCCUPIED_COLOUR, POINT_COLOUR))[:, :3]
    bright = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    colours = np.round(255.0 * bright).astype(np.uint8)
    for face, chosen in points_by_face(grasp_map).items():
        node = page.nodes[f"points/{face}"]
        node.batched_colors, node.batched_scales = colours[chosen], scales[chosen]


def points_by_face(grasp_map: GraspMap) -> dict[str, IntArray]:
    """Return the indices of the points of each face."""
    faces = np.array(grasp_map.faces)
    return {face: np.flatnonzero(faces == face) for face in sorted(set(grasp_map.faces))}


def pose_robot(page: Page, model: mujoco.MjModel, configuration: Configuration) -> None:
    """Move the robot of a model to a configuration."""
    data = mujoco.MjData(model)
    set_configuration(model, data, *configuration)
    for k in range(1, model.nbody):
        node = page.nodes[_node(model.body(k).name)]
        # In a file, numbers of single precision take less space once they are compressed.
        node.position, node.wxyz = np.float32(data.xpos[k]), np.float32(data.xquat[k])


def _node(link: str) -> str:
    """Return the node of a robot's link; none lies below another, since poses are in the world."""
    return f"robot/{link.replace('/', '.')}"


def draw_plan(page: Page, grasp_map: GraspMap, plan: Plan | None) -> None:
    """Draw base path and footholds of a plan, numbered by stance."""
    page.clear("plan")
    if plan is None:
        return
    route = Route.of(grasp_map, plan)
    page.line("plan/path", route.line, to_rgba(BASE_COLOUR), 2.0 * PATH_RADIUS)
    for k, (position, radius, colour) in enumerate(route.balls()):
        page.ball(f"plan/ball{k}", position, radius, to_rgba(colour))
    for k, (position, text, _) in enumerate(route.labels()):
        page.label(f"plan/number{k}", text, position)


def aim_camera(page: Page, positions: Array, aspect: float) -> Array:
    """Set the first camera so that it sees all of some positions (k, 3) [m]; return its place [m].

    `aspect` is the width of the picture divided by its height.
    """
    x, y, z = (0.5 * (positions.min(axis=0) + positions.max(axis=0))).tolist()
    camera = Camera((x, y, z), azimuth=AZIMUTH, elevation=ELEVATION)
    camera = camera.seeing(positions, MARGIN, aspect)
    eye: Array = np.array(camera.lookat) - camera.distance * camera.axes[2]
    first = page.server.initial_camera
    first.up, first.position, first.look_at = (0.0, 0.0, 1.0), eye, np.array(camera.lookat)
    first.fov = np.deg2rad(FIELD_OF_VIEW)
    return eye


def hide_walls(page: Page, grasp_map: GraspMap, eye: Array) -> None:
    """Hide the walls and points that a camera at `eye` [m] sees from behind."""
    with page.server.atomic():
        for face, chosen in points_by_face(grasp_map).items():
            inward = grasp_map.normals[chosen].mean(axis=0)
            seen = float((eye - grasp_map.positions[chosen].mean(axis=0)) @ inward) >= 0.0
            page.show(f"module/{face}", seen)
            page.show(f"points/{face}", seen)
