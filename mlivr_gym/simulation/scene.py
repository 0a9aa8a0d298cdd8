"""The MuJoCo scene: cabin, racks, seat tracks, handrails, graspable points and the robot.

`scene_spec` returns a `mujoco.MjSpec`, from which a model is compiled or MJCF exported. Geoms of
each cabin face have a separate geom group (`FACE_GROUPS`), so that a picture can leave out the face
in front.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.errors import SceneError, ShapeError
from mlivr_gym.robot.model import ROBOT as ROBOT
from mlivr_gym.robot.model import STEEL_COLOUR, quaternion_of, robot_spec_alone
from mlivr_gym.robot.model import SURROUNDINGS as SURROUNDINGS
from mlivr_gym.robot.model import rgba as rgba
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.values import unique
from mlivr_gym.world.boxes import BOX, POINT, Box, scene_name
from mlivr_gym.world.grasp_map import GraspMap

FACE_GROUPS = {"deck": 1, "forward": 2, "aft": 3, "overhead": 4, "starboard": 5, "port": 5}
"""Geom group of each cabin face; the robot has group 0."""

_POINT, _PANEL = (0.95, 0.75, 0.10, 1), (0.80, 0.82, 0.84, 1)
_COLOURS = {
    "panel": _PANEL, "closeout": _PANEL, "bulkhead": _PANEL, "rack": (0.90, 0.90, 0.88, 1),
    "track": (0.45, 0.48, 0.52, 1), "handrail": (0.10, 0.35, 0.75, 1), "stanchion": STEEL_COLOUR,
    "obstacle": (0.85, 0.35, 0.15, 0.85),
}  # fmt: skip
_METAL = ("track", "handrail")


def scene_spec(
    grasp_map: GraspMap, robot: RobotSpec, obstacles: Sequence[Box] = ()
) -> mujoco.MjSpec:
    """Scene of a robot in a cabin.

    Its geoms are the shapes that collisions are checked with; boxes are called `"box/{id}"`,
    capsules of limb i `"limb{i}/{link}/{number}"`, the body `"body"`. Pairs of a limb's links that
    cannot meet are excluded.

    The robot's body is `"base"` with free joint `"base"`; joint k of limb i is
    `"limb{i}/joint{k}"`, its flange frame is site `"limb{i}/flange"`, its grasp point site
    `"limb{i}/grasp"`. Graspable points are sites `"point/{id}"`.

    Raises
    ------
    ShapeError
        If two boxes have the same id.
    """
    boxes = (*grasp_map.boxes, *obstacles)
    unique([box.id for box in boxes], "box", ShapeError)
    spec = robot_alone(robot)
    spec.modelname = f"{grasp_map.name}-{robot.name}"
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.35] * 3, [0.6] * 3
    spec.visual.map.znear = 0.005
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[1, 1, 1], rgb2=[0.86, 0.89, 0.93], width=256, height=256,
    )  # fmt: skip
    spec.add_material(name="metal", specular=0.6, shininess=0.6)
    world = spec.worldbody
    for box in boxes:
        world.add_geom(
            name=scene_name(BOX, box.id), type=mujoco.mjtGeom.mjGEOM_BOX, pos=box.centre,
            size=box.half, rgba=_COLOURS[box.kind],
            material="metal" if box.kind in _METAL else "matt", group=FACE_GROUPS.get(box.face, 0),
            contype=SURROUNDINGS, conaffinity=ROBOT, quat=quaternion_of(np.array(box.rotation)),
        )  # fmt: skip
    for point, face, position, rotation in zip(
        grasp_map.ids, grasp_map.faces, grasp_map.positions, grasp_map.rotations, strict=True
    ):
        world.add_site(
            name=scene_name(POINT, point), pos=position, quat=quaternion_of(rotation),
            type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.016, 0.003, 0.0], rgba=_POINT,
            group=FACE_GROUPS.get(face, 0),
        )  # fmt: skip
    return spec


def robot_alone(robot: RobotSpec) -> mujoco.MjSpec:
    """A robot that floats in empty space without gravity; names are those of `scene_spec`.

    A robot whose masses are not known has those of the UR5e, which a picture does not need and
    `dynamics.dynamics_spec` refuses.
    """
    spec: mujoco.MjSpec = robot_spec_alone(robot)
    shapes = LimbShapes(robot)
    for i in range(robot.limbs):
        for first, second in shapes.never(i):
            spec.add_exclude(bodyname1=_body_name(first, i), bodyname2=_body_name(second, i))
    return spec


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model of a scene.

    Raises
    ------
    SceneError
        If MuJoCo refuses it, with its reason.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise SceneError(
            f"MuJoCo cannot build scene {spec.modelname!r}: {' '.join(str(error).split())}"
        ) from None


def set_configuration(
    model: mujoco.MjModel, data: mujoco.MjData, position: Array, quaternion: Array, joints: Array
) -> None:
    """Put the robot into a configuration and update the scene.

    Parameters
    ----------
    model
        Compiled from a spec whose only joints are those of `robot_alone`.
    data
        Its data.
    position
        Base position [m], shape (3,).
    quaternion
        Base orientation w, x, y, z, shape (4,).
    joints
        Joint angles [rad], shape (N, 6).
    """
    data.qpos[:3], data.qpos[3:7], data.qpos[7:] = position, quaternion, np.ravel(joints)
    mujoco.mj_forward(model, data)


def _body_name(link: str, limb: int) -> str:
    return "base" if link == "body" else f"limb{limb}" if link == "base" else f"limb{limb}/{link}"
