"""The joint controller: sampled PD control with feedforward, and guidance of the approach.

In every period the controller reads the encoders and commands each joint the torque

    tau = kp (q_ref - q) + kd (qdot_ref - qdot) + tau_ff,

saturated at the torque limit and held until the next period. `tau_ff` is the inverse dynamics of
the trajectory, see `joint_controller`. `q_ref` is the trajectory plus an offset. At the beginning
of a step `align_references` sets the offset such that the references equal the encoder readings;
limbs that hold the same robot then do not work against each other. During departure and swing the
offset decays, so that errors do not accumulate over steps: that of the free limb, and the part of
the others that a motion of the base takes back, see `compatible_motions`. The rest of it would load
grasps against each other. During a guided approach the offset of the swing limb follows what a
sensor on the gripper measures of the point.

A reading that is late by `delay` makes a velocity gain unstable in a direction in which the inertia
is small. What multiplies kp (q_ref - q) + kd (qdot_ref - qdot) is then, in place of the identity,
the matrix

    (I + T kd A)^-1,    T = delay / `DELAY_SHARE`,

where A is the inverse inertia at the joints, see `inverse_inertia`, with T times its damping as the
inertia that a grasp adds to its gripper (an implicit step of length T). In each direction velocity
gain times delay is at most `DELAY_SHARE` of the inertia, and where that is large the gain is kd.

A support limb carries the whole robot, about 30 kg m^2 about its joints, and is damped by its
grasp. A free limb ends in a wrist of little more than its rotor inertia, 0.1 kg m^2. A sampled
derivative gain must stay below inertia over period, which is 50 N m s/rad for that wrist at 500 Hz.
Support limbs and free limbs therefore have different gains.

On a single support limb the robot oscillates slowly. Guiding the free limb pushes the base in the
opposite direction and excites this motion; shoulder and elbow of the support limb damp it. The
gripper waits until it is at rest relative to the points held, since a grasp that captures a moving
gripper loads it at once through its damper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

from mlivr_gym.schema import Flag, Tuples
from mlivr_gym.simulation.parameter_set import ParameterSet

PositionGains = Annotated[tuple[float, ...], Tuples((6,), 0.0, 1e6, "N m/rad")]
VelocityGains = Annotated[tuple[float, ...], Tuples((6,), 0.0, 1e6, "N m s/rad")]
"""Gains of the six joints of a limb."""


@dataclass(frozen=True)
class ControllerParameters(ParameterSet):
    """Gains and functions of the joint controller.

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

FEEDFORWARD = replace(PAPER, feedforward=True)
"""The gains of the paper with feedforward."""

DELAYED = ControllerParameters(*((2000.0,) * 6, (100.0,) * 6) * 2, delay=0.01)
"""Gains for a delay of 10 ms. The velocity gain stays below the rotational damping of a grasp that
is three times as soft as assumed."""

STATION = ControllerParameters(
    kp_free=(2e5, 2e5, 1e5, 1e4, 5e3, 300.0), kd_free=(1e5, 1e5, 5e4, 5e3, 2e3, 100.0),
    kp_hold=(2e5,) * 6, kd_hold=(1e5,) * 6, recovery=20.0, guidance=0.1,
)  # fmt: skip
"""Gains for arms of the size of a space station's.

The robot turns about a supporting limb with some 5e5 kg m^2, its body and the parts of the arms
beside it with 1e3 kg m^2 about the joints between them, which limits a sampled derivative gain at
500 Hz to 5e5 N m s/rad; the last link of a free limb has 9 kg m^2 about its axis.
"""

CONTROLLERS = {
    "full": ControllerParameters(), "feedforward": FEEDFORWARD, "paper": PAPER,
    "delayed": DELAYED, "station": STATION,
}  # fmt: skip
"""Controllers by name.

* `"full"`, the default: feedforward, references aligned at each step, and a guided approach.
* `"feedforward"`: the PD control of the paper with feedforward.
* `"paper"`: the PD control of the paper.
* `"delayed"`: as `"full"`, with gains for a delay of 10 ms.
* `"station"`: as `"full"`, with gains for arms of the size of a space station's.
"""

ControllerParameters.presets = CONTROLLERS
