"""The MuJoCo scene: cabin, racks, seat tracks, handrails, graspable points and the robot.

`scene_spec` returns a `mujoco.MjSpec`, from which a model is compiled or MJCF exported. Geoms of each cabin
face have a geom group of their own (`FACE_GROUPS`), so that a picture can leave out the face in front.
"""

from __future__ import annotations

import os
import sys
from typing import Any

if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
    # MuJoCo chooses its GL library when it is imported; without a screen only EGL can work.
    os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mlivr_gym.grasp_map import GraspMap, Handrail
from mlivr_gym.robot import LIMB_COLOURS, RobotSpec, ur5e_data

Array = NDArray[np.float64]

FACE_GROUPS = {"deck": 1, "forward": 2, "aft": 3, "overhead": 4, "starboard": 5, "port": 5}
"""Geom group of each cabin face; the robot has group 0."""

_FACE_AXES = {"deck": (2, 1), "overhead": (2, -1), "forward": (1, 1), "aft": (1, -1)}
"""Axis across each rack face and the sign of its inward normal."""

_UR5E = {"d1": 0.1625, "a2": 0.425, "a3": 0.3922, "d4": 0.1333, "d5": 0.0997, "d6": 0.0996}
_PANEL, _RACK, _TRACK, _RAIL = (
    (0.80, 0.82, 0.84, 1),
    (0.90, 0.90, 0.88, 1),
    (0.45, 0.48, 0.52, 1),
    (0.10, 0.35, 0.75, 1),
)
_POINT, _BODY, _STEEL = (0.95, 0.75, 0.10, 1), (0.93, 0.93, 0.95, 1), (0.70, 0.72, 0.75, 1)


def rgba(colour: str) -> tuple[float, float, float, float]:
    """Components of a colour like `"#1f77b4"`, opaque."""
    r, g, b = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return (r, g, b, 1.0)


def scene_spec(grasp_map: GraspMap, robot: RobotSpec) -> mujoco.MjSpec:
    """Scene of a robot in a cabin.

    The robot's body is `"base"` with free joint `"base"`; joint k of limb i is `"limb{i}/joint{k}"`, its
    flange frame is site `"limb{i}/flange"`, its grasp point site `"limb{i}/grasp"`. Graspable points are sites named by
    their ids.
    """
    spec = mujoco.MjSpec()
    spec.modelname = f"{grasp_map.name}-{robot.name}"
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.35, 0.35, 0.35]
    spec.visual.quality.shadowsize = 4096
    spec.visual.map.znear = 0.005
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[1, 1, 1], rgb2=[0.86, 0.89, 0.93], width=256, height=256,
    )  # fmt: skip
    spec.add_material(name="matt", specular=0.1, shininess=0.1)
    spec.add_material(name="metal", specular=0.6, shininess=0.6)
    world = spec.worldbody
    low, high = grasp_map.cabin
    for x in np.linspace(low[0] + 0.2 * (high[0] - low[0]), low[0] + 0.8 * (high[0] - low[0]), 3):
        world.add_light(
            pos=[float(x), float(low[1] * 0.5), float(high[2] * 0.8)], dir=[0.0, 0.35, -1.0],
            diffuse=[0.35, 0.35, 0.35], castshadow=bool(abs(x - 0.5 * (low[0] + high[0])) < 1.0),
        )  # fmt: skip
    world.add_light(
        pos=[0.0, 0.0, 0.0], dir=[0.0, 0.3, 1.0], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=[0.4, 0.4, 0.4], castshadow=False,
    )  # fmt: skip
    for side in (-1.0, 1.0):
        world.add_light(
            pos=[float(low[0] if side > 0 else high[0]), 0.0, 0.0], dir=[side, 0.0, 0.0],
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, diffuse=[0.3, 0.3, 0.3], castshadow=False,
        )  # fmt: skip
    _add_module(world, grasp_map)
    for segment in grasp_map.segments:
        start, end, normal = (np.array(v) for v in (segment.start, segment.end, segment.normal))
        along = (end - start) / np.linalg.norm(end - start)
        rotation = np.column_stack([along, np.cross(normal, along), normal])
        _box(
            world, 0.5 * (start + end) - 0.5 * segment.thickness * normal,
            (0.5 * float(np.linalg.norm(end - start)), 0.5 * segment.width, 0.5 * segment.thickness),
            _TRACK, segment.face, rotation, material="metal",
        )  # fmt: skip
    for rail in grasp_map.handrails:
        _add_handrail(world, rail)
    for point, face, position, rotation in zip(
        grasp_map.ids, grasp_map.faces, grasp_map.positions, grasp_map.rotations, strict=True
    ):
        world.add_site(
            name=point, pos=position, quat=_quaternion(rotation), type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[0.016, 0.003, 0.0], rgba=_POINT, group=FACE_GROUPS[face],
        )  # fmt: skip
    _add_robot(world, robot)
    return spec


