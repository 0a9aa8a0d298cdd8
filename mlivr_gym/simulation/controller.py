"""The controller of the joints, sampled at a finite rate, and how it is guided to a point.

At every period it reads the encoders and asks each joint for

    kp (q_ref - q) + kd (qdot_ref - qdot) + what is fed forward,

cut off at the joint's largest torque and held until the next period. `q_ref` is the trajectory's
angle with a shift added. When a step begins, `rebase` moves the references to where the encoders
are, so that limbs that hold one robot do not work against each other. Departure and swing take that
shift out again, or errors of one step after the other would add up. On approach `guided` moves the
reference of the limb that approaches by what its sensor sees of the point.

A limb that holds carries the whole robot, some 30 kg m^2 about its joints, and is damped by the
grasp; a limb that is free ends in a wrist of hardly more than its rotor's 0.1 kg m^2. Sampled, a
gain of the speed error must stay below the inertia over the period, 50 N m s/rad for that wrist at
500 Hz. So the two have gains of their own.

On one limb the robot rocks slowly. What guides the free limb pushes the base the other way and
feeds that motion; shoulder and elbow of the limb that holds, between heavy parts, damp it. A
gripper waits until it is at rest in the world, since a grasp that takes hold of one that moves
pulls at once by its damper.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from mlivr_gym.schema import Flag, Kind, Tuples, Whole
from mlivr_gym.simulation.figures import Figures


@dataclass(frozen=True)
class Controller(Figures):
    """Gains and abilities of the controller.

    Attributes
    ----------
    kp_free
        Gain of the position error of each joint of a limb that is free [N m/rad].
    kd_free
        Gain of its speed error [N m s/rad].
    kp_hold
        Gain of the position error of each joint of a limb that holds [N m/rad].
    kd_hold
        Gain of its speed error [N m s/rad].
    period
        Time from one reading of the encoders to the next [s], a multiple of the time step.
    feedforward
        Whether what the trajectory needs by the robot's dynamics is fed forward, see
        `feedforward.feedforward`.
    rebase
        Whether references move to where the encoders are when a step begins.
    recovery
        Time in which a shift falls to 1/e on departure and swing [s].
    guided
        Whether a sensor on the gripper guides the approach.
    sensor_period
        Time from one reading of that sensor to the next [s].
    guidance
        Share of the error seen that is taken out in a second [1/s].
    patience
        How long the gripper may wait before the point until the error seen is small and
        the gripper at rest [s].
    tries
        Approaches that are tried, all but the last of which must come close to the point.
    """

    kp_free: tuple[float, ...] = (800.0, 1200.0, 1200.0, 200.0, 200.0, 160.0)
    kd_free: tuple[float, ...] = (40.0, 60.0, 60.0, 10.0, 10.0, 8.0)
    kp_hold: tuple[float, ...] = (800.0, 1200.0, 1200.0, 1000.0, 1400.0, 1200.0)
    kd_hold: tuple[float, ...] = (80.0, 120.0, 120.0, 50.0, 70.0, 60.0)
    period: float = 0.002
    feedforward: bool = True
    rebase: bool = True
    recovery: float = 1.0
    guided: bool = True
    sensor_period: float = 0.02
    guidance: float = 1.0
    patience: float = 6.0
    tries: int = 2

    called: ClassVar[str] = "controller"
    kinds: ClassVar[Mapping[str, Kind[Any]]] = {
        "kp_free": Tuples((6,), 0.0, 1e6, "N m/rad"),
        "kd_free": Tuples((6,), 0.0, 1e6, "N m s/rad"),
        "kp_hold": Tuples((6,), 0.0, 1e6, "N m/rad"),
        "kd_hold": Tuples((6,), 0.0, 1e6, "N m s/rad"),
        "period": Tuples((), 1e-5, 0.1, "s"),
        "feedforward": Flag(),
        "rebase": Flag(),
        "recovery": Tuples((), 1e-3, 1e6, "s"),
        "guided": Flag(),
        "sensor_period": Tuples((), 1e-4, 1.0, "s"),
        "guidance": Tuples((), 0.0, 100.0, "1/s"),
        "patience": Tuples((), 0.0, 60.0, "s"),
        "tries": Whole(1, 10),
    }


PAPER = Controller(
    *((100.0,) * 6, (50.0,) * 6) * 2, feedforward=False, rebase=False, guided=False, tries=1,
)  # fmt: skip
"""The paper's: proportional and derivative gains on a trajectory, the same for all joints."""

FEEDFORWARD = replace(PAPER, feedforward=True)
"""The paper's gains, with what the dynamics need fed forward."""

CONTROLLERS = {"full": Controller(), "feedforward": FEEDFORWARD, "paper": PAPER}
"""Controllers by name."""

Controller.named = CONTROLLERS
