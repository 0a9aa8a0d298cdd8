"""The dynamic model: the scene with motors, compliant grasps and sensors, in zero gravity.

**Joints** have motors with the manufacturer's torque limits and, as their inertia, the rotors' too
(`RobotSpec.limb_dynamics`); the controller is a program of its own, see `controller`.

**Grasps** are springs and dampers in N/m and N m/rad between the grasp frame of a gripper and an
anchor, a frame that is put on the point when the limb grasps it: six actuators a limb, along and
about the anchor's axes, with no control. They are switched on and off together
(`opt.disableactuator`). A weld could not do: its softness is normalised by mass. The damping is
close to critical for the whole robot on one grasp, so that it neither swings on it nor creeps.

**Contacts** are MuJoCo's penalty contacts with its default time constant of 0.02 s and damping
ratio of 1. Links of a limb that cannot meet are left out, and a gripper may touch what lies behind
the surface of the point that it holds, leaves or grasps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import Kind, Tuples
from mlivr_gym.simulation.figures import Figures
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.scene import ROBOT, SURROUNDINGS, scene_spec
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

FIRST_GRIPPER_BIT = 2
"""Bit of `contype` that stands for the gripper of limb 0; those of the other limbs follow."""

AXES = ("x", "y", "z", "about_x", "about_y", "about_z")
"""Axes of a grasp, in the order of its actuators and sensors."""


@dataclass(frozen=True)
class Physics(Figures):
    """Figures of grasps and failures.

    Attributes
    ----------
    timestep
        Time step [s]; `experiments/dynamic_simulation.py` shows what it changes.
    grasp_stiffness
        Restoring force of a grasp [N/m].
    grasp_damping
        Its damping [N s/m]; nine tenths of critical for 64 kg.
    grasp_rotational_stiffness
        Restoring torque of a grasp [N m/rad].
    grasp_rotational_damping
        Its damping [N m s/rad]; critical for 40 kg m^2, that of the
        two-limb robot about a grasp.
    capture_distance
        A gripper farther than this from its point cannot grasp it [m].
    capture_angle
        Nor one turned by more than this from it [rad].
    hold_force
        Largest force that a grasp holds [N].
    hold_torque
        Largest torque that a grasp holds [N m].
    saturation_time
        A joint whose torque is at its limit for longer than this has failed [s].
    limit_margin
        A joint farther outside its limits than this has failed [rad]; the
        manufacturer's controller stops there.
    """

    timestep: float = 0.002
    grasp_stiffness: float = 1.0e4
    grasp_damping: float = 1.5e3
    grasp_rotational_stiffness: float = 2.0e3
    grasp_rotational_damping: float = 5.7e2
    capture_distance: float = 0.01
    capture_angle: float = float(np.deg2rad(2.0))
    hold_force: float = 200.0
    hold_torque: float = 100.0
    saturation_time: float = 0.1
    limit_margin: float = float(np.deg2rad(3.0))

    called: ClassVar[str] = "physics"
    kinds: ClassVar[Mapping[str, Kind[Any]]] = {
        "timestep": Tuples((), 1e-5, 0.1, "s"),
        **dict.fromkeys(
            (
                "grasp_stiffness", "grasp_damping", "grasp_rotational_stiffness",
                "grasp_rotational_damping", "capture_distance", "capture_angle", "hold_force",
                "hold_torque", "saturation_time", "limit_margin",
            ),
            Tuples((), 1e-12, 1e12),
        ),
    }  # fmt: skip


def dynamics_spec(
    grasp_map: GraspMap,
    robot: RobotSpec,
    physics: Physics | None = None,
    obstacles: Sequence[Box] = (),
) -> mujoco.MjSpec:
    """The scene of `scene.scene_spec` with everything that dynamics needs.

    The actuator of joint k of limb i is `"limb{i}/joint{k}"`; those of its grasp are
    `"limb{i}/grasp/x"` to `"limb{i}/grasp/about_z"`, in actuator group i + 1; each has a sensor of
    its force under the same name. The anchor of limb i is body and site `"limb{i}/anchor"`. Sensors
    `"contact"`, `"velocity"` and `"angular_momentum"` belong to the whole robot.

    Parameters
    ----------
    grasp_map
        The map.
    robot
        The robot.
    physics
        Figures; by default those of `Physics`.
    obstacles
        Further boxes.

    Raises
    ------
    RobotError
        If the robot's masses are not known, see `RobotSpec.limb_dynamics`.
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
        _add_motors(spec, limb, torque_limits[limb].tolist())
        _add_grasp(spec, limb, physics)
        grippers |= gripper_bit(limb)
        for geom in spec.body(f"limb{limb}/gripper").geoms:
            # Not SURROUNDINGS, but a bit of each limb, which single boxes can be told not to meet.
            geom.contype, geom.conaffinity = ROBOT, ROBOT | gripper_bit(limb)
    for geom in spec.worldbody.geoms:
        geom.contype, geom.conaffinity = SURROUNDINGS | grippers, 0
    whole = {"objtype": mujoco.mjtObj.mjOBJ_XBODY, "objname": "base"}
    spec.add_sensor(name="contact", type=mujoco.mjtSensor.mjSENS_CONTACT, **whole, intprm=[1, 1, 1])
    whole["objtype"] = mujoco.mjtObj.mjOBJ_BODY
    spec.add_sensor(name="velocity", type=mujoco.mjtSensor.mjSENS_SUBTREELINVEL, **whole)
    spec.add_sensor(name="angular_momentum", type=mujoco.mjtSensor.mjSENS_SUBTREEANGMOM, **whole)
    return spec


def gripper_bit(limb: int) -> int:
    """Bit of `contype` of the boxes that the gripper of a limb meets."""
    return 1 << (FIRST_GRIPPER_BIT + limb)


def _add_motors(spec: mujoco.MjSpec, limb: int, torque_limits: Sequence[float]) -> None:
    for k, limit in enumerate(torque_limits, 1):
        name = f"limb{limb}/joint{k}"
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
    kind, what = mujoco.mjtSensor.mjSENS_ACTUATORFRC, mujoco.mjtObj.mjOBJ_ACTUATOR
    spec.add_sensor(name=actuator, type=kind, objtype=what, objname=actuator)
