"""Records that the checks of releases and steps read and write."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.compiled.bit_sets import BRANCHES
from mlivr_gym.compiled.records import Record, Rows
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.postures.records import Limbs
from mlivr_gym.robot.sizes import MOST_LIMBS
from mlivr_gym.transitions.departures import Departure


class ReleaseRecord(Record):
    """Branches on which a limb can be released at a stance and between which it can then change."""

    known: bool
    """Whether it was computed."""
    branches: int
    """The branches and flips."""
    folds: int
    """Set of the folds between which the limb can change; empty if it cannot fold."""
    root: int
    """The fold through which it changes between them."""
    via: Annotated[IntArray, (BRANCHES,), np.int8]
    """For each branch, the fold that it reaches first."""


class StanceArrays(NamedTuple):
    """K stances of N limbs as compiled code reads them."""

    points: IntArray
    """Point that each limb holds, shape (K, N)."""
    base: Any
    """Bases in the world, rows of `Pose`, shape (K,)."""
    branch_sets: IntArray
    """Branches and flips on which each limb may hold, shape (K, N)."""
    releases: Any
    """Rows of `ReleaseRecord`, shape (K, N)."""


class WorldRecord(NamedTuple):
    """The points, the boxes and the obstacles that motions are checked against."""

    grasps: Any
    """Points of the map, rows of `Grasp` in the world, shape (m,)."""
    boxes: BoxGrid
    """Boxes of the map."""
    obstacles: BoxGrid
    """Obstacles, boxes in addition to those of the map."""
    thresholds: Any
    """Floor and clearance, a row of `Thresholds`, shape (1,)."""
    first: int
    """First layer: 0 for the map and the robot itself, 1 for obstacles alone."""
    stop: int
    """One past the last layer: 1 for the map alone, 2 with obstacles, 0 without collision
    checks."""


class StepContext(NamedTuple):
    """A robot at stances in a world."""

    stances: StanceArrays
    robots: Any
    """A row of `RobotModel`, shape (1,)."""
    world: WorldRecord


class StepRecord(Record):
    """A step to be checked, and what supports keep on it if the check passes."""

    limb: int
    """Limb that moves."""
    before: int
    """Stance before the step."""
    after: int
    """Stance after the step."""
    kept: Limbs
    """Before the check, branches of which each support limb may keep some; after it, those that it
    keeps on the edge, none if the step is no edge."""


class StepScratch(Record):
    """Scratch of the check of one step."""

    line: LineScratch
    back: bool
    """Whether the way of the base is checked from its end to its start."""
    apart: Annotated[IntArray, (MOST_LIMBS, BRANCHES, MOST_LIMBS), np.int64]
    """For each branch of a limb, set of the branches of another limb that may be clear of it."""
    clear: Limbs
    """Branches that are clear of all that does not depend on the swing."""
    clear_of_swing: Limbs
    """Those of these that are clear of the swing limb."""
    q: Annotated[Rows[Angles], (2, BRANCHES)]
    """Joint angles above both points on each branch."""
    lifted: Annotated[IntArray, (2,), np.int64]
    """Branches that exist there."""
    order: Annotated[IntArray, (BRANCHES * BRANCHES,), np.int64]
    """Pairs of branches, those with the shortest line first."""
    travel: Annotated[Array, (BRANCHES * BRANCHES,)]
    """Lengths of these lines [rad]."""
    departure: Departure
    """Departure under check."""
    start: Angles
    """Joint angles at the start of a swing."""
    end: Angles
    """Joint angles at its end."""
    group: Annotated[IntArray, (BRANCHES,), np.int64]
    """Group of branches, joined by lines, that each branch belongs to."""
