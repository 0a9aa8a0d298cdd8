"""An arm as a chain of six joints, and its forward kinematics, in NumPy and compiled.

Link 0 is the mount, at rest; joint k carries link k, and the frame of link 6 is the flange's. Each
joint turns about the z axis of the frame of its link. The first axis is the z axis of the mount,
and the last one that of the flange. A joint that is locked belongs to the step between two links.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Joints, Record, Rows, Vector
from mlivr_gym.kinematics.poses import along, cross, vector

if TYPE_CHECKING:
    from mlivr_gym.values import Triple

TURN = 2.0 * np.pi
"""A whole turn [rad]."""

LIMIT_TOLERANCE = 1e-6
"""How far a joint may pass its limits [rad].

Postures are rounded, and a joint often lies exactly on a half turn.
"""

SEEDS = 64
"""Number of stored postures of each branch of an arm that is solved numerically."""


class Seed(Record):
    """A posture from which a flange pose close by is solved; it lies at the azimuth 0 of axis 1."""

    radius: float
    """Distance of the wrist point from axis 1 [m]."""
    height: float
    """Height of the wrist point over the mount [m]."""
    axis: Vector
    """Flange axis."""
    q: Joints
    """How far joints are turned about the z axes [rad]; the last one is 0."""


class Form(Record):
    """What the inverse kinematics knows of a chain, see `inverse`."""

    kind: int
    """`THREE_PARALLEL`, `SPHERICAL_WRIST` or `NUMERIC`, see `forms`."""
    from_flange: int
    """1 if the closed form is that of the arm as seen from its flange, its joints in opposite
    order; else 0."""
    deviates: int
    """1 if the axes lie only nearly as the closed form has them, as those of a calibrated arm or of
    a file of rounded angles; else 0."""
    sign: Annotated[Array, (5,)]
    """For joints 1 to 5 of the form: 1, or -1 if it turns against its joint of the arm."""
    c_zero: Annotated[Array, (5,)]
    """Cosines of their angles where those of the arm are 0."""
    s_zero: Annotated[Array, (5,)]
    """Sines of these."""
    d1: float
    """Length of the closed form [m], as are the next ones; 0 if it has none such."""
    a1: float
    d2: float
    a2: float
    b2: float
    a3: float
    d4: float
    d5: float
    d6: float
    upper: float
    """Distance of the elbow axis from the shoulder [m]."""
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
    c_lean: float
    """Cosine of the angle between axes 2 and 3."""
    s_lean: float
    """Its sine."""
    wrist: Vector
    """The point of axis 6 closest to axis 5, in the frame of link 5 [m]."""
    past_wrist: float
    """Distance of the flange from this point along axis 6 [m]."""
    unit: float
    """Length with which a turn of the flange axis is compared with a travel [m]."""
    elbow: float
    """Turn of joint 3 at which an arm that is solved numerically is stretched [rad]."""
    bend: float
    """Turn of joint 5 at which its axes 4 and 6 are closest to one direction [rad]."""
    seeds: Annotated[Rows[Seed], (8, SEEDS)]
    """Postures of each branch of an arm that is solved numerically."""
    seed_counts: Annotated[Array, (8,), np.int64]
    """Number of these."""


class Chain(Record):
    """A chain of six joints with the windows of its joints."""

    steps: Annotated[Array, (6, 4, 3)]
    """Origin [m] and axes x, y, z of each link's frame in that of the link before it, where the
    joint angle is 0."""
    sense: Joints
    """1 or -1: a joint's angle counts about the z axis of its link or against it."""
    window: Annotated[Array, (6, 2)]
    """Least and largest angle of each joint of a limb that holds or is folded, see `in_window`
    [rad]."""
    form: Form
    """What solves its inverse kinematics."""


class FlangeAxis(NamedTuple):
    """Where a flange is but for its turn about its axis, in the mount."""

    p: Triple
    """Its position [m]."""
    z: Triple
    """Its axis."""


class Bend(NamedTuple):
    """Cosines and sines of how far joints 1 to 5 are turned about the z axes of their links."""

    c1: float
    s1: float
    c2: float
    s2: float
    c3: float
    s3: float
    c4: float
    s4: float
    c5: float
    s5: float


