"""Draws module, robot and plans on a page, each under names of its own."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.figures import BASE_COLOUR, GOAL_COLOUR
from mlivr_gym.pictures.plan_paths import base_line
from mlivr_gym.pictures.rendering import MARGIN
from mlivr_gym.pictures.route import FOOTHOLD_RADIUS, PATH_RADIUS, STANCE_RADIUS, Route
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.simulation.scene import rgba
from mlivr_gym.viewer.page import Page
from mlivr_gym.viewer.solids import (
    Colour,
    Mesh,
    Scene,
    box_mesh,
    capsule_mesh,
    cylinder_mesh,
    joined,
    rod_mesh,
)
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

POINT_RADIUS, POINT_HEIGHT = 0.026, 0.006
"""Size of a graspable point [m]; it is larger than in the scene, to be clicked at."""

ASPECT = 1.6
"""Width over height of the picture that the first camera is made for."""

GHOST_PATH, TREE_COLOUR, OBSTACLE_COLOUR = "#9fc7a5", "#b197fc", "#d95926"
"""Colours of the path of a plan before, of explored steps and of obstacles."""

GHOST_OPACITY = 0.35
"""Opacity of a robot that another is compared with."""

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
"""The quaternion of no turn."""


def draw_module(page: Page, grasp_map: GraspMap, scene: Scene) -> None:
    """Draw racks, walls, rails and points, those of each face below `module/` and its name."""
    for k, solid in enumerate(scene.surroundings):
        folder = f"module/{solid.face or 'rest'}"
        if folder not in page:
            page.frame(folder, np.zeros(3), IDENTITY)
        page.mesh(f"{folder}/{k}", solid.mesh, solid.colour)
    disc = cylinder_mesh(POINT_RADIUS, POINT_HEIGHT)
    for face in sorted(set(grasp_map.faces)):
        chosen = np.array([name == face for name in grasp_map.faces])
        turns = Rotation.from_matrix(grasp_map.rotations[chosen]).as_quat(scalar_first=True)
        colours = np.zeros((int(chosen.sum()), 3))
        page.copies(f"points/{face}", disc, grasp_map.positions[chosen], turns, colours)


def draw_obstacles(page: Page, boxes: tuple[Box, ...]) -> None:
    """Draw boxes that are not the map's, in place of those drawn before."""
    page.remove("obstacles")
    page.frame("obstacles", np.zeros(3), IDENTITY)
    for k, box in enumerate(boxes):
        mesh = box_mesh(box.half).moved(np.array(box.centre), np.array(box.rotation))
        page.mesh(f"obstacles/{k}", mesh, _with_opacity(OBSTACLE_COLOUR, 0.75))


def draw_robot(page: Page, name: str, scene: Scene, opacity: float = 1.0) -> None:
    """Draw the robot, its links below one another so that few numbers pose it."""
    paths = {"world": name}
    page.frame(name, np.zeros(3), IDENTITY)
    for link in scene.links:
        paths[link.name] = f"{paths[link.parent]}/{link.name.split('/')[-1]}"
        page.frame(paths[link.name], link.position, link.quaternion)
    for k, solid in enumerate(scene.robot):
        colour = (*solid.colour[:3], solid.colour[3] * opacity)
        page.mesh(f"{paths[solid.link]}/shape{k}", solid.mesh, colour)


def pose_robot(page: Page, name: str, scene: Scene, configuration: Configuration) -> None:
    """Put a robot that is drawn into a configuration."""
    position, quaternion, joints = configuration
    paths = {"world": name}
    for link in scene.links:
        paths[link.name] = f"{paths[link.parent]}/{link.name.split('/')[-1]}"
        if link.parent == "world":
            page.move(paths[link.name], position)
            page.turn(paths[link.name], quaternion)
        elif link.joint is not None:
            page.turn(paths[link.name], link.turned(joints))