def set_configuration(
    model: mujoco.MjModel, data: mujoco.MjData, position: Array, quaternion: Array, joints: Array
) -> None:
    """Put the robot into a configuration and update the scene.

    Args:
        model: Compiled from `scene_spec`.
        data: Its data.
        position: Base position [m], shape (3,).
        quaternion: Base orientation w, x, y, z, shape (4,).
        joints: Joint angles [rad], shape (N, 6).
    """
    address = int(model.joint("base").qposadr[0])
    data.qpos[address : address + 3], data.qpos[address + 3 : address + 7] = position, quaternion
    for limb, angles in enumerate(joints):
        for k, angle in enumerate(angles):
            data.qpos[int(model.joint(f"limb{limb}/joint{k + 1}").qposadr[0])] = angle
    mujoco.mj_forward(model, data)


def _quaternion(rotation: Array) -> Array:
    quaternion: Array = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    return quaternion


def _box(
    body: Any, centre: Array, half: Any, colour: tuple[float, ...], face: str,
    rotation: Array | None = None, material: str = "matt",
) -> None:  # fmt: skip
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre, size=half, rgba=colour, material=material,
        group=FACE_GROUPS[face], contype=0, conaffinity=0,
        quat=_quaternion(np.eye(3) if rotation is None else rotation),
    )  # fmt: skip


