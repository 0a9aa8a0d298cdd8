"""The MuJoCo scene: cabin, racks, seat tracks, handrails, graspable points and the robot.

`scene_spec` returns a `mujoco.MjSpec`, from which a model is compiled or MJCF exported. The geoms
of each cabin face have a geom group of their own (`FACE_GROUPS`), so that a figure can hide the
face in front.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.errors import SceneError, ShapeError
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.limb_dynamics import arm_dynamics, gripper_link
from mlivr_gym.robot.rigid import RigidBody, quaternion_of
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.robot.visuals import LIMB_COLOURS
from mlivr_gym.robot.visuals import rgba as rgba
from mlivr_gym.schema import Numbers
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.values import check_unique
from mlivr_gym.world.boxes import BOX, POINT, Box, scene_name
from mlivr_gym.world.grasp_map import GraspMap

ROBOT, SURROUNDINGS = 1, 2
"""Bits of `contype` and `conaffinity`.

The robot's shapes meet each other and the surroundings; boxes never meet.
"""

FACE_GROUPS = {"deck": 1, "forward": 2, "aft": 3, "overhead": 4, "starboard": 5, "port": 5}
"""Geom group of each cabin face; the robot has group 0."""

STEEL_COLOUR, DISC_COLOUR = (0.70, 0.72, 0.75, 1), (0.1, 0.1, 0.12, 1)
ROBOT_COLOURS = {
    "body": (0.93, 0.93, 0.95, 1), "cargo": (0.80, 0.62, 0.38, 1), "base": STEEL_COLOUR,
    "gripper": (0.15, 0.15, 0.17, 1),
}  # fmt: skip
"""Colours of the body, of cargo, and of the links of limbs that do not have the limb's colour."""

_POINT, _PANEL = (0.95, 0.75, 0.10, 1), (0.80, 0.82, 0.84, 1)
COLOURS = {
    "panel": _PANEL, "closeout": _PANEL, "bulkhead": _PANEL, "rack": (0.90, 0.90, 0.88, 1),
    "track": (0.45, 0.48, 0.52, 1), "handrail": (0.10, 0.35, 0.75, 1), "stanchion": STEEL_COLOUR,
    "obstacle": (0.85, 0.35, 0.15, 0.85),
}  # fmt: skip
"""Colour of each kind of box, red, green, blue and opacity."""

_METAL = ("track", "handrail")


@checked(ARGUMENTS)
def scene_spec(
    grasp_map: GraspMap, robot: RobotSpec, obstacles: Sequence[Box] = ()
) -> mujoco.MjSpec:
    """Return the scene of a robot in a cabin.

    Its geoms are the shapes of the collision checks. Boxes are named `"box/{id}"`, capsules of limb
    i `"limb{i}/{link}/{number}"`, the body `"body"`. Pairs of links of a limb that cannot touch are
    excluded.

    The boxes of a face belong to the fixed body `"boxes/{face}"`, the others to the world. The body
    of the robot is `"base"` with the free joint `"base"`. Its joints have the names of
    `RobotSpec.named_joints`. The flange frame of limb i is the site `"limb{i}/flange"`, its grasp
    frame the site `"limb{i}/grasp"`. Graspable points are the sites `"point/{id}"`.

    Obstacles are boxes in addition to those of the map. Raises a `ShapeError` if two boxes have the
    same id.
    """
    boxes = (*grasp_map.boxes, *obstacles)
    check_unique([box.id for box in boxes], "box", ShapeError)
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
    # MuJoCo looks for collisions with a face only near its boxes, and everywhere near the world's.
    faces = dict.fromkeys(box.face for box in boxes if box.face)
    fixed = {face: world.add_body(name=f"boxes/{face}") for face in faces}
    turned = quaternion_of(np.array([box.rotation for box in boxes]).reshape(-1, 3, 3))
    for box, quaternion in zip(boxes, turned, strict=True):
        fixed.get(box.face, world).add_geom(
            name=scene_name(BOX, box.id), type=mujoco.mjtGeom.mjGEOM_BOX, pos=box.centre,
            size=box.half, rgba=COLOURS[box.kind],
            material="metal" if box.kind in _METAL else "matt", group=FACE_GROUPS.get(box.face, 0),
            contype=SURROUNDINGS, conaffinity=ROBOT, quat=quaternion, mass=0.0,
        )  # fmt: skip
    turned = quaternion_of(grasp_map.rotations)
    for point, face, position, quaternion in zip(
        grasp_map.ids, grasp_map.faces, grasp_map.positions, turned, strict=True
    ):
        world.add_site(
            name=scene_name(POINT, point), pos=position, quat=quaternion,
            type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.016, 0.003, 0.0], rgba=_POINT,
            group=FACE_GROUPS.get(face, 0),
        )  # fmt: skip
    return spec


def robot_alone(robot: RobotSpec) -> mujoco.MjSpec:
    """Return a robot that floats in empty space without gravity, with the names of `scene_spec`.

    A robot without known masses has those of the UR5e. Pictures do not depend on them, and
    `dynamics.dynamics_spec` refuses such a robot.
    """
    spec = mujoco.MjSpec()
    spec.modelname, spec.compiler.degree, spec.option.gravity = robot.name, False, [0.0, 0.0, 0.0]
    spec.add_material(name="matt", specular=0.1, shininess=0.1)
    base = _add_body(spec.worldbody, "base", np.eye(4), robot.body_solid)
    base.add_freejoint(name="base")
    _add_shape(base, "body", mujoco.mjtGeom.mjGEOM_BOX, size=0.5 * robot.body_edges)
    if robot.cargo is not None:
        place, size = _placed(robot.cargo_frame), 0.5 * robot.cargo.edges
        _add_shape(base, "cargo", mujoco.mjtGeom.mjGEOM_BOX, size=size, **place)
        for k, (_, ends, radius) in enumerate(robot.cargo.limb_capsules):
            _add_capsule(base, f"cargo/limb/{k}", ends.tolist(), radius)
    for i in range(robot.limbs):
        _add_limb(base, robot, i)
    half = 0.5 * robot.body_edges
    base.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, pos=[0, 0, half[2]],
        size=[0.6 * half[:2].min(), 0.004, 0], rgba=DISC_COLOUR, mass=0, contype=0, conaffinity=0,
    )  # fmt: skip
    shapes = LimbShapes(robot)
    for i in range(robot.limbs):
        for first, second in shapes.never(i):
            spec.add_exclude(bodyname1=_body_name(first, i), bodyname2=_body_name(second, i))
    return spec


