"""The kinematics of a limb: lengths, joint limits, and the windows of its joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.schema import FieldPath, Struct, Tuples
from mlivr_gym.values import LONGEST_ROBOT, SMALLEST

FARTHEST_TURN = 100.0
"""Largest joint limit or angle [rad], 16 turns; a UR joint has one in each direction."""

JOINT_LIMITS = (
    *((-2.0 * np.pi, 2.0 * np.pi),) * 2, (-np.pi, np.pi), *((-2.0 * np.pi, 2.0 * np.pi),) * 3,
)  # fmt: skip
"""Limits of the UR5e's joints [rad]; the manufacturer's description keeps the elbow to half a turn.
"""

WINDOW_STARTS = (
    -1.65, 1.75 - 2.0 * np.pi, -np.pi, 1.75 - 2.0 * np.pi, -np.pi, -0.75 * np.pi,
)  # fmt: skip
"""Where the windows of a UR limb begin [rad], see `Limb.windows`.

Joints 3 and 5 never pass half a turn while a limb holds, since the arm is singular there. Joints 1,
2 and 4 of limbs that hold points of the JEM pass 1.65 rad on 0.05 % of the steps only. Joint 6 may
be half a turn further, the flip: one of the two passes the ends of its window only where the tool
turns by half a turn and more.
"""


@dataclass(frozen=True)
class Limb:
    """A six-joint arm of the UR family, standard DH convention `Rz(theta) Tz(d) Tx(a) Rx(alpha)`.

    The default lengths [m] are the UR5e's, published by the manufacturer.
    """

    d1: float = 0.1625
    a2: float = -0.425
    a3: float = -0.3922
    d4: float = 0.1333
    d5: float = 0.0997
    d6: float = 0.0996
    joint_limits: tuple[tuple[float, float], ...] = JOINT_LIMITS
    """Lower and upper limit of each joint [rad]."""
    window_starts: tuple[float, ...] = WINDOW_STARTS
    """Where the turn begins in which each joint stays while the limb holds [rad], see `windows`."""

    def __post_init__(self) -> None:
        """Check lengths and limits."""
        place = FieldPath("limb", RobotError)
        LIMB.check(self, place)
        for name in ("a2", "a3", "d4"):
            if abs(getattr(self, name)) < SMALLEST:
                raise place.field(name).fault(f"is {getattr(self, name):g}; it must not be 0")
        for joint, (low, high) in enumerate(self.joint_limits):
            if not low < high:
                limits = place.field("joint_limits").entry(joint)
                raise limits.fault(f"is {[low, high]}; the lower limit must come first")

    @property
    def lengths(self) -> Array:
        """The six lengths d1, a2, a3, d4, d5, d6 [m], shape (6,)."""
        return np.array([self.d1, self.a2, self.a3, self.d4, self.d5, self.d6], dtype=np.float64)

    @property
    def limits(self) -> Array:
        """Joint limits [rad], shape (6, 2)."""
        return np.array(self.joint_limits)

    @property
    def windows(self) -> Array:
        """Least and largest angle of each joint of a limb that holds [rad], shape (6, 2).

        A window is one turn from `window_starts` on, moved into the joint limits as far as needed,
        and no more than they allow. Within it a posture has one winding: a limb never needs to turn
        back, so every walk of steps that are legal one by one can be carried out. A step on which a
        joint of a limb that holds would leave its window is no edge for the branch concerned.
        """
        low, high = self.limits.T
        start = np.clip(self.window_starts, low, np.maximum(low, high - 2.0 * np.pi))
        return np.stack([start, np.minimum(start + 2.0 * np.pi, high)], axis=1)

    def folds_in_windows(self, folds: Sequence[Sequence[float]]) -> Array:
        """Those of some folds, joints 1 to 5 [rad], that lie in the windows, shape (k, 5)."""
        low, high = self.windows[:5].T
        angles = np.array(folds, dtype=np.float64).reshape(-1, 5)
        angles = low + np.mod(angles - low, 2.0 * np.pi)
        inside: Array = angles[(angles <= high).all(axis=1)]
        return inside

    @property
    def reach(self) -> float:
        """An upper bound of the flange's distance from the mount [m]."""
        return float(np.abs(self.lengths).sum())


LENGTH = Tuples((), most=LONGEST_ROBOT, unit="m")
"""A length of a robot that may be negative, as in the DH convention."""

LIMB = Struct(
    Limb,
    {
        **dict.fromkeys(("d1", "a2", "a3", "d4", "d5", "d6"), LENGTH),
        "joint_limits": Tuples((6, 2), -FARTHEST_TURN, FARTHEST_TURN, "rad"),
        "window_starts": Tuples((6,), -FARTHEST_TURN, FARTHEST_TURN, "rad"),
    },
)
"""Fields of a `Limb`."""