def draw_plan(page: Page, grasp_map: GraspMap, plan: Plan) -> None:
    """Draw base path and footholds of a plan, numbered by stance, below `plan`."""
    route = Route.of(grasp_map, plan)
    page.remove("plan")
    page.frame("plan", np.zeros(3), IDENTITY)
    page.mesh("plan/path", tube(route.line, PATH_RADIUS), rgba(BASE_COLOUR))
    balls = [ball_mesh(place, STANCE_RADIUS) for place in route.stances]
    page.mesh("plan/stances", joined(balls), rgba(BASE_COLOUR))
    for limb, colour in enumerate(LIMB_COLOURS[: plan.world.robot.limbs]):
        held = [hold.position for hold in route.footholds if hold.limb == limb]
        marks = joined([ball_mesh(place, FOOTHOLD_RADIUS) for place in held])
        page.mesh(f"plan/footholds{limb}", marks, rgba(colour))
    places: dict[tuple[float, ...], list[str]] = {}
    for place, text, colour in route.labels():
        if colour != BASE_COLOUR:
            places.setdefault(tuple(place.round(6).tolist()), []).append(text)
    for k, (at, texts) in enumerate(places.items()):
        page.label(f"plan/number{k}", ", ".join(texts), np.array(at))


def draw_ghost(page: Page, plan: Plan | None) -> None:
    """Draw the base path of another plan, pale, or of none."""
    page.remove("ghost")
    if plan is not None and len(plan.stances) > 1:
        page.mesh("ghost", tube(base_line(plan), 0.8 * PATH_RADIUS), rgba(GHOST_PATH))


def draw_goal(page: Page, goal: Array, tolerance: float) -> None:
    """Draw the ball in which the goal is reached [m]."""
    colour = _with_opacity(GOAL_COLOUR, 0.35)
    page.mesh("goal", ball_mesh(np.zeros(3), tolerance), colour, position=goal)


def draw_tree(page: Page, tree: Array) -> None:
    """Draw explored steps by the base positions at their ends, shape (e, 2, 3) [m]."""
    page.lines("tree", tree, rgba(TREE_COLOUR), 0.006)


def light_module(page: Page, grasp_map: GraspMap) -> None:
    """Light the module softly from everywhere, and from above the near corner."""
    page.light("sky", 1.15)
    page.light("lamp", 1.3, np.array([-3.0, -6.0, 7.0]))
    page.light("fill", 0.7, np.array([5.0, 4.0, -3.0]))
    _ = grasp_map


def first_view(page: Page, grasp_map: GraspMap) -> None:
    """Look at the whole map."""
    points = grasp_map.positions
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    x, y, z = middle.tolist()
    camera = Camera((x, y, z)).seeing(points, MARGIN, ASPECT)
    page.look(middle - camera.distance * camera.axes[2], middle)


def hidden_faces(grasp_map: GraspMap, eye: Array) -> set[str]:
    """Faces whose points are seen from behind by a camera at `eye` [m], so that they hide all."""
    hidden = set()
    for face in set(grasp_map.faces):
        chosen = np.array([name == face for name in grasp_map.faces])
        normal = grasp_map.normals[chosen].mean(axis=0)
        if float((eye - grasp_map.positions[chosen].mean(axis=0)) @ normal) < 0.0:
            hidden.add(face)
    return hidden


def ball_mesh(place: Array, radius: float) -> Mesh:
    """A ball about a place [m]."""
    return capsule_mesh(radius, 0.0).moved(place, np.eye(3))


def tube(line: Array, radius: float) -> Mesh:
    """A tube along a line, shape (k, 3) [m]; a ball where it has no length."""
    pieces = [
        rod_mesh(a, b, radius)
        for a, b in zip(line, line[1:], strict=False)
        if np.linalg.norm(b - a) > 1e-6
    ]
    return joined(pieces or [ball_mesh(line[0], radius)])


def _with_opacity(colour: str, opacity: float) -> Colour:
    return (*rgba(colour)[:3], opacity)