def _add_module(world: Any, grasp_map: GraspMap) -> None:
    """Racks, corner closeouts and end bulkheads, where the map brings their figures."""
    figures = grasp_map.scene
    planes = figures.get("panel_planes")
    if not planes:
        return
    start, end = figures["rack_zone_x"]
    middle, half_x = 0.5 * (start + end), 0.5 * (end - start)
    levels = {
        "deck": planes["deck_z"], "overhead": planes["overhead_z"],
        "forward": planes["forward_y"], "aft": planes["aft_y"],
    }  # fmt: skip
    half_post, half_width = 0.5 * figures["rack_post_section"][0], 0.5 * figures["rack_outer_span"]
    half_length = 0.5 * figures["rack_post_length"]
    for face, (axis, sign) in _FACE_AXES.items():
        run = 3 - axis
        centre, half = np.zeros(3), np.zeros(3)
        centre[0], half[0] = middle, half_x
        centre[axis], half[axis] = levels[face] - sign * 0.06, 0.02
        centre[run], half[run] = 0.5 * sum(levels[f] for f, (a, _) in _FACE_AXES.items() if a == run), 1.02
        _box(world, centre, tuple(half), _PANEL, face)
    for rack in figures.get("racks", []):
        axis, sign = _FACE_AXES[rack["face"]]
        run = 3 - axis
        for offset, half_across in ((0.0, half_width - 2 * half_post), (-1.0, half_post), (1.0, half_post)):
            centre, half = np.zeros(3), np.zeros(3)
            centre[0], half[0] = rack["x_centre"] + offset * (half_width - half_post), half_across - 0.002
            depth = 0.0 if offset == 0.0 else 0.001
            centre[axis], half[axis] = levels[rack["face"]] - sign * (0.02 + depth), 0.02
            centre[run], half[run] = rack["run_centre"], half_length
            _box(world, centre, tuple(half), _RACK if offset == 0.0 else _STEEL, rack["face"])
    (y0, z0), (y1, z1) = figures["corner_closeout"]
    for sy in (-1.0, 1.0):
        for sz in (-1.0, 1.0):
            angle = np.arctan2(sz * (z1 - z0), sy * (y1 - y0))
            rotation = Rotation.from_euler("x", angle).as_matrix()
            centre = np.array([middle, sy * 0.5 * (y0 + y1), sz * 0.5 * (z0 + z1)])
            face = "deck" if sz < 0 else "overhead"
            _box(world, centre, (half_x, 0.09, 0.01), _PANEL, face, rotation)
    zone = figures["airlock_end"]
    centre_x, half_x = 0.5 * sum(zone["x"]), 0.5 * (zone["x"][1] - zone["x"][0])
    for face, at in (("deck", zone["deck_z"]), ("overhead", zone["upper_z"][1])):
        _box(world, np.array([centre_x, 0.0, at]), (half_x, zone["y"][1], 0.01), _PANEL, face)
    for face, at in (("forward", zone["y"][0]), ("aft", zone["y"][1])):
        _box(world, np.array([centre_x, at, -0.05]), (half_x, 0.01, 1.1), _PANEL, face)
    opening = figures["node2_opening"]
    _add_ring(world, start - 0.01, 1.13, [0.5 * sum(opening["y"]), 0.5 * sum(opening["z"])], 0.6325, "starboard")
    airlock = figures["airlock"]
    _add_ring(world, figures["airlock_end"]["x"][1], 1.43, airlock["centre_yz"], airlock["inner_radius"], "port")


def _add_ring(world: Any, x: float, outer: float, centre: list[float], inner: float, face: str) -> None:
    """A square bulkhead with a square opening: four boxes."""
    y, z = centre
    parts = (
        ((-outer + z - inner) / 2, (outer + z - inner) / 2, 0.0, outer),
        ((outer + z + inner) / 2, (outer - z - inner) / 2, 0.0, outer),
    )
    for mid_z, half_z, mid_y, half_y in parts:
        _box(world, np.array([x, mid_y, mid_z]), (0.01, half_y, half_z), _PANEL, face)
    for mid_y, half_y in (
        ((-outer + y - inner) / 2, (outer + y - inner) / 2),
        ((outer + y + inner) / 2, (outer - y - inner) / 2),
    ):
        _box(world, np.array([x, mid_y, z]), (0.01, half_y, inner), _PANEL, face)


def _add_handrail(world: Any, rail: Handrail) -> None:
    """A bar on two posts; only the bounding box where the bar is not known."""
    low, high = np.array(rail.min), np.array(rail.max)
    if rail.bar_min is None or rail.bar_max is None:
        _box(world, 0.5 * (low + high), tuple(0.5 * (high - low)), _RAIL, rail.face)
        return
    bar_low, bar_high = np.array(rail.bar_min), np.array(rail.bar_max)
    _box(world, 0.5 * (bar_low + bar_high), tuple(0.5 * (bar_high - bar_low)), _RAIL, rail.face, material="metal")
    along = "xyz".index(rail.axis)
    for side in (0, 1):
        post_low, post_high = low.copy(), high.copy()
        if side == 0:
            post_high[along] = bar_low[along] + 0.008
        else:
            post_low[along] = bar_high[along] - 0.008
        _box(world, 0.5 * (post_low + post_high), tuple(0.5 * (post_high - post_low)), _STEEL, rail.face)


