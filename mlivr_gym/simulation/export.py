"""The simulation model as MJCF, for MuJoCo alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import checked_configuration
from mlivr_gym.motion.arguments import WALK
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import Anything
from mlivr_gym.simulation.dynamics import Physics, dynamics_spec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.scene import compiled
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import STANCE, GraspMap

START = "start"
"""Name of the keyframe: the robot at rest in its first stance."""

CAMERA = "cabin"
"""Name of the camera, which looks at the robot from inside the cabin."""


@checked({**WALK, "configuration": Anything(), "points": STANCE})
def exported_model(
    grasp_map: GraspMap,
    robot: RobotSpec,
    configuration: tuple[Array, Array, Array],
    points: Sequence[int],
    obstacles: Sequence[Box] = (),
) -> str:
    """The model that plans are carried out in, as MJCF.

    It has the motors of the joints, the grasps of all limbs, those of the points that are held
    switched on, sensors, the keyframe `START`, which MuJoCo loads with `mj_resetDataKeyframe`, and
    the camera `CAMERA`. Names are those of `dynamics.dynamics_spec`.

    Parameters
    ----------
    grasp_map
        The map.
    robot
        The robot.
    configuration
        Base position [m], base quaternion w, x, y, z, joint angles (N, 6) [rad].
    points
        Point index that each limb holds.
    obstacles
        Further boxes.

    Raises
    ------
    RobotError
        If the robot's masses are not known, see `RobotSpec.limb_dynamics`.
    """
    physics = Physics()
    simulation = Simulation(grasp_map, robot, physics, obstacles)
    held = [grasp_map.index(point) for point in points]
    simulation.reset(*checked_configuration(robot, configuration), held)
    spec = dynamics_spec(grasp_map, robot, physics, obstacles)
    for name in (f"limb{limb}/anchor" for limb in range(robot.limbs)):
        anchor = simulation.model.body(name)
        spec.body(name).pos, spec.body(name).quat = anchor.pos, anchor.quat
    for geom in spec.worldbody.geoms:
        # What lies behind the points that are held does not meet the grippers that hold them.
        geom.contype = int(simulation.model.geom(geom.name).contype[0])
    low, high = np.array(grasp_map.cabin)
    spec.worldbody.add_camera(
        name=CAMERA, pos=[0.5 * (low[0] + high[0]), 0.9 * low[1], 0.6 * high[2]],
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY, targetbody="base", fovy=60.0,
    )  # fmt: skip
    spec.add_key(name=START, qpos=simulation.data.qpos.copy())
    compiled(spec)
    exported: str = spec.to_xml()
    return exported
