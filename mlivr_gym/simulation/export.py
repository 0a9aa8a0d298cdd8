"""Export of the simulation model as MJCF, for use with MuJoCo alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import checked_configuration
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import Anything
from mlivr_gym.simulation.dynamics import dynamics_spec
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.parameters import Physics
from mlivr_gym.simulation.scene import SURROUNDINGS, compile_spec
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.given_points import STANCE
from mlivr_gym.world.grasp_map import GraspMap

START = "start"
"""Name of the keyframe with the robot at rest in its first stance."""

CAMERA = "cabin"
"""Name of the camera inside the cabin, which looks at the robot."""


@checked({**ARGUMENTS, "configuration": Anything(), "points": STANCE})
def exported_model(
    grasp_map: GraspMap,
    robot: RobotSpec,
    configuration: tuple[Array, Array, Array],
    points: Sequence[int | str],
    obstacles: Sequence[Box] = (),
) -> str:
    """Return the model in which plans are executed, as MJCF.

    It contains the joint motors, the compliant grasps of all limbs (switched on for the points that
    are held), the sensors, the keyframe `START` for `mj_resetDataKeyframe`, and the camera
    `CAMERA`. Names are those of `dynamics.dynamics_spec`.

    The configuration is base position [m], base quaternion w, x, y, z, and joint angles (N, 6)
    [rad]; `points` has index or id of the point that each limb holds; obstacles are boxes in
    addition to those of the map. Raises a `RobotError` if the robot's masses are not known, see
    `RobotSpec.dynamics_of`, and a `SimulationError` if a gripper is not at its point.
    """
    physics = Physics()
    simulation = Simulation(grasp_map, robot, physics, obstacles)
    held = [grasp_map.index(point) for point in points]
    simulation.reset(*checked_configuration(robot, configuration), held)
    spec = dynamics_spec(grasp_map, robot, physics, obstacles)
    for name in (f"limb{limb}/anchor" for limb in range(robot.limbs)):
        anchor = simulation.model.body(name)
        spec.body(name).pos, spec.body(name).quat = anchor.pos, anchor.quat
    for geom in (geom for geom in spec.geoms if geom.contype & SURROUNDINGS):
        # Boxes behind a point that is held do not collide with the gripper that holds it.
        geom.contype = int(simulation.model.geom(geom.name).contype[0])
    low, high = np.array(grasp_map.cabin)
    spec.worldbody.add_camera(
        name=CAMERA, pos=[0.5 * (low[0] + high[0]), 0.9 * low[1], 0.6 * high[2]],
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY, targetbody="base", fovy=60.0,
    )  # fmt: skip
    spec.add_key(name=START, qpos=simulation.data.qpos.copy())
    compile_spec(spec)
    exported: str = spec.to_xml()
    return exported
