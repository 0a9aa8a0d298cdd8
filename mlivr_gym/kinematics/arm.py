"""An arm as compiled code reads it; the operations on it stand in `families`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Joints, Record, Rows, Vector

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

TURN = 2.0 * np.pi
"""A whole turn [rad]."""

LIMIT_TOLERANCE = 1e-6
"""How far a joint may pass its limits [rad].

Postures are rounded, and a joint often lies exactly on a half turn.
"""


UR, SPHERICAL_WRIST, SPHERICAL_SHOULDER, NUMERIC = 0, 1, 2, 3
"""Families of arms: three parallel axes, see `ur`; a spherical wrist, see `spherical_wrist`; a
spherical shoulder, see `spherical_shoulder`; any other six joints, see `numeric`."""

SEEDS = 64
"""Number of stored postures of each branch of an arm of the family `NUMERIC`."""


class Seed(Record):
    """A posture from which a flange pose near by is solved; it lies at the azimuth 0 of axis 1."""

    radius: float
    """Distance of the wrist point from axis 1 [m]."""
    height: float
    """Height of the wrist point over the limb base [m]."""
    axis: Vector
    """Flange axis."""
    q: Joints
    """Joint angles [rad]; that of joint 6 is 0."""


class NumericArm(Record):
    """What is known of an arm of the family `NUMERIC`."""

    steps: Annotated[Array, (6, 4, 3)]
    """Origin [m] and axes x, y, z of each link's frame in that of the link before it, at joint
    angles of 0; the last one is that of the flange."""
    wrist: Vector
    """The wrist point in the frame of link 5 [m]."""
    unit: float
    """Length with which a turn of the flange axis is compared with a travel [m]."""
    elbow: float
    """Angle of joint 3 at which the arm is stretched [rad]."""
    bend: float
    """Angle of joint 5 at which axes 4 and 6 are nearest to each other's direction [rad]."""
    farthest: Annotated[Array, (5,)]
    """Bounds of how far turning each joint moves wrist point and flange axis, per radian [m]."""
    between: Annotated[Array, (5,)]
    """Distances [m] of the origin of link 2 from axis 1, of those of the links 2 to 5 from the next
    one, and of that of link 5 from the wrist point."""
    seeds: Annotated[Rows[Seed], (8, SEEDS)]
    """Postures of each branch."""
    seed_counts: Annotated[Array, (8,), np.int64]
    """Number of these."""


class Arm(Record):
    """The lengths of an arm and the windows of its joints."""

    family: int
    """`UR`, `SPHERICAL_WRIST`, `SPHERICAL_SHOULDER` or `NUMERIC`."""
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
    sign: Joints
    """1 or -1 for each joint, by which its axis leads along the z axis of its link's frame or
    against it: an angle of the form is `sign * angle of the arm + zero`."""
    zero: Joints
    """Angle of the form where that of the arm is 0, for each joint [rad]."""
    deviates: int
    """1 if the joints are where `numeric` has them and only nearly where the form has them, as
    those of a calibrated arm or of a file of rounded angles; else 0."""
    window: Annotated[Array, (6, 2)]
    """Least and largest angle of each joint of a limb that holds or is folded, see `in_window`
    [rad]."""
    numeric: NumericArm
    """Of the family `NUMERIC`, and, without seeds, of an arm that deviates from its form."""


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
def form_angle(arm: Arm, q: Array, joint: int) -> float:
    """Return the angle of the form of a joint, counted from 0, by the arm's angles [rad]."""
    angle: float = arm.sign[joint] * q[joint] + arm.zero[joint]
    return angle


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
