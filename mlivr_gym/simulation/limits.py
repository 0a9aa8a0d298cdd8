"""Limits of how fast a step may be carried out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from mlivr_gym.motion.clocks import MAXIMUM_DURATION
from mlivr_gym.schema import Choice, Kind, Maybe, Tuples
from mlivr_gym.simulation.figures import Figures

PROFILES = ("fastest", "quintic")
"""Clocks of the pieces of a step: the shortest, or the paper's polynomial."""


@dataclass(frozen=True)
class Limits(Figures):
    """What a step may ask of the robot and of the points it holds.

    Attributes
    ----------
    torque
        Share of each joint's largest torque.
    speed
        Share of each joint's largest speed.
    grasp_force
        Force on a grasp [N].
    grasp_torque
        Torque on a grasp [N m].
    surface_speed
        Speed of a gripper on departure and approach [m/s].
    rise_time
        Time in which the acceleration along the path may change from nothing to its
        largest and back [s]; it bounds the jerk. For the profile `"fastest"`.
    profile
        One of `PROFILES`. On a given path the torques that the dynamics ask for are linear
        in the second derivative and the squared first derivative of the share of a piece:
        `"fastest"` follows the limits along the piece, `"quintic"` takes the shortest quintic.
    step_duration
        Duration of every step [s], whose pieces are slowed down alike; None for the
        shortest.
    """

    torque: float = 0.8
    speed: float = 0.8
    grasp_force: float = 60.0
    grasp_torque: float = 30.0
    surface_speed: float = 0.2
    rise_time: float = 0.2
    profile: str = "fastest"
    step_duration: float | None = None

    called: ClassVar[str] = "limits"
    kinds: ClassVar[Mapping[str, Kind[Any]]] = {
        "torque": Tuples((), 1e-3, 1.0),
        "speed": Tuples((), 1e-3, 1.0),
        "grasp_force": Tuples((), 1e-3, 1e6, "N"),
        "grasp_torque": Tuples((), 1e-3, 1e6, "N m"),
        "surface_speed": Tuples((), 1e-4, 10.0, "m/s"),
        "rise_time": Tuples((), 0.01, 10.0, "s"),
        "profile": Choice(PROFILES),
        "step_duration": Maybe(Tuples((), 1e-3, MAXIMUM_DURATION, "s")),
    }


GENTLE = Limits(torque=0.4, grasp_force=25.0, grasp_torque=12.0, surface_speed=0.1)
"""Limits that leave room for a robot that is not the one the controller knows."""

PACES = {"fast": Limits(), "gentle": GENTLE}
"""Limits by name."""

Limits.named = PACES
