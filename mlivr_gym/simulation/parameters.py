"""Parameters of a simulation: limits of a step, grasps and failures, and the joint controller.

All are checked when they are made, and can be given by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from mlivr_gym.errors import SettingError
from mlivr_gym.motion.time_scaling import MAX_DURATION
from mlivr_gym.schema import Choice, FieldPath, Flag, OrNone, Struct, Tuples


class ParameterSet:
    """Base class of the parameter sets of the simulation."""

    label: ClassVar[str]
    """Name of the parameter set in messages."""
    presets: ClassVar[Mapping[str, Any]] = {}
    """Parameter sets that can be given by name."""

    def __post_init__(self) -> None:
        """Check every parameter."""
        self._schema().check(self, FieldPath(self.label, SettingError))

    @classmethod
    def of(cls, given: Self | dict[str, Any] | str | None) -> Self:
        """Return a parameter set from an instance, plain data, or a name; the defaults from None.

        Raises a `SettingError` if no parameter set has this name, or a field is unknown or invalid.
        """
        known = cls.presets or None
        found: Self = cls._schema().given(given, FieldPath(cls.label, SettingError), known)
        return found

    @classmethod
    @cache
    def _schema(cls) -> Struct[Any]:
        """Return the validators of the fields."""
        return Struct.of(cls)


PROFILES = ("fastest", "quintic")
"""Time scalings of the path segments: time-optimal, or the quintic of the paper."""


@dataclass(frozen=True)
class Limits(ParameterSet):
    """Limits of the robot and of the grasps during a step.

    Examples
    --------
    >>> Limits.of("gentle").grasp_force
    25.0
    """

    torque: Annotated[float, Tuples((), 1e-3, 1.0)] = 0.8
    """Fraction of each joint's torque limit that may be used."""
    speed: Annotated[float, Tuples((), 1e-3, 1.0)] = 0.8
    """Fraction of each joint's velocity limit that may be used."""
    grasp_force: Annotated[float, Tuples((), 1e-3, 1e6, "N")] = 60.0
    """Largest force on a grasp [N]."""
    grasp_torque: Annotated[float, Tuples((), 1e-3, 1e6, "N m")] = 30.0
    """Largest torque on a grasp [N m]."""
    surface_speed: Annotated[float, Tuples((), 1e-4, 10.0, "m/s")] = 0.2
    """Largest speed of a gripper during departure and approach [m/s]."""
    rise_time: Annotated[float, Tuples((), 0.01, 10.0, "s")] = 0.2
    """Time in which the acceleration along the path may rise from zero to its maximum and fall
    again [s]; it bounds the jerk. It applies to the profile `"fastest"`."""
    profile: Annotated[str, Choice(PROFILES)] = "fastest"
    """One of `PROFILES`: `"fastest"` follows the limits along each path segment (time-optimal path
    parameterisation), `"quintic"` is the shortest quintic within them."""
    step_duration: Annotated[float | None, OrNone(Tuples((), 1e-3, MAX_DURATION, "s"))] = None
    """Duration of every step [s], to which all segments are slowed down by the same factor; None
    for the shortest."""

    label: ClassVar[str] = "limits"


PACES = {
    "fast": Limits(),
    "gentle": Limits(torque=0.4, grasp_force=25.0, grasp_torque=12.0, surface_speed=0.1),
    "careful": Limits(torque=0.4, grasp_force=12.0, grasp_torque=6.0, surface_speed=0.1),
    "station": Limits(0.5, 0.8, 500.0, 2000.0, surface_speed=0.1, rise_time=2.0),
}
"""Limits by name.

* `"fast"`, the default.
* `"gentle"`: a reserve for a robot that differs from the model of the controller.
* `"careful"`: half the grasp loads of `"gentle"`, for a robot whose grasps may be three times as
  soft as assumed and give way the more.
* `"station"`: for arms of the size of a space station's, of some 14 m and 1,600 kg.
"""

Limits.presets = PACES

POSITIVE = Tuples((), 1e-12, 1e12)
"""Valid stiffness, damping and bounds."""


@dataclass(frozen=True)
class Physics(ParameterSet):
    """Parameters of the simulation, of grasps and of failures."""

    timestep: Annotated[float, Tuples((), 1e-5, 0.1, "s")] = 0.002
    """Time step [s]."""
    grasp_stiffness: Annotated[float, POSITIVE] = 1.0e4
    """Translational stiffness of a grasp [N/m]."""
    grasp_damping: Annotated[float, POSITIVE] = 1.5e3
    """Translational damping of a grasp [N s/m]; nine tenths of critical for 64 kg."""
    grasp_rotational_stiffness: Annotated[float, POSITIVE] = 2.0e3
    """Rotational stiffness of a grasp [N m/rad]."""
    grasp_rotational_damping: Annotated[float, POSITIVE] = 5.7e2
    """Rotational damping of a grasp [N m s/rad]; critical for 40 kg m^2, the inertia of the
    two-limb robot about a grasp."""
    capture_distance: Annotated[float, POSITIVE] = 0.01
    """Largest distance between gripper and point at which a grasp succeeds [m]."""
    capture_angle: Annotated[float, POSITIVE] = float(np.deg2rad(2.0))
    """Largest angle between gripper and point at which a grasp succeeds [rad]."""
    hold_force: Annotated[float, POSITIVE] = 200.0
    """Force beyond which a grasp is lost [N]."""
    hold_torque: Annotated[float, POSITIVE] = 100.0
    """Torque beyond which a grasp is lost [N m]."""
    saturation_time: Annotated[float, POSITIVE] = 0.1
    """Time for which a joint torque may be at its limit before the joint fails [s]."""
    joint_limit_tolerance: Annotated[float, POSITIVE] = float(np.deg2rad(3.0))
    """Angle by which a joint may exceed its limits before it fails [rad]; the manufacturer's
    controller stops there."""

    label: ClassVar[str] = "physics"

    def captures(self, distance: float, angle: float) -> bool:
        """Return whether a gripper captures a point at a distance [m] and an angle [rad]."""
        return distance <= self.capture_distance and angle <= self.capture_angle

    def time_steps(self, duration: float) -> int:
        """Return the number of time steps in a duration [s], at least one."""
        return max(round(duration / self.timestep), 1)


