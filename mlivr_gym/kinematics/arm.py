"""An arm as compiled code reads it; the operations on it stand in `families`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

TURN = 2.0 * np.pi
"""A whole turn [rad]."""

LIMIT_TOLERANCE = 1e-6
"""How far a joint may pass its limits [rad].

Postures are rounded, and a joint often lies exactly on a half turn.
"""


UR, SPHERICAL_WRIST, SPHERICAL_SHOULDER = 0, 1, 2
"""Families of arms: three parallel axes, see `ur`; a spherical wrist, see `spherical_wrist`; a
spherical shoulder, see `spherical_shoulder`."""


class Arm(Record):
    """The lengths of an arm and the windows of its joints."""

    family: int
    """`UR`, `SPHERICAL_WRIST` or `SPHERICAL_SHOULDER`."""
    d1: float
    """Length of the form of its family [m], as are the next ones; 0 if the form has none such."""
    a1: float
    d2: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float
    """Distance of the flange from the wrist point [m], in every family."""
    links: float
    """Product of the lengths of upper arm and forearm [m^2]: `|det J|` divided by the sines of
    elbow and wrist and by the distance `u` of the wrist from joint 1's axis."""
    b2: float
    """Distance of the elbow axis from the line along the upper arm [m]."""
    upper: float
    """Distance of the elbow axis from the shoulder [m], and the next one: for a spherical wrist."""
    forearm: float
    """Distance of the wrist point from the elbow axis [m]."""
    c_fold: float
    """Cosine of the angle between the upper arm and the line from the shoulder to the elbow."""
    s_fold: float
    """Its sine."""
    c_bend: float
    """Cosine of joint 3 where shoulder, elbow and wrist point lie in a line."""
    s_bend: float
    """Its sine."""
    c_twist: float
    """Cosine of the angle between axes 1 and 2."""
    s_twist: float
    """Its sine."""
    c_held: float
    """Cosine of the angle between axes 2 and 3."""
    s_held: float
    """Its sine."""
    window: Annotated[Array, (6, 2)]
    """Least and largest angle of each joint of a limb that holds or is folded, see `in_window`
    [rad]."""


class FlangeAxis(NamedTuple):
    """Where a flange is but for its turn about its axis, in the limb base frame."""

    p: Triple
    """Its position [m]."""
    z: Triple
    """Its axis."""


class JointAxes(Record):
    """Where the joints of a limb are, in its base frame."""

    axis: Annotated[Array, (6, 3)]
    """Unit vectors along them."""
    point: Annotated[Array, (6, 3)]
    """A point on each [m]."""


@kernel
def in_window(angle: float, low: float) -> float:
    """Return a joint angle plus the whole turns that move it into the joint's window [rad].

    A window is less than a turn, so one winding at most lies in it: a posture of a limb that holds
    determines its joint angles, whatever motion led there. Angles below the start of the window,
    `low`, by `LIMIT_TOLERANCE` belong to it.
    """
    least = low - LIMIT_TOLERANCE
    winding: float = angle - TURN * np.floor((angle - least) / TURN)
    return winding


def _cosine_and_sine(angle: float) -> tuple[float, float]:
    """Return cosine and sine of an angle [rad], 0 where a quarter turn leaves a rounding error."""
    pair = np.cos(angle), np.sin(angle)
    cosine, sine = (0.0 if abs(part) < 1e-15 else float(part) for part in pair)
    return cosine, sine


def set_arm(arm: Arm, lengths: Array, windows: Array, family: int = UR) -> None:
    """Fill `arm` with lengths of a family's form, see its `forward_kinematics` [m], and windows.

    Windows are the least and largest angle of each joint [rad], at most a turn apart, shape (6, 2).
    """
    arm["family"] = family
    if family == UR:
        arm["d1"], arm["a2"], arm["a3"], arm["d4"], arm["d5"], arm["d6"] = lengths
        arm["links"] = abs(arm["a2"] * arm["a3"])
        arm["c_held"], arm["s_held"] = 1.0, 0.0
    else:
        names = ("d1", "a1", "d2", "a2", "b2", "a3", "d4", "d6")
        for name, length in zip(names, lengths[:8], strict=True):
            arm[name] = length
        arm["c_twist"], arm["s_twist"] = _cosine_and_sine(lengths[8])
        arm["c_held"], arm["s_held"] = _cosine_and_sine(lengths[9])
        upper, forearm = np.hypot(arm["a2"], arm["b2"]), np.hypot(arm["a3"], arm["d4"])
        fold, bend = np.arctan2(arm["b2"], arm["a2"]), np.arctan2(arm["a3"], arm["d4"])
        arm["c_fold"], arm["s_fold"] = _cosine_and_sine(fold)
        arm["c_bend"], arm["s_bend"] = _cosine_and_sine(bend - fold)
        arm["upper"], arm["forearm"] = upper, forearm
        arm["links"] = upper * forearm * abs(arm["s_twist"])
    low, high = windows.T
    arm["window"][:, 0] = low
    arm["window"][:, 1] = np.minimum(high, low + TURN - 2.0 * LIMIT_TOLERANCE)
