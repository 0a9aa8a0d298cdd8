"""Functions that draw module, points, robot and plans on a page, as named nodes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.colors import to_rgba, to_rgba_array
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.figures import BASE_COLOUR, GOAL_COLOUR
from mlivr_gym.pictures.rendering import MARGIN
from mlivr_gym.pictures.route import (
    FOOTHOLD_RADIUS,
    PATH_RADIUS,
    STANCE_RADIUS,
    Route,
    plan_base_path,
)
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.viewer.marks import OCCUPIED_COLOUR, Marks
from mlivr_gym.viewer.page import Page
from mlivr_gym.viewer.solids import (
    Mesh,
    Scene,
    cylinder_mesh,
    merged,
    mesh_of_box,
    rod_mesh,
)
from mlivr_gym.world.grasp_map import GraspMap

POINT_RADIUS, POINT_HEIGHT = 0.028, 0.006
"""Size of a graspable point [m], larger than in the MuJoCo scene so that it can be clicked."""

MARKED_SCALE = 1.8
"""Factor by which points are enlarged whose colours have a meaning."""

AZIMUTH, ELEVATION = 80.0, -4.0
"""Angles of the initial line of sight [deg]."""

OCCUPIED_RADIUS = 0.035
"""Radius of the balls at occupied points [m]."""

LABEL_LIFT = 0.09
"""Height of the number of a foothold above its point [m]."""

GHOST_PATH, TREE_COLOUR, OBSTACLE_COLOUR = "#9fc7a5", "#b197fc", "#d95926"
"""Colours of the previous plan's base path, of explored steps and of obstacles."""

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
"""Quaternion of the identity rotation, w, x, y, z."""


def draw_stage(
    page: Page, grasp_map: GraspMap, scene: Scene, positions: Array, aspect: float
) -> Array:
    """Draw lit module, points and robot, seen from where all of some positions (k, 3) [m] are seen.

    Return the position of the camera [m]; `aspect` is the width of the picture divided by its
    height.
    """
    page.scene.add_light_ambient("/sky", intensity=1.0)
    for name, strength, position in (
        ("lamp", 1.7, (-2.0, -3.5, 8.0)),  # from above
        ("fill", 0.6, (5.0, -2.0, -5.0)),
    ):
        page.scene.add_light_directional(
            f"/{name}", intensity=strength, position=position, cast_shadow=False
        )
    draw_module(page, "module", scene)
    draw_points(page, grasp_map)
    draw_robot(page, "robot", scene)
    return aim_camera(page, positions, aspect)


def draw_query(
    page: Page, graph: StanceGraph, plan: Plan | None, goal: Array, tolerance: float
) -> None:
    """Draw plan, goal region, a ball about a position [m], obstacles and occupied points."""
    draw_plan(page, "plan", graph.grasp_map, plan)
    page.mesh("goal", ball_mesh(np.zeros(3), tolerance), to_rgba(GOAL_COLOUR, 0.35), position=goal)
    page.remove("obstacles")
    page.frame("obstacles")
    for k, box in enumerate(graph.obstacles):
        page.mesh(f"obstacles/{k}", mesh_of_box(box), to_rgba(OBSTACLE_COLOUR, 0.75))
    page.remove("occupied")
    if graph.occupied:
        places = graph.grasp_map.positions[sorted(graph.occupied)]
        balls = [ball_mesh(position, OCCUPIED_RADIUS) for position in places]
        page.mesh("occupied", merged(balls), to_rgba(OCCUPIED_COLOUR))


def draw_module(page: Page, name: str, scene: Scene) -> None:
    """Draw racks, walls and rails as descendants of `name`, grouped by face."""
    page.frame(name)
    for k, solid in enumerate(scene.surroundings):
        folder = f"{name}/{solid.face or 'rest'}"
        if folder not in page:
            page.frame(folder)
        page.mesh(f"{folder}/{k}", solid.mesh, solid.colour)


def draw_points(page: Page, grasp_map: GraspMap) -> None:
    """Draw the graspable points as nodes `points/FACE`."""
    disc = cylinder_mesh(POINT_RADIUS, POINT_HEIGHT)
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
            cast_shadow=False,
            receive_shadow=False,
        )


def colour_points(page: Page, grasp_map: GraspMap, marks: Marks) -> None:
    """Set the colours of the graspable points, and enlarge the marked ones."""
    scales = np.ones(len(grasp_map), dtype=np.float32)
    scales[list(marks.points)] = MARKED_SCALE
    # Unlike all others, the colours of batched meshes must be linear: the sRGB curve is inverted.
    share = to_rgba_array(marks.colours)[:, :3]
    bright = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    colours = np.round(255.0 * bright).astype(np.uint8)
    for face, chosen in points_by_face(grasp_map).items():
        node = page.nodes[f"points/{face}"]
        node.batched_colors, node.batched_scales = colours[chosen], scales[chosen]


def points_by_face(grasp_map: GraspMap) -> dict[str, IntArray]:
    """Return the indices of the points of each face."""
    faces = np.array(grasp_map.faces)
    return {face: np.flatnonzero(faces == face) for face in sorted(set(grasp_map.faces))}


def draw_robot(page: Page, name: str, scene: Scene) -> None:
    """Draw the robot with a node for each link."""
    page.remove(name)
    page.frame(name)
    for link in {solid.link for solid in scene.robot}:
        page.frame(_node(name, link))
    for k, solid in enumerate(scene.robot):
        if not solid.covered:
            page.mesh(f"{_node(name, solid.link)}/shape{k}", solid.mesh, solid.colour)