PHYSICS = {
    "default": Physics(),
    "station": Physics(
        grasp_stiffness=1e6, grasp_damping=1e5, grasp_rotational_stiffness=5e6,
        grasp_rotational_damping=1e6, capture_distance=0.05, hold_force=2000.0, hold_torque=6000.0,
        saturation_time=1.0,
    ),
}  # fmt: skip
"""Parameters of grasps and failures by name; those of the end effectors of a space station's arms
are assumed."""

Physics.presets = PHYSICS

PositionGains = Annotated[tuple[float, ...], Tuples((6,), 0.0, 1e6, "N m/rad")]
VelocityGains = Annotated[tuple[float, ...], Tuples((6,), 0.0, 1e6, "N m s/rad")]
"""Gains of the six joints of a limb."""


@dataclass(frozen=True)
class ControllerParameters(ParameterSet):
    """Gains and functions of the joint controller, see `joint_controller`.

    Examples
    --------
    >>> ControllerParameters.of("paper").kp_free
    (100.0, 100.0, 100.0, 100.0, 100.0, 100.0)
    """

    kp_free: PositionGains = (800.0, 1200.0, 1200.0, 200.0, 200.0, 160.0)
    """Position gain of each joint of a free limb [N m/rad]."""
    kd_free: VelocityGains = (40.0, 60.0, 60.0, 10.0, 10.0, 8.0)
    """Velocity gain of each joint of a free limb [N m s/rad]."""
    kp_hold: PositionGains = (800.0, 1200.0, 1200.0, 1000.0, 1400.0, 1200.0)
    """Position gain of each joint of a support limb [N m/rad]."""
    kd_hold: VelocityGains = (80.0, 120.0, 120.0, 50.0, 70.0, 60.0)
    """Velocity gain of each joint of a support limb [N m s/rad]."""
    period: Annotated[float, Tuples((), 1e-5, 0.1, "s")] = 0.002
    """Sampling period [s], rounded to a multiple of the time step."""
    feedforward: Annotated[bool, Flag()] = True
    """Whether the torques of the inverse dynamics and the deflection of the grasps are fed forward,
    see `joint_controller.feedforward`."""
    align_references: Annotated[bool, Flag()] = True
    """Whether the references are set to the encoder readings at the beginning of a step."""
    recovery: Annotated[float, Tuples((), 1e-3, 1e6, "s")] = 1.0
    """Time constant with which the offset of the references decays during departure and swing
    [s]."""
    guidance: Annotated[float, Tuples((), 0.0, 100.0, "1/s")] = 1.0
    """Gain of the guidance of an approach by a sensor on the gripper: rate at which the measured
    error is removed [1/s]; 0 for no guidance."""
    sensor_period: Annotated[float, Tuples((), 1e-4, 1.0, "s")] = 0.02
    """Sampling period of that sensor [s]."""
    delay: Annotated[float, Tuples((), 0.0, 0.1, "s")] = 0.0
    """Delay from a reading to its torque for which the gains are reduced [s]. A reading is compared
    with the reference of its time."""

    label: ClassVar[str] = "controller"


PAPER = ControllerParameters(
    *((100.0,) * 6, (50.0,) * 6) * 2, feedforward=False, align_references=False, guidance=0.0
)  # fmt: skip
"""The controller of the paper: PD control along a trajectory, with the same gains for all joints.

It has neither feedforward nor guidance, and its references stay those of the trajectory."""

CONTROLLERS = {
    "full": ControllerParameters(),
    "feedforward": replace(PAPER, feedforward=True),
    "paper": PAPER,
    "delayed": ControllerParameters(*((2000.0,) * 6, (100.0,) * 6) * 2, delay=0.01),
    "station": ControllerParameters(
        kp_free=(2e5, 2e5, 1e5, 1e4, 5e3, 300.0), kd_free=(1e5, 1e5, 5e4, 5e3, 2e3, 100.0),
        kp_hold=(2e5,) * 6, kd_hold=(1e5,) * 6, recovery=20.0, guidance=0.1,
    ),
}  # fmt: skip
"""Controllers by name.

* `"full"`, the default: feedforward, references aligned at each step, and a guided approach.
* `"feedforward"`: the PD control of the paper with feedforward.
* `"paper"`: the PD control of the paper.
* `"delayed"`: as `"full"`, with gains for a delay of 10 ms; the velocity gain stays below the
  rotational damping of a grasp that is three times as soft as assumed.
* `"station"`: as `"full"`, for arms of the size of a space station's. The robot turns about a
  supporting limb with some 5e5 kg m^2, its body and the parts of the arms beside it with
  1e3 kg m^2 about the joints between them, which limits a sampled derivative gain at 500 Hz to
  5e5 N m s/rad; the last link of a free limb has 9 kg m^2 about its axis.
"""

ControllerParameters.presets = CONTROLLERS
