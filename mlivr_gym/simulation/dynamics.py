"""The dynamic model: the scene with joint motors, compliant grasps and sensors, in zero gravity.

**Joints** have motors with the manufacturer's torque limits, and the rotor inertias
(`RobotSpec.dynamics_of`). The controller is a separate program, see `joint_controller`.

**Grasps** are six-dimensional spring-dampers in N/m and N m/rad between the grasp frame of a
gripper and its anchor, a frame that is put on the point at the moment of the grasp. Each limb has
six actuators without control input, along and about the axes of the anchor, which are switched
together (`opt.disableactuator`). MuJoCo's weld constraint is no alternative: its softness is
normalised by mass. The damping is close to critical for the whole robot on one grasp.

**Contacts** are MuJoCo's soft contacts with its default time constant of 0.02 s and damping ratio
of 1. Pairs of links of a limb that cannot touch are excluded. A gripper may touch boxes behind the
surface of the point that it holds, leaves or grasps.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.disturbances import Disturbance
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.parameters import ControllerParameters, Physics
from mlivr_gym.simulation.scene import ROBOT, SURROUNDINGS, scene_spec
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

FIRST_GRIPPER_BIT = 2
"""Bit of `contype` for the gripper of limb 0; those of the other limbs follow."""

AXES = ("x", "y", "z", "about_x", "about_y", "about_z")
"""Axes of a grasp, in the order of its actuators and sensors."""


class SimulatedRobot(NamedTuple):
    """A robot in MuJoCo, with what determines how it moves."""

    model: mujoco.MjModel
    """Model of `dynamics_spec`."""
    data: mujoco.MjData
    """Its state."""
    robot: RobotSpec
    """The robot that the controller assumes."""
    physics: Physics
    """Parameters of grasps and failures."""
    controller: ControllerParameters
    """Parameters of the joint controller."""
    disturbance: Disturbance
    """Difference between the simulated robot and module and the model of the controller."""


@checked(ARGUMENTS)
def dynamics_spec(
    grasp_map: GraspMap,
    robot: RobotSpec,
    physics: Physics | None = None,
    obstacles: Sequence[Box] = (),
) -> mujoco.MjSpec:
    """Return the scene of `scene.scene_spec` with motors, compliant grasps and sensors.

    The motor of a joint is the actuator of its name, see `RobotSpec.named_joints`; those of the
    grasp of limb i are `"limb{i}/grasp/x"` to `"limb{i}/grasp/about_z"`, in actuator group i + 1.
    Each has a force sensor of the same name. The anchor of limb i is body and site
    `"limb{i}/anchor"`. The sensors `"contact"`, `"velocity"` and `"angular_momentum"` belong to the
    whole robot.

    The grasps are by default those of `Physics()`; obstacles are boxes in addition to those of the
    map. Raises a `RobotError` if the robot's masses are not known, see `RobotSpec.dynamics_of`.
    """
    physics = physics or Physics()
    torque_limits = robot.torque_limits
    spec = scene_spec(grasp_map, robot, obstacles)
    spec.modelname += "-dynamics"
    spec.option.timestep = physics.timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    grippers = 0
    for limb in range(robot.limbs):
        _add_motors(spec, robot.named_joints[limb], torque_limits[limb].tolist())
        _add_grasp(spec, limb, physics)
        grippers |= gripper_bit(limb)
        for geom in spec.body(f"limb{limb}/gripper").geoms:
            # Not SURROUNDINGS, but a bit of each limb, which single boxes can be told not to meet.
            geom.contype, geom.conaffinity = ROBOT, ROBOT | gripper_bit(limb)
    for geom in spec.geoms:
        if geom.contype == SURROUNDINGS:
            geom.contype, geom.conaffinity = SURROUNDINGS | grippers, 0
    whole = {"objtype": mujoco.mjtObj.mjOBJ_XBODY, "objname": "base"}
    spec.add_sensor(name="contact", type=mujoco.mjtSensor.mjSENS_CONTACT, **whole, intprm=[1, 1, 1])
    whole["objtype"] = mujoco.mjtObj.mjOBJ_BODY
    spec.add_sensor(name="velocity", type=mujoco.mjtSensor.mjSENS_SUBTREELINVEL, **whole)
    spec.add_sensor(name="angular_momentum", type=mujoco.mjtSensor.mjSENS_SUBTREEANGMOM, **whole)
    return spec


def gripper_bit(limb: int) -> int:
    """Return the bit of `contype` of the boxes with which the gripper of a limb collides."""
    return 1 << (FIRST_GRIPPER_BIT + limb)


def _add_motors(spec: mujoco.MjSpec, names: Sequence[str], torque_limits: Sequence[float]) -> None:
    """Add a torque motor with its limit to each joint of a limb."""
    for name, limit in zip(names, torque_limits, strict=True):
        # A stop would hide how far the controller lets a joint go; leaving the limits is a failure
        # that is reported.
        spec.joint(name).limited = mujoco.mjtLimited.mjLIMITED_FALSE
        spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED, gainprm=[1.0] + [0.0] * 9,
            biastype=mujoco.mjtBias.mjBIAS_NONE, forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE,
            forcerange=[-float(limit), float(limit)],
        )  # fmt: skip
        _add_force_sensor(spec, name)


def _add_grasp(spec: mujoco.MjSpec, limb: int, physics: Physics) -> None:
    """Add the anchor of a limb, and the spring-damper that pulls the gripper to it."""
    anchor = spec.worldbody.add_body(name=f"limb{limb}/anchor")
    anchor.add_site(name=f"limb{limb}/anchor", size=[0.005, 0, 0], rgba=(0, 0, 0, 0))
    along = (physics.grasp_stiffness, physics.grasp_damping)
    about = (physics.grasp_rotational_stiffness, physics.grasp_rotational_damping)
    for k, axis in enumerate(AXES):
        name = f"limb{limb}/grasp/{axis}"
        actuator = spec.add_actuator(
            name=name, target=f"limb{limb}/grasp", refsite=f"limb{limb}/anchor",
            trntype=mujoco.mjtTrn.mjTRN_SITE,
            gear=np.eye(6)[k], gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE, group=limb + 1,
        )  # fmt: skip
        stiffness, damping = along if k < 3 else about
        actuator.gainprm[0], actuator.biasprm[1], actuator.biasprm[2] = 0.0, -stiffness, -damping
        _add_force_sensor(spec, name)


def _add_force_sensor(spec: mujoco.MjSpec, actuator: str) -> None:
    """Add a sensor of the force of an actuator, under the same name."""
    kind, what = mujoco.mjtSensor.mjSENS_ACTUATORFRC, mujoco.mjtObj.mjOBJ_ACTUATOR
    spec.add_sensor(name=actuator, type=kind, objtype=what, objname=actuator)