def pose_robot(page: Page, name: str, scene: Scene, configuration: Configuration) -> None:
    """Move a robot that is drawn to a configuration."""
    for link, (position, quaternion) in scene.link_poses(configuration).items():
        node = page.nodes.get(_node(name, link))
        if node is not None:
            # In a file, numbers of single precision take less space once they are compressed.
            node.position, node.wxyz = np.float32(position), np.float32(quaternion)


def show_collision_shapes(page: Page, name: str, scene: Scene, alone: bool) -> None:
    """Show the collision shapes of a robot alone, or what is drawn in their place."""
    for k, solid in enumerate(scene.robot):
        path = f"{_node(name, solid.link)}/shape{k}"
        if solid.covered and alone:
            page.mesh(path, solid.mesh, (*solid.colour[:3], 1.0))
        elif solid.covered:
            page.remove(path)
        elif not solid.checked:
            page.show(path, not alone)


def _node(name: str, link: str) -> str:
    """Return the node of a robot's link; none lies below another, since poses are in the world."""
    return f"{name}/{link.replace('/', '.')}"


def draw_plan(page: Page, name: str, grasp_map: GraspMap, plan: Plan | None) -> None:
    """Draw base path and footholds of a plan, numbered by stance, or nothing for None."""
    page.remove(name)
    page.frame(name)
    if plan is None:
        return
    route = Route.of(grasp_map, plan)
    page.mesh(f"{name}/path", tube_mesh(route.line, PATH_RADIUS), to_rgba(BASE_COLOUR))
    balls = [ball_mesh(position, STANCE_RADIUS) for position in route.stances]
    page.mesh(f"{name}/stances", merged(balls), to_rgba(BASE_COLOUR))
    numbers: dict[tuple[float, ...], list[str]] = {}
    for limb, colour in enumerate(LIMB_COLOURS[: plan.world.robot.limbs]):
        held = [hold for hold in route.footholds if hold.limb == limb]
        marks = merged([ball_mesh(hold.position, FOOTHOLD_RADIUS) for hold in held])
        page.mesh(f"{name}/footholds{limb}", marks, to_rgba(colour))
        for hold in held:
            numbers.setdefault(tuple(hold.position.tolist()), []).append(str(hold.stance))
    for k, (position, stances) in enumerate(numbers.items()):
        point = np.argmin(np.linalg.norm(grasp_map.positions - np.array(position), axis=1))
        above = np.array(position) + LABEL_LIFT * grasp_map.normals[point]
        page.label(f"{name}/number{k}", ", ".join(stances), above)


def draw_pale_path(page: Page, name: str, plan: Plan | None) -> None:
    """Draw the base path of a plan pale, or nothing for None."""
    page.remove(name)
    if plan is not None and len(plan.stances) > 1:
        page.mesh(name, tube_mesh(plan_base_path(plan), 0.8 * PATH_RADIUS), to_rgba(GHOST_PATH))


def draw_tree(page: Page, tree: Array) -> None:
    """Draw explored steps by the base positions at their ends, shape (e, 2, 3) [m]."""
    page.remove("tree")
    if len(tree):
        colour = tuple(round(255 * part) for part in to_rgba(TREE_COLOUR)[:3])
        page.nodes["tree"] = page.scene.add_line_segments("/tree", tree, colour, thickness=0.006)


def visible_positions(grasp_map: GraspMap, goal: Array, plan: Plan | None) -> Array:
    """Return the positions that a camera should see: points, goal and stances, shape (k, 3) [m]."""
    bases = np.zeros((0, 3)) if plan is None else plan.motion.base_positions
    return np.concatenate([grasp_map.positions, goal[None], bases])


def aim_camera(page: Page, positions: Array, aspect: float) -> Array:
    """Move the camera so that it sees all of some positions (k, 3) [m]; return its position [m].

    `aspect` is the width of the picture divided by its height.
    """
    x, y, z = (0.5 * (positions.min(axis=0) + positions.max(axis=0))).tolist()
    camera = Camera((x, y, z), azimuth=AZIMUTH, elevation=ELEVATION)
    camera = camera.seeing(positions, MARGIN, aspect)
    eye: Array = np.array(camera.lookat) - camera.distance * camera.axes[2]
    page.set_camera(eye, np.array(camera.lookat))
    return eye


def hidden_faces(grasp_map: GraspMap, eye: Array) -> set[str]:
    """Return the faces that a camera at `eye` [m] sees from behind, so that they hide the rest."""
    hidden = set()
    for face, chosen in points_by_face(grasp_map).items():
        normal = grasp_map.normals[chosen].mean(axis=0)
        if float((eye - grasp_map.positions[chosen].mean(axis=0)) @ normal) < 0.0:
            hidden.add(face)
    return hidden


def ball_mesh(position: Array, radius: float) -> Mesh:
    """Return a ball about a position [m]."""
    return rod_mesh(position, position, radius)


def tube_mesh(line: Array, radius: float) -> Mesh:
    """Return a tube along a polyline, shape (k, 3) [m], or a ball if it has no length."""
    pieces = [rod_mesh(a, b, radius) for a, b in pairwise(line) if np.linalg.norm(b - a) > 1e-6]
    return merged(pieces or [ball_mesh(line[0], radius)])