class Frame(NamedTuple):
    """A frame in the mount."""

    o: Triple
    """Its origin [m]."""
    x: Triple
    """Its axes, as are the next ones."""
    y: Triple
    z: Triple


class Links(NamedTuple):
    """Frames of the links 1 to 5."""

    f1: Frame
    f2: Frame
    f3: Frame
    f4: Frame
    f5: Frame


@kernel
def out_of_axes(frame: Frame, v: Triple) -> Triple:
    """Return a direction of a frame in the mount."""
    _, x, y, z = frame
    a, b, c = v
    return (
        x[0] * a + y[0] * b + z[0] * c,
        x[1] * a + y[1] * b + z[1] * c,
        x[2] * a + y[2] * b + z[2] * c,
    )


@kernel
def stepped(arm: Chain, joint: int, before: Frame) -> Frame:
    """Return the frame of a link at the angle 0, by the frame of the link before it."""
    step = arm.steps[joint]
    o = along(before.o, 1.0, out_of_axes(before, vector(step[0])))
    x, z = out_of_axes(before, vector(step[1])), out_of_axes(before, vector(step[3]))
    return Frame(o, x, cross(z, x), z)


@kernel
def turned_frame(frame: Frame, c: float, s: float) -> Frame:
    """Return a frame turned about its z axis, by cosine and sine."""
    o, x, y, z = frame
    return Frame(
        o,
        (c * x[0] + s * y[0], c * x[1] + s * y[1], c * x[2] + s * y[2]),
        (c * y[0] - s * x[0], c * y[1] - s * x[1], c * y[2] - s * x[2]),
        z,
    )


@kernel
def links_at(arm: Chain, bend: Bend) -> Links:
    """Return the frames of the links 1 to 5."""
    first = arm.steps[0]
    f1 = Frame(vector(first[0]), vector(first[1]), vector(first[2]), vector(first[3]))
    f1 = turned_frame(f1, bend.c1, bend.s1)
    f2 = turned_frame(stepped(arm, 1, f1), bend.c2, bend.s2)
    f3 = turned_frame(stepped(arm, 2, f2), bend.c3, bend.s3)
    f4 = turned_frame(stepped(arm, 3, f3), bend.c4, bend.s4)
    f5 = turned_frame(stepped(arm, 4, f4), bend.c5, bend.s5)
    return Links(f1, f2, f3, f4, f5)


@kernel
def set_frames(links: Links, flange: Frame, frames: Array) -> None:
    """Write the frames of mount, links and flange into an array, see `link_frames`."""
    mount = Frame((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    f1, f2, f3, f4, f5 = links
    for link, frame in enumerate((mount, f1, f2, f3, f4, f5, flange)):
        for k in range(3):
            frames[link, 0, k], frames[link, 1, k] = frame.o[k], frame.x[k]
            frames[link, 2, k], frames[link, 3, k] = frame.y[k], frame.z[k]


@kernel
def bend_of_turns(a: float, b: float, c: float, d: float, e: float) -> Bend:
    """Return cosines and sines of the turns of joints 1 to 5 [rad]."""
    c1, c2, c3, c4, c5 = math.cos(a), math.cos(b), math.cos(c), math.cos(d), math.cos(e)
    s1, s2, s3, s4, s5 = math.sin(a), math.sin(b), math.sin(c), math.sin(d), math.sin(e)
    return Bend(c1, s1, c2, s2, c3, s3, c4, s4, c5, s5)


@kernel
def link_frames(arm: Chain, q: Array, frames: Array) -> None:
    """Compute the frames of the links in the mount by joint angles [rad], shape (6,).

    `frames`, shape (7, 4, 3): of links 0 (the mount) to 6 (the flange) the origin [m] and axes x,
    y, z, z along the joint.
    """
    a, b, c = arm.sense[0] * q[0], arm.sense[1] * q[1], arm.sense[2] * q[2]
    d, e, f = arm.sense[3] * q[3], arm.sense[4] * q[4], arm.sense[5] * q[5]
    links = links_at(arm, bend_of_turns(a, b, c, d, e))
    flange = turned_frame(stepped(arm, 5, links.f5), math.cos(f), math.sin(f))
    set_frames(links, flange, frames)


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