def _add_limb(base: mujoco.MjsBody, robot: RobotSpec, i: int) -> None:
    """Add a limb by its number to the body of a robot."""
    mount, limb, names = robot.mounted[i], robot.every_limb[i], robot.named_joints[i]
    dynamics = mount.dynamics or arm_dynamics("ur5e")
    solids = *dynamics.solids, gripper_link(robot.gripper_mass, robot.tool_length)
    frames = mount.frame, *limb.steps, np.eye(4)
    body = base
    for k, (link, solid, frame) in enumerate(zip(LINKS, solids, frames, strict=True)):
        body = _add_body(body, _body_name(link, i), frame, solid)
        if 1 <= k <= len(names):
            body.add_joint(
                name=names[k - 1], axis=[0.0, 0.0, limb.senses[k - 1]], range=limb.limits[k - 1],
                armature=dynamics.rotor_inertias[k - 1],
            )  # fmt: skip
        shapes = [shape for shape in mount.capsules or () if shape.link == link]
        for n, shape in enumerate(shapes):
            _add_capsule(body, f"limb{i}/{link}/{n}", (shape.start, shape.end), shape.radius)
        if link == "wrist_3":
            body.add_site(name=f"limb{i}/flange", size=[0.005] * 3, rgba=[0.0] * 4)
    grasp = [0.0, 0.0, robot.tool_length]
    body.add_site(name=f"limb{i}/grasp", pos=grasp, size=[0.005] * 3, rgba=[0.0] * 4)


def _add_body(parent: mujoco.MjsBody, name: str, frame: Array, solid: RigidBody) -> mujoco.MjsBody:
    """Add a body with a frame in that of its parent, shape (4, 4)."""
    body = parent.add_body(name=name, **_placed(frame))
    if solid.mass:
        body.explicitinertial, body.mass, body.ipos = True, solid.mass, solid.centre
        if any(solid.inertia[3:]):
            body.fullinertia = solid.inertia
        else:
            body.inertia = solid.inertia[:3]
    return body


def _add_capsule(
    body: mujoco.MjsBody, name: str, ends: Sequence[Sequence[float]], radius: float
) -> None:
    """Add a capsule to a body, or if its ends are one a ball."""
    start, end, size = *ends, [radius, 0.0, 0.0]
    if start == end:
        _add_shape(body, name, mujoco.mjtGeom.mjGEOM_SPHERE, pos=start, size=size)
    else:
        # MuJoCo has the shape's z axis point to the end that is named first.
        _add_shape(body, name, mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=(*end, *start), size=size)


def _add_shape(body: mujoco.MjsBody, name: str, kind: mujoco.mjtGeom, **figures: Any) -> None:
    """Add a collision shape to a body; masses are those of the bodies."""
    body.add_geom(
        name=name, type=kind, contype=ROBOT, conaffinity=ROBOT | SURROUNDINGS, material="matt",
        rgba=_colour_of(name), mass=0.0, **figures,
    )  # fmt: skip


def _placed(frame: Array) -> dict[str, Array]:
    """Return position and quaternion of a frame of shape (4, 4)."""
    return {"pos": frame[:3, 3], "quat": quaternion_of(frame[:3, :3])}


def _colour_of(shape: str) -> tuple[float, ...]:
    """Return the colour of a shape of the robot; links have two shades of their limb's colour."""
    limb, _, rest = shape.partition("/")
    part = rest.partition("/")[0]
    if limb == "cargo" and rest:
        return STEEL_COLOUR
    if (part or limb) in ROBOT_COLOURS:
        return ROBOT_COLOURS[part or limb]
    red, green, blue, opaque = rgba(LIMB_COLOURS[int(limb.removeprefix("limb"))])
    if LINKS.index(part) % 2:
        red, green, blue = (0.55 * one + 0.45 for one in (red, green, blue))
    return red, green, blue, opaque


def compile_spec(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile the model of a scene.

    Raises a `SceneError` if MuJoCo refuses the scene; the message has its reason.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise SceneError(
            f"MuJoCo cannot build scene {spec.modelname!r}: {' '.join(str(error).split())}"
        ) from None


@checked({"position": Numbers((3,)), "quaternion": Numbers((4,)), "joints": Numbers((None, 6))})
def set_configuration(
    model: mujoco.MjModel, data: mujoco.MjData, position: Array, quaternion: Array, joints: Array
) -> None:
    """Put the robot into a configuration and update the scene.

    The base position in the world has shape (3,) [m], its quaternion w, x, y, z shape (4,), and the
    joint angles shape (N, 6) [rad]. The specification of the model may have no joints other than
    those of `robot_alone`.
    """
    data.qpos[:3], data.qpos[3:7], data.qpos[7:] = position, quaternion, np.ravel(joints)
    mujoco.mj_forward(model, data)


def _body_name(link: str, limb: int) -> str:
    """Return the name of a link's body in the model."""
    return "base" if link == "body" else f"limb{limb}" if link == "base" else f"limb{limb}/{link}"
