"""What the checks of releases and steps read and write."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.motion import Sweep
from mlivr_gym.compiled.bit_sets import BRANCHES
from mlivr_gym.compiled.records import Record, Rows, Vector
from mlivr_gym.kinematics.arm import JointAxes
from mlivr_gym.kinematics.base_path import BasePath
from mlivr_gym.kinematics.holding import Holding
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.postures.records import Limbs
from mlivr_gym.robot.specification import MOST_LIMBS


class ReleaseRecord(Record):
    """On which branches a limb can be released at a stance and change from one to the other."""

    known: bool
    """Whether it was worked out."""
    branches: int
    """The branches and flips."""
    folds: int
    """Folds among which the limb can change, as a set; none if it cannot fold."""
    root: int
    """The fold through which it does."""
    via: Annotated[IntArray, (BRANCHES,), np.int8]
    """For each branch the fold that is reached first."""


class StanceSet(NamedTuple):
    """K stances of N limbs in the form that compiled code reads."""

    points: IntArray
    """Point that each limb holds, shape (K, N)."""
    base: Any
    """Bases in the world, rows of `Pose`, shape (K,)."""
    mask: IntArray
    """Branches and flips each limb may hold on, shape (K, N)."""
    released: Any
    """Rows of `ReleaseRecord`, shape (K, N)."""


class WorldRecord(NamedTuple):
    """What motions are checked against."""

    grasps: Any
    """Points of the map, rows of `Grasp` in the world, shape (m,)."""
    boxes: BoxGrid
    """Boxes of the map."""
    obstacles: BoxGrid
    """Boxes beside those."""
    thresholds: Any
    """Floor and clearance, a row of `Thresholds`, shape (1,)."""
    first: int
    """0 to begin with the map and the robot itself, 1 to check obstacles alone."""
    stop: int
    """1 to end with the map, 2 to check obstacles too, 0 to check no collisions."""


class StepContext(NamedTuple):
    """A robot at stances in a world."""

    stances: StanceSet
    robots: Any
    """A row of `Robot`, shape (1,)."""
    world: WorldRecord


class StepRecord(Record):
    """A step that is to be checked, and the edge that it is if it passes."""

    limb: int
    """Limb that moves."""
    before: int
    """Stance before the step."""
    after: int
    """Stance after it."""
    pivot: Vector
    """Centre of a base path that is an arc [m]."""
    wanted: Limbs
    """Branches that each limb that holds may be on."""
    given: bool
    """Whether these are the branches that the limbs are on, of which none is preferred."""
    again: bool
    """Whether the edge is known in a world without obstacles; only that is then checked."""
    kept: Limbs
    """Branches on which each limb that holds can follow the edge; none if it is no edge."""
    on_arc: int
    """Those of the one limb that holds, if there is one, that need the arc."""
    kind: int
    """Kind of the base path; for one limb that holds see `on_arc`."""
    folds: Annotated[IntArray, (2,), np.int64]
    """Fold in which the limb can be moved on the line and on the arc, -1 for none."""
    pair: int
    """Branches between which it can swing along a line, `8 * before + after`, or -1."""


class StepScratch(Record):
    """Room for the check of one step."""

    sweep: Sweep
    holding: Holding
    path: BasePath
    """The base path that is looked at."""
    holds: Annotated[IntArray, (2, MOST_LIMBS), np.int64]
    """Branches on which each limb can hold on both kinds of path."""
    holds_known: Annotated[IntArray, (2,), np.int64]
    """Whether these were worked out."""
    now: Limbs
    """Branches that are looked at."""
    standing: Limbs
    """Those of them that do not touch what does not depend on the swing."""
    now_on_line: Limbs
    """Those of these that do not touch the limb that swings."""
    q: Annotated[Rows[Angles], (2, BRANCHES)]
    """Joint angles above both points on each branch."""
    lifted: Annotated[IntArray, (2,), np.int64]
    """Branches that exist there."""
    order: Annotated[IntArray, (BRANCHES * BRANCHES,), np.int64]
    """Pairs of branches, those with the shortest line first."""
    travel: Annotated[Array, (BRANCHES * BRANCHES,)]
    """The lengths of these lines [rad]."""
    start: Angles
    """Joint angles at the start of a swing."""
    end: Angles
    """Joint angles at its end."""
    axes: JointAxes
    group: Annotated[IntArray, (BRANCHES,), np.int64]
    """Which branches are joined by lines."""
