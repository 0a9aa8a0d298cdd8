"""A limb of seven joints like the arm of a space station, the SSRMS, with its first joint held."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import Capsule
from mlivr_gym.robot.limb import FARTHEST_TURN, Angle, Length, Limb, SixAngles
from mlivr_gym.schema import Choice, FieldPath, Integer, Struct, Tuples

SSRMS = "ssrms"
"""Name of the family in robot files. Its closed form is that of the UR arms."""

HELD_JOINT = 1
"""The joint that is held, the roll of the shoulder; joints 2 to 7 are an arm of the UR form."""

FARTHEST_SSRMS = 1.5 * np.pi
"""Limit of each published joint in either direction, 270 degrees [rad]."""

JOINT_LIMITS = (
    *((-FARTHEST_SSRMS, FARTHEST_SSRMS),) * 5,
    (-2.0 * np.pi, np.pi),
    (-FARTHEST_SSRMS, FARTHEST_SSRMS),
)
"""Limits of the SSRMS's joints [rad]; the zero of joint 6 is a quarter turn from the published one.
"""

WINDOW_STARTS = (-np.pi, 1.75 - np.pi, -np.pi, 1.75 - np.pi, -np.pi, -0.75 * np.pi)
"""Where the windows of the joints that move begin [rad], see `LimbBase.windows`.

The booms point along +x of their frames, those of a UR arm along -x: joints 2 and 4 of the form
differ by half a turn from those of a UR arm.
"""

FOLDS = (
    (-0.6, 0.0, 2.4, np.pi, -0.75),
    (0.3, 0.0, 0.0, np.pi - 1.6, 0.75),
    (2.19, np.pi - 0.15, 1.83, 0.7 - np.pi, -0.38),
)
"""Those of a UR limb, at the angles of this form [rad]."""

PITCH, ELBOW = 0.5692, 0.475
"""Offset of the first boom from the shoulder, and of the second from the first [m].

The second boom has the first one's distance from the wrist; `d4` is the sum of the three.
"""

BOOM_RADIUS = 0.18
"""Radius of the collision shapes of the default arm [m]; the SSRMS is 0.35 m thick."""


@dataclass(frozen=True)
class SsrmsLimb(Limb):
    """A seven-joint arm of the SSRMS's kind, whose joint 1, the roll of the shoulder, is held.

    Joints 1 and 2 cross at a right angle, 2 and 3, 5 and 6, 6 and 7 are perpendicular, 3, 4 and 5
    parallel, with the offsets of the booms in `d4`. The European Robotic Arm and the arms of the
    Chinese station are alike. Joints 2 to 7 have the UR form in standard DH convention, whose
    lengths d1 to d6 [m] are those of a `Limb`; the defaults are those of Nguyen and Hughes (1994).

    The z axis of the limb's mount is that of joint 1. A joint that is held does not move while the
    limb holds or swings. Manipulability is that of the six joints that move, a lower bound of that
    of all seven: `det(J J^T)` is the sum of the squares of the determinants of all choices of six
    columns (Cauchy-Binet).
    """

    d1: Length = 0.7026
    a2: Length = 7.11
    a3: Length = 7.11
    d4: Length = 2.0 * PITCH + ELBOW
    d5: Length = 0.7026
    d6: Length = 1.3589
    joint_limits: Annotated[
        tuple[tuple[float, float], ...], Tuples((7, 2), -FARTHEST_TURN, FARTHEST_TURN, "rad")
    ] = JOINT_LIMITS
    """Lower and upper limit of each of the seven joints [rad], the held one among them."""
    window_starts: SixAngles = WINDOW_STARTS
    """Where the turn begins in which each of the six joints that move stays while the limb holds
    [rad], see `windows`."""
    family: Annotated[str, Choice((SSRMS,))] = SSRMS
    """`"ssrms"`."""
    d0: Length = 1.3589
    """From the mount along the axis of joint 1 to that of joint 2 [m]."""
    held_joint: Annotated[int | None, Integer(HELD_JOINT, HELD_JOINT)] = HELD_JOINT
    """1."""
    held_angle: Angle = 0.0
    """Angle at which it is held [rad]; at 0 the axis of joint 2 is the x axis of the mount."""
    default_folds = FOLDS

    def __post_init__(self) -> None:
        """Check lengths, limits and the held joint."""
        place = FieldPath("limb", RobotError)
        SSRMS_LIMB.check(self, place)
        self.check_lengths(place)
        self.check_joints(place)

    @property
    def base_in_mount(self) -> tuple[Array, Array]:
        """Axes (3, 3) and origin [m] of the base of joints 2 to 7 in the limb's mount.

        Its z axis is that of joint 2, its x axis that of joint 1.
        """
        held = self.held_angle
        c, s = (np.cos(held), np.sin(held)) if held else (1.0, 0.0)
        axes = np.array([[0.0, s, c], [0.0, -c, s], [1.0, 0.0, 0.0]])
        return axes, np.array([0.0, 0.0, self.d0])

    @property
    def link_capsules(self) -> tuple[Capsule, ...]:
        """Simple collision shapes along the links, without a gripper."""
        d4, d5, d6 = self.d4, self.d5, self.d6
        first, second = (
            PITCH / (2.0 * PITCH + ELBOW) * d4,
            (1.0 - PITCH / (2.0 * PITCH + ELBOW)) * d4,
        )
        radius, here = BOOM_RADIUS, (0.0, 0.0, 0.0)
        return (
            Capsule("base", (-self.d0, 0.0, 0.0), here, radius),
            Capsule("base", here, (0.0, 0.0, 0.5 * self.d1), radius),
            Capsule("shoulder", here, (0.0, -first, 0.0), radius),
            Capsule("upper_arm", (0.0, 0.0, first), (self.a2, 0.0, first), radius),
            Capsule("forearm", (0.0, 0.0, second), (self.a3, 0.0, second), radius),
            Capsule("wrist_1", (0.0, 0.0, second - d4), here, radius),
            Capsule("wrist_2", (0.0, 0.0, -0.5 * d5), here, radius),
            Capsule("wrist_3", (0.0, 0.0, -d6), (0.0, 0.0, -radius), radius),
        )


SSRMS_LIMB = Struct.of(SsrmsLimb)
"""Fields of an `SsrmsLimb`."""
