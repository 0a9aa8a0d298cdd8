"""Write the limits, gains and tolerances of the simulation as texts for the docs."""

from __future__ import annotations

import numpy as np
from reports import table

from mlivr_gym.robot.limb_dynamics import arm_dynamics
from mlivr_gym.simulation import PACES, DisturbanceRanges, Physics
from mlivr_gym.simulation.grippers import PATIENCE
from mlivr_gym.simulation.parameters import CONTROLLERS, PAPER, ControllerParameters

LIMITS = {
    "torque": "fraction of each joint's largest torque",
    "speed": "fraction of each joint's largest speed",
    "grasp_force": "force on a grasp [N]",
    "grasp_torque": "torque on a grasp [N m]",
    "surface_speed": "speed of a gripper on departure and approach [m/s]",
    "rise_time": "time in which the acceleration rises and falls [s]",
}
"""Meaning and unit of each limit."""


def limits() -> str:
    """Return the table of the limits of each pace."""
    rows = [
        [words, *(f"{getattr(pace, field):g}" for pace in PACES.values())]
        for field, words in LIMITS.items()
    ]
    return table(" | ".join(["limit", *(f"`{name}`" for name in PACES)]), rows)


def controller() -> str:
    """Return the paragraphs on motors, controllers and grasps."""
    full, physics, sensor = ControllerParameters(), Physics(), DisturbanceRanges()
    delayed = CONTROLLERS["delayed"]
    rotor = arm_dynamics("ur5e").rotor_inertias[0]
    return (
        f"Motors have the maker's torque limits, joints their rotors' inertia of {rotor:g} kg m^2, "
        "as in MuJoCo Menagerie. The controller\n"
        f"runs at {1.0 / full.period:.0f} Hz.\n\n"
        f"* `paper` is the PD control of the paper, with {PAPER.kp_free[0]:g} N m/rad and "
        f"{PAPER.kd_free[0]:g} N m s/rad for all joints.\n"
        "* `feedforward` is `paper` with *feedforward*: it adds the torques that the motion needs "
        "by inverse dynamics, and corrects\n"
        "  the references for the deflection of the grasps.\n"
        "* `full`, the default, is `feedforward` with a *guided* approach: a sensor on the gripper "
        "sees its point with a noise of\n"
        f"  {1e3 * sensor.sensor_position:g} mm and {np.rad2deg(sensor.sensor_angle):.2g} degrees "
        f"and guides the limb to it. The gripper waits at most {PATIENCE / full.guidance:g} s "
        "until it is close.\n"
        "  Gains differ for supporting and free limbs: in a sampled controller, the velocity gain "
        "of a joint must stay below its\n  inertia divided by the period.\n"
        f"* `delayed` is `full` with gains for a delay of {1e3 * delayed.delay:g} ms from a "
        "reading to its torque, with\n  which those of `full` are unstable: "
        f"{delayed.kp_free[0]:g} N m/rad and {delayed.kd_free[0]:g} N m s/rad for all joints, "
        "reduced in\n  the directions in which the inertia of the robot on its grasps is small "
        "(`simulation/joint_controller.py`).\n"
        "* `station` is `full` with gains for arms of the size of a space station's.\n\n"
        f"A grasp is a spring and damper ({physics.grasp_stiffness:g} N/m, "
        f"{physics.grasp_rotational_stiffness:g} N m/rad) that is established only within "
        f"{1e3 * physics.capture_distance:g} mm and {np.rad2deg(physics.capture_angle):.2g} "
        "degrees.\n"
        f"A missed grasp, a torque at its limit for {physics.saturation_time:g} s, any "
        f"contact, a grasp loaded beyond {physics.hold_force:g} N or {physics.hold_torque:g} N m "
        "and a joint\n"
        "beyond its limits end the walk; the failure states time, limb and values.\n"
    )
