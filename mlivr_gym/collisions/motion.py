"""The description of a motion of the base and of one or two limbs, and the scratch to check it."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.against_boxes import GraspSurface
from mlivr_gym.collisions.placement import IntervalAngles, Placed, Shapes
from mlivr_gym.compiled.bit_sets import BRANCHES
from mlivr_gym.compiled.records import Joints, Record, Rows
from mlivr_gym.kinematics.base_path import BasePath
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.robot.specification import MOST_LIMBS

MOST_HALVINGS = 9
"""An undecided interval of about `2^-MOST_HALVINGS` of a motion counts as blocked."""

SWINGS, HOLDS, DEPARTS = 0, 1, 2
"""Kinds of motion of a limb."""

MOST_RESTING = BRANCHES * (MOST_LIMBS - 1)
"""Maximum number of configurations of limbs at rest."""


class LimbMotion(Record):
    """The motion of one limb."""

    limb: int
    """Index of the limb."""
    kind: int
    """`SWINGS`, `HOLDS` or `DEPARTS`."""
    branch: int
    """Inverse-kinematics branch on which it holds or departs."""
    flange: Pose
    """Flange pose in the world while it holds, or before it departs."""
    start: Joints
    """Joint angles at the start of a swing [rad]."""
    corner: Joints
    """Joint angles at the corner that a swing rounds [rad]; unused on a line."""
    end: Joints
    """Joint angles at the end of a swing [rad]."""


class SweptMotion(Record):
    """A motion of the base and one or two limbs, and what the first limb is compared with."""

    path: BasePath
    """Path of the base."""
    begin: float
    """Base path parameter at the start."""
    corner: float
    """Base path parameter at the corner that the motion rounds; unused on a line."""
    finish: float
    """Base path parameter at the end."""
    rounded: bool
    """Whether the base parameter and the swings round a corner; otherwise they change linearly."""
    first: LimbMotion
    """Motion of the limb that is checked."""
    second: LimbMotion
    """Motion of another limb at the same time."""
    boxes: bool
    """Whether the first limb is compared with boxes, and with it a base that moves in a swing."""
    body: bool
    """Whether the first limb is compared with itself and the body."""
    resting: bool
    """Whether the first limb is compared with the limbs at rest."""
    meeting: bool
    """Whether the first limb is compared with the second limb."""


class Interval(Record):
    """An interval of a motion that is still to be checked, with the comparisons that remain."""

    middle: float
    """Midpoint, as a fraction of the motion."""
    half: float
    """Half its length."""
    boxes: int
    """Set of capsules to compare with boxes; the base counts as one additional capsule."""
    itself: int
    """Set of pairs of the limb's capsules to compare."""
    body: int
    """Set of capsules to compare with the body."""
    limbs: int
    """Set of limbs at rest, or of capsules to compare with the second limb."""
    first: IntervalAngles
    """Joint angles of the first limb at both ends."""
    second: IntervalAngles
    """Joint angles of the second limb at both ends."""


class RestingLimbs(Record):
    """Configurations of limbs at rest."""

    count: int
    """Number of configurations."""
    limb: Annotated[IntArray, (MOST_RESTING,), np.int64]
    """Limb of each configuration."""
    shapes: Annotated[Rows[Shapes], (MOST_RESTING,)]
    """Capsules of each configuration in the body frame."""


class SweepScratch(Record):
    """Scratch for the check of one motion, with the limbs at rest."""

    motion: SweptMotion
    """The motion."""
    first: Placed
    """The first limb at the midpoint of an interval."""
    second: Placed
    """The second limb there."""
    base: Pose
    """Base pose there."""
    lifted: Pose
    """Flange pose of a limb that departs."""
    intervals: Annotated[Rows[Interval], (MOST_HALVINGS + 3,)]
    """Stack of intervals."""
    first_at_end: Joints
    """Joint angles of the first limb at the end of the latest initial interval [rad]."""
    second_at_end: Joints
    """Joint angles of the second limb there [rad]."""
    surface: GraspSurface
    """The grasp at which the first limb's gripper is, if any."""
    resting: RestingLimbs
    """The limbs at rest."""