def _add_robot(world: Any, robot: RobotSpec) -> None:
    data, limb = ur5e_data(), robot.limb
    half = 0.5 * robot.body_size
    base = world.add_body(name="base", pos=[0, 0, 0])
    base.add_freejoint(name="base")
    base.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=[half] * 3, rgba=_BODY, material="matt", mass=robot.body_mass,
        contype=0, conaffinity=0,
    )  # fmt: skip
    base.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, pos=[0, 0, half], size=[0.6 * half, 0.004, 0], rgba=(0.1, 0.1, 0.12, 1),
        mass=0, contype=0, conaffinity=0,
    )  # fmt: skip
    quarter = [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]
    origins = (
        ([0, 0, limb.d1], None), ([0, 0, 0], quarter), ([limb.a2, 0, 0], None),
        ([limb.a3, 0, limb.d4], None), ([0, -limb.d5, 0], quarter), ([0, limb.d6, 0], [quarter[0], -quarter[1], 0, 0]),
    )  # fmt: skip
    capsules = {entry["link"]: entry for entry in data["capsules"]}
    stretch = {
        "upper_arm": (abs(limb.a2) / _UR5E["a2"], 1.0, limb.d4 / _UR5E["d4"]),
        "forearm": (abs(limb.a3) / _UR5E["a3"], 1.0, limb.d4 / _UR5E["d4"]),
        "wrist_1": (1.0, 1.0, limb.d5 / _UR5E["d5"]), "wrist_3": (1.0, 1.0, limb.d6 / _UR5E["d6"]),
    }  # fmt: skip
    for i, (rotation, position) in enumerate(zip(robot.mount_rotations, robot.mount_positions, strict=True)):
        colour = rgba(LIMB_COLOURS[i])
        pale = tuple(0.55 * c + 0.45 for c in colour[:3]) + (1.0,)
        parent = base.add_body(name=f"limb{i}", pos=position, quat=_quaternion(rotation))
        _capsule(parent, capsules["base"], (1.0, 1.0, 1.0), _STEEL)
        for k, ((offset, quaternion), link) in enumerate(zip(origins, data["links"], strict=True)):
            extra = {} if quaternion is None else {"quat": quaternion}
            parent = parent.add_body(name=f"limb{i}/{link['name']}", pos=offset, **extra)
            parent.add_joint(
                name=f"limb{i}/joint{k + 1}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1],
                range=list(limb.joint_limits[k]),
            )  # fmt: skip
            inertia = np.array(link["inertia_urdf"])
            parent.explicitinertial = True
            parent.mass, parent.ipos = link["mass"], link["com_urdf"]
            parent.fullinertia = [
                inertia[0, 0],
                inertia[1, 1],
                inertia[2, 2],
                inertia[0, 1],
                inertia[0, 2],
                inertia[1, 2],
            ]
            _capsule(
                parent, capsules[link["name"]], stretch.get(link["name"], (1.0, 1.0, 1.0)), colour if k % 2 else pale
            )
        parent.add_site(name=f"limb{i}/flange", size=[0.005, 0, 0], rgba=(0, 0, 0, 0))
        parent.add_site(name=f"limb{i}/grasp", pos=[0, 0, robot.tool_length], size=[0.005, 0, 0], rgba=(0, 0, 0, 0))
        gripper = parent.add_body(name=f"limb{i}/gripper")
        gripper.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER, pos=[0, 0, 0.5 * robot.tool_length],
            size=[data["gripper"]["radius"], max(0.5 * robot.tool_length, 0.005), 0], rgba=(0.15, 0.15, 0.17, 1),
            mass=robot.gripper_mass, contype=0, conaffinity=0,
        )  # fmt: skip


def _capsule(body: Any, entry: dict[str, Any], stretch: tuple[float, float, float], colour: tuple[float, ...]) -> None:
    start, end = np.array(entry["p0"]) * stretch, np.array(entry["p1"]) * stretch
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*start, *end], size=[entry["r"], 0, 0], rgba=colour,
        material="matt", mass=0, contype=0, conaffinity=0,
    )  # fmt: skip
