"""Limits from which the duration of a step follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from mlivr_gym.motion.time_scaling import MAX_DURATION
from mlivr_gym.schema import Choice, OrNone, Tuples
from mlivr_gym.simulation.parameter_set import ParameterSet

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


GENTLE = Limits(torque=0.4, grasp_force=25.0, grasp_torque=12.0, surface_speed=0.1)
"""Limits with a reserve for a robot that differs from the model of the controller."""

CAREFUL = Limits(torque=0.4, grasp_force=12.0, grasp_torque=6.0, surface_speed=0.1)
"""Limits with half the grasp loads of `GENTLE`, for a robot whose grasps may be three times as soft
as assumed and give way the more."""

STATION = Limits(
    torque=0.5, grasp_force=500.0, grasp_torque=2000.0, surface_speed=0.1, rise_time=2.0
)
"""Limits for arms of the size of a space station's, of some 14 m and 1,600 kg."""

PACES = {"fast": Limits(), "gentle": GENTLE, "careful": CAREFUL, "station": STATION}
"""Limits by name."""

Limits.presets = PACES
