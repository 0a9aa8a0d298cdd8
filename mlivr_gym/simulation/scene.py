"""The MuJoCo scene: cabin, racks, seat tracks, handrails, graspable points and the robot.

`scene_spec` returns a `mujoco.MjSpec`, from which a model is compiled or MJCF exported. The geoms
of each cabin face have a geom group of their own (`FACE_GROUPS`), so that a figure can hide the
face in front.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.errors import SceneError, ShapeError
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.robot.limb_dynamics import arm_data, arm_dynamics, arm_of
from mlivr_gym.robot.specification import LIMB_COLOURS, RobotSpec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.values import unique
from mlivr_gym.world.boxes import BOX, POINT, Box, scene_name
from mlivr_gym.world.grasp_map import GraspMap

FACE_GROUPS = {"deck": 1, "forward": 2, "aft": 3, "overhead": 4, "starboard": 5, "port": 5}
"""Geom group of each cabin face; the robot has group 0."""

_BODY, _GRIPPER = (0.93, 0.93, 0.95, 1), (0.15, 0.15, 0.17, 1)
_STEEL, _POINT, _PANEL = (0.70, 0.72, 0.75, 1), (0.95, 0.75, 0.10, 1), (0.80, 0.82, 0.84, 1)
_COLOURS = {
    "panel": _PANEL, "closeout": _PANEL, "bulkhead": _PANEL, "rack": (0.90, 0.90, 0.88, 1),
    "track": (0.45, 0.48, 0.52, 1), "handrail": (0.10, 0.35, 0.75, 1), "stanchion": _STEEL,
    "obstacle": (0.85, 0.35, 0.15, 0.85),
}  # fmt: skip
_METAL = ("track", "handrail")

ROBOT, SURROUNDINGS = 1, 2
"""Bits of `contype` and `conaffinity`: shapes of the robot collide with each other and with the
surroundings; boxes do not collide with boxes."""

_TOUCHES = {"contype": ROBOT, "conaffinity": ROBOT | SURROUNDINGS}


def rgba(colour: str) -> tuple[float, float, float, float]:
    """Return the components of a colour such as `"#1f77b4"`, opaque."""
    r, g, b = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return (r, g, b, 1.0)


def scene_spec(
    grasp_map: GraspMap, robot: RobotSpec, obstacles: Sequence[Box] = ()
) -> mujoco.MjSpec:
    """Return the scene of a robot in a cabin.

    Its geoms are the shapes of the collision checks. Boxes are named `"box/{id}"`, capsules of limb
    i `"limb{i}/{link}/{number}"`, the body `"body"`. Pairs of links of a limb that cannot touch are
    excluded.

    The body of the robot is `"base"` with the free joint `"base"`. Joint k of limb i is
    `"limb{i}/joint{k}"`, its flange frame is the site `"limb{i}/flange"`, its grasp frame the site
    `"limb{i}/grasp"`. Graspable points are the sites `"point/{id}"`.

    Parameters
    ----------
    grasp_map
        The map.
    robot
        The robot.
    obstacles
        Boxes in addition to those of the map.

    Returns
    -------
    mujoco.MjSpec
        The specification, from which a model is compiled.

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
            contype=SURROUNDINGS, conaffinity=ROBOT, quat=_quaternion(np.array(box.rotation)),
        )  # fmt: skip
    for point, face, position, rotation in zip(
        grasp_map.ids, grasp_map.faces, grasp_map.positions, grasp_map.rotations, strict=True
    ):
        world.add_site(
            name=scene_name(POINT, point), pos=position, quat=_quaternion(rotation),
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
    spec.modelname = robot.name
    spec.compiler.degree = False  # MuJoCo would take the ranges of joints for degrees
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.add_material(name="matt", specular=0.1, shininess=0.1)
    shapes = LimbShapes(robot)
    base = _add_base(spec, robot)
    for i in range(robot.limbs):
        links = _add_limb(base, robot, i)
        links["gripper"] = _add_gripper(links["wrist_3"], robot, i)
        _add_capsules(links, robot, i)
        for first, second in shapes.never(i):
            spec.add_exclude(bodyname1=_body_name(first, i), bodyname2=_body_name(second, i))
    return spec


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile the model of a scene.

    Raises
    ------
    SceneError
        If MuJoCo refuses the scene; the message has its reason.
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
        A model compiled from a specification without joints other than those of `robot_alone`.
    data
        The MuJoCo data of the model.
    position
        Base position in the world, shape (3,) [m].
    quaternion
        Base orientation in the world w, x, y, z, shape (4,).
    joints
        Joint angles, shape (N, 6) [rad].
    """
    data.qpos[:3], data.qpos[3:7], data.qpos[7:] = position, quaternion, np.ravel(joints)
    mujoco.mj_forward(model, data)


def _quaternion(rotation: Array) -> Array:
    """Return the quaternion w, x, y, z of a rotation matrix."""
    quaternion: Array = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    return quaternion


def _add_base(spec: mujoco.MjSpec, robot: RobotSpec) -> mujoco.MjsBody:
    """Add the free body of the robot, with a disc that marks its front; return it."""
    half = 0.5 * robot.body_size
    base = spec.worldbody.add_body(name="base", pos=[0, 0, 0])
    base.add_freejoint(name="base")
    base.add_geom(
        name="body", type=mujoco.mjtGeom.mjGEOM_BOX, size=[half] * 3, rgba=_BODY, material="matt",
        mass=robot.body_mass, **_TOUCHES,
    )  # fmt: skip
    base.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, pos=[0, 0, half], size=[0.6 * half, 0.004, 0],
        rgba=(0.1, 0.1, 0.12, 1), mass=0, contype=0, conaffinity=0,
    )  # fmt: skip
    return base


def _add_limb(base: mujoco.MjsBody, robot: RobotSpec, i: int) -> dict[str, mujoco.MjsBody]:
    """Add the links of a limb with joints and inertias; return them by name."""
    limb = robot.limb
    known = robot.dynamics is not None or arm_of(limb) is not None
    dynamics = robot.limb_dynamics if known else arm_dynamics("ur5e")
    mount = _quaternion(robot.mount_rotations[i])
    parent = base.add_body(name=f"limb{i}", pos=robot.mount_positions[i], quat=mount)
    radius, length = dynamics.base_size
    _cylinder(parent, dynamics.base_mass, radius, length, 0.5 * length)
    links = {"base": parent}
    for k, ((offset, quaternion), link) in enumerate(
        zip(limb.link_offsets, LINKS[1:-1], strict=True)
    ):
        parent = parent.add_body(name=f"limb{i}/{link}", pos=offset, quat=quaternion)
        links[link] = parent
        parent.add_joint(
            name=f"limb{i}/joint{k + 1}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1],
            range=limb.limits[k], armature=dynamics.rotor_inertias[k],
        )  # fmt: skip
        parent.explicitinertial = True
        parent.mass, parent.ipos = dynamics.masses[k], dynamics.centres[k]
        parent.fullinertia = list(dynamics.inertias[k])
    return links


def _cylinder(
    body: mujoco.MjsBody, mass: float, radius: float, length: float, height: float
) -> None:
    """Give a body the inertia of a cylinder along z with its centre at a height [m]."""
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    body.mass, body.ipos = mass, [0, 0, height]
    body.inertia = [across, across, 0.5 * mass * radius**2]
    body.explicitinertial = True


def _add_gripper(flange: mujoco.MjsBody, robot: RobotSpec, i: int) -> mujoco.MjsBody:
    """Add the gripper of a limb, a cylinder, with sites of flange and grasp frame; return it."""
    unseen = {"size": [0.005, 0, 0], "rgba": (0, 0, 0, 0)}
    flange.add_site(name=f"limb{i}/flange", **unseen)
    flange.add_site(name=f"limb{i}/grasp", pos=[0, 0, robot.tool_length], **unseen)
    gripper = flange.add_body(name=f"limb{i}/gripper")
    radius = arm_data("ur5e")["gripper"]["radius"]
    length = max(robot.tool_length, 0.01)
    _cylinder(gripper, robot.gripper_mass, radius, length, 0.5 * robot.tool_length)
    return gripper


def _add_capsules(links: dict[str, mujoco.MjsBody], robot: RobotSpec, i: int) -> None:
    """Add the collision capsules of a limb, with its links in two shades of one colour."""
    colour = rgba(LIMB_COLOURS[i])
    pale = (*(0.55 * c + 0.45 for c in colour[:3]), 1.0)
    count: Counter[str] = Counter()
    for capsule in robot.shapes:
        number = LINKS.index(capsule.link)
        tint = {0: _STEEL, LINKS.index("gripper"): _GRIPPER}.get(
            number, colour if number % 2 == 0 else pale
        )
        links[capsule.link].add_geom(
            name=f"limb{i}/{capsule.link}/{count[capsule.link]}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*capsule.start, *_apart(capsule)],
            size=[capsule.radius, 0, 0], rgba=tint, material="matt", mass=0, **_TOUCHES,
        )  # fmt: skip
        count[capsule.link] += 1


def _apart(capsule: Capsule) -> list[float]:
    """Return the end of a capsule, offset by 1e-9 m from an equal start, to give a direction."""
    end = list(capsule.end)
    if capsule.start == capsule.end:
        end[2] += 1e-9
    return end


def _body_name(link: str, limb: int) -> str:
    """Return the name of a link's body in the model."""
    return "base" if link == "body" else f"limb{limb}" if link == "base" else f"limb{limb}/{link}"
