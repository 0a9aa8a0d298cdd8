"""The scene of pictures: `simulation.scene.scene_spec` with a closed hull and moving lamps.

These additions take no part in physics and are not exported.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.limb_meshes import show_limbs
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.scene import FACE_GROUPS, scene_spec
from mlivr_gym.world.boxes import BOX, Box, scene_name
from mlivr_gym.world.grasp_map import GraspMap

SAMPLES, SHADOW_SIZE = 4, 1024
"""Samples of a pixel for antialiasing; width and height of a shadow map [px]."""

HULL_HALF_THICKNESS = 0.03
"""Half the thickness of the hull [m]."""

POINT_HALF = 0.013
"""Half the side of the square that marks a point [m]; a disc takes ten times as long to draw."""

_HULL_COLOUR, _SKY = (0.58, 0.61, 0.65, 1.0), ((0.83, 0.87, 0.92), (0.47, 0.52, 0.60))
_SIDES = {
    "deck": (2, -1), "overhead": (2, 1), "forward": (1, -1), "aft": (1, 1),
    "starboard": (0, -1), "port": (0, 1),
}  # fmt: skip
_KEY, _TOP = "studio/key", "studio/top"


def studio_spec(
    grasp_map: GraspMap, robot: RobotSpec, obstacles: Sequence[Box] = (), capsules: bool = False
) -> mujoco.MjSpec:
    """Return the model of `scene_spec` with lamps and a hull added; its names stay the same.

    Limbs are shown by their visual meshes where these ship, unless `capsules` is set. Raises a
    `ShapeError` if two boxes have the same id.
    """
    spec = scene_spec(grasp_map, robot, obstacles)
    show_limbs(spec, robot, capsules)
    visual = spec.visual
    visual.headlight.ambient, visual.headlight.diffuse = [0.34] * 3, [0.08] * 3
    visual.headlight.specular = [0.0] * 3
    visual.quality.offsamples, visual.quality.shadowsize = SAMPLES, SHADOW_SIZE
    # Without a graphics card, drawing triangles takes most of the time of a picture.
    visual.quality.numslices, visual.quality.numstacks, visual.quality.numquads = 22, 12, 3
    spec.texture("sky").rgb1, spec.texture("sky").rgb2 = _SKY
    for site in spec.worldbody.sites:
        site.type, site.size = mujoco.mjtGeom.mjGEOM_BOX, [POINT_HALF, POINT_HALF, 0.003]
    _light(spec)
    if any(box.kind == "bulkhead" for box in grasp_map.boxes):  # only modules have a hull
        _close(spec, grasp_map)
    return spec


def aim(model: mujoco.MjModel, grasp_map: GraspMap, camera: Camera) -> None:
    """Move the lamps so that they light the target of a camera.

    The key lamp stands next to the camera, at the open side of the cabin, and casts the robot's
    shadow on the wall behind it; the other lamp hangs at the overhead.
    """
    low, high = grasp_map.cabin
    x, tall, deep = camera.lookat[0], high[2] - low[2], high[1] - low[1]
    far = max(0.0, camera.distance - 3.0)
    model.light(_KEY).pos = x - 0.9 - 0.2 * far, low[1] - 0.4 * deep, high[2] - 0.25 * tall
    model.light(_TOP).pos = x + 0.5, 0.5 * (low[1] + high[1]) - 0.1 * deep, high[2] - 0.02 * tall


def _light(spec: mujoco.MjSpec) -> None:
    """Add two lamps with shadows and three soft lights without, all white."""
    spot = {"castshadow": True, "cutoff": 85.0, "exponent": 0.3}
    _lamp(spec, 0.27, [0.15, 0.85, -0.42], name=_KEY, **spot)
    _lamp(spec, 0.28, [0.0, 0.1, -1.0], name=_TOP, **spot)
    soft = {"type": mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, "castshadow": False}
    for strength, direction in ((0.24, (0, 0.15, 1)), (0.2, (1, 0.1, 0)), (0.12, (-1, 0.1, 0))):
        _lamp(spec, strength, list(direction), specular=[0.0] * 3, **soft)


def _lamp(spec: mujoco.MjSpec, strength: float, direction: list[float], **more: object) -> None:
    """Add a white lamp."""
    spec.worldbody.add_light(dir=direction, diffuse=[strength] * 3, **more)


def _close(spec: mujoco.MjSpec, grasp_map: GraspMap) -> None:
    """Add a hull round all boxes; closeouts before the forward wall are hidden with that wall."""
    bounds = np.array([box.bounds for box in grasp_map.boxes])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    for face, (axis, side) in _SIDES.items():
        centre, size = middle.copy(), half + 2.0 * HULL_HALF_THICKNESS
        centre[axis] += side * (half[axis] + HULL_HALF_THICKNESS)
        size[axis] = HULL_HALF_THICKNESS
        spec.worldbody.add_geom(
            name=f"studio/{face}", type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre, size=size,
            rgba=_HULL_COLOUR, material="matt", group=FACE_GROUPS[face], contype=0, conaffinity=0,
        )  # fmt: skip
    for box in grasp_map.boxes:
        if box.kind == "closeout" and box.centre[1] < middle[1]:
            spec.geom(scene_name(BOX, box.id)).group = FACE_GROUPS["forward"]
