"""What a motion is: of the base and of one or two limbs, and the room to check it."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.against_boxes import Behind
from mlivr_gym.collisions.placement import IntervalAngles, Placed, Shapes
from mlivr_gym.compiled.bit_sets import BRANCHES
from mlivr_gym.compiled.records import Joints, Record, Rows
from mlivr_gym.kinematics.base_path import BasePath
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.robot.specification import MOST_LIMBS

MOST_HALVINGS = 9
"""Halvings after which an interval counts as blocked."""

SWINGS, HOLDS, DEPARTS = 0, 1, 2
"""What a limb does on a motion."""

MOST_RESTING = BRANCHES * (MOST_LIMBS - 1)
"""Most places of limbs at rest."""


class LimbMotion(Record):
    """What one limb does on a motion."""

    limb: int
    """Which limb."""
    kind: int
    """`SWINGS`, `HOLDS` or `DEPARTS`."""
    branch: int
    """Branch on which it holds or departs."""
    flange: Pose
    """Its flange in the world while it holds, or before it departs."""
    start: Joints
    """Joint angles at the start of a swing [rad]."""
    corner: Joints
    """Those at the corner that a swing rounds [rad]; of a line they do not count."""
    end: Joints
    """Joint angles at its end [rad]."""


class SweptMotion(Record):
    """A motion of the base and of one or two limbs, and what the first of them is compared with."""

    path: BasePath
    """Path of the base."""
    begin: float
    """Where the base is on it at the start."""
    corner: float
    """Where it is at the corner that the motion rounds; on a line that does not count."""
    finish: float
    """Where it is at the end."""
    rounded: bool
    """Whether base and swings round a corner; else they go in a line."""
    first: LimbMotion
    """What the limb does that is checked."""
    second: LimbMotion
    """What another limb does meanwhile."""
    boxes: bool
    """Whether the first limb is compared with boxes, and the base if it moves while that swings."""
    body: bool
    """Whether it is compared with itself and the body."""
    resting: bool
    """Whether it is compared with limbs at rest."""
    meeting: bool
    """Whether it is compared with the second limb."""


class Interval(Record):
    """An interval of a motion that waits."""

    middle: float
    """Its middle, as a share of the motion."""
    half: float
    """Half its length."""
    boxes: int
    """Capsules to compare with boxes; the base counts as one capsule more."""
    itself: int
    """Pairs of the limb's capsules to compare."""
    body: int
    """Capsules to compare with the body."""
    limbs: int
    """Limbs at rest, or capsules to compare with the second limb."""
    first: IntervalAngles
    """The first limb at both ends."""
    second: IntervalAngles
    """The second limb at both ends."""


class RestingLimbs(Record):
    """Places of limbs at rest."""

    count: int
    """Their number."""
    limb: Annotated[IntArray, (MOST_RESTING,), np.int64]
    """Which limb each is of."""
    shapes: Annotated[Rows[Shapes], (MOST_RESTING,)]
    """The capsules of each in the body frame."""


class Sweep(Record):
    """Room for the check of one motion, and limbs at rest."""

    motion: SweptMotion
    first: Placed
    second: Placed
    base: Pose
    lifted: Pose
    intervals: Annotated[Rows[Interval], (MOST_HALVINGS + 3,)]
    first_at_end: Joints
    """Joint angles of the first limb at the end of the last piece [rad]."""
    second_at_end: Joints
    """Joint angles of the second limb there [rad]."""
    behind: Behind
    resting: RestingLimbs
