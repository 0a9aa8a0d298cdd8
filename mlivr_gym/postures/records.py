"""What the selection of a posture reads and writes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.against_boxes import Behind
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.limb_shapes import RobotModel
from mlivr_gym.collisions.placement import Placed, Shapes
from mlivr_gym.compiled.bit_sets import BRANCHES, CLASSES
from mlivr_gym.compiled.records import Matrix, Record, Rows, Vector
from mlivr_gym.kinematics.base_path import BasePath
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.holding import Holding
from mlivr_gym.kinematics.manipulability import Inversion
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.robot.specification import MOST_LIMBS, MOST_POSES

Limbs = Annotated[IntArray, (MOST_LIMBS,), np.int64]
"""A whole number for each limb."""


class Thresholds(Record):
    """What a posture and a step must meet."""

    w_m: float
    """Least limb manipulability of a stance."""
    w_b: float
    """Least base manipulability of a stance."""
    floor: float
    """Least limb manipulability on the way."""
    clearance: float
    """Least distance of shapes [m]."""


class PostureRule(Record):
    """Which postures are tried, and which of them is taken; see `solver`."""

    thresholds: Thresholds
    """What a node must meet."""
    scale_m: float
    """Limb manipulability that counts as margin 1."""
    scale_b: float
    """Base manipulability that counts as margin 1."""
    node_margin: float
    """A margin below that of every node."""
    nodes_only: bool
    """Whether of stances that are no nodes nothing need be told: most are then soon rejected."""
    best_touches: bool
    """Whether the best posture of all is known to touch something."""
    check_branches: bool
    """Whether branches are checked; if not, every node has all of them."""
    check_contacts: bool
    """Whether postures must touch nothing."""
    height_count: int
    """Number of heights tried."""
    heights: Annotated[Array, (MOST_POSES,)]
    """Heights tried [m]."""
    roll_count: int
    """Number of rolls tried."""
    rolls: Annotated[Array, (MOST_POSES,)]
    """Rolls tried [rad]."""
    opposed_height_count: int
    """Number of heights tried between opposite walls."""
    opposed_heights: Annotated[Array, (MOST_POSES,)]
    """These heights [m]."""
    opposed_roll_count: int
    """Number of rolls tried there."""
    opposed_rolls: Annotated[Array, (MOST_POSES,)]
    """These rolls [rad]."""


def set_candidates(rule: PostureRule, heights_and_rolls: Sequence[Array]) -> None:
    """Put what is tried into a rule: heights and rolls, and those between opposite walls."""
    names = ("height", "roll", "opposed_height", "opposed_roll")
    for name, values in zip(names, heights_and_rolls, strict=True):
        rule[f"{name}_count"] = len(values)
        rule[f"{name}s"][: len(values)] = values


class HeldStance(Record):
    """The grasps of a stance, in a frame about their centroid, and what base poses count from."""

    centre: Vector
    """Centroid of the grasps in the world of the boxes [m]."""
    grasps: Annotated[Rows[Grasp], (MOST_LIMBS,)]
    """The grasp of each limb."""
    frame: Matrix
    """Unrolled body axes, in columns."""
    out: Vector
    """Outward direction."""
    line: Vector
    """Roll axis."""
    opposed: bool
    """Whether the walls are opposed."""


class LimbReach(Record):
    """How a limb reaches its grasp from a base pose."""

    p: Vector
    """Flange position in the limb base frame [m]."""
    z: Vector
    """Flange axis there."""
    w: Annotated[Array, (CLASSES,)]
    """`w_m` of each class of branches; 0 out of reach."""


class CandidatePose(Record):
    """A base pose that is tried for a stance."""

    base: Pose
    """The base, in the frame of the stance's grasps."""
    limbs: Annotated[Rows[LimbReach], (MOST_LIMBS,)]
    """How each limb reaches its grasp."""
    margin_bound: float
    """Upper bound of the margin: the least over the limbs of the best class."""
    open_bound: float
    """The same as long as it is to be looked at, then 0."""


class PostureSearch(NamedTuple):
    """What a search for a posture of one stance reads."""

    robot: RobotModel
    held: HeldStance
    rule: PostureRule
    grid: BoxGrid
    """The boxes."""
    clearance: float
    """Least distance [m]; 0 where only what penetrates counts."""
    candidate_count: int
    """Number of base poses tried."""


class Posture(Record):
    """The posture of a stance."""

    base: Pose
    """The base, in the frame of the stance's grasps."""
    pose_number: int
    """Which of the base poses tried it is; -1 for none."""
    w_m: Annotated[Array, (MOST_LIMBS,)]
    """Limb manipulability; 0 where the stance cannot be held."""
    w_b: float
    """Base manipulability."""
    branch: Limbs
    """Branch of each limb that gives the margin."""
    mask: Limbs
    """Branches and flips that each limb may hold on."""
    cause: int
    """What the best posture touches where that alone keeps a node away."""


class PostureScratch(Record):
    """Room for the selection of one posture."""

    candidates: Annotated[Rows[CandidatePose], (MOST_POSES * MOST_POSES,)]
    """Base poses that are tried."""
    information: Annotated[Array, (MOST_LIMBS, BRANCHES, 6, 6)]
    """`K^-1` of each branch of each limb."""
    work: Annotated[Array, (2, 6, 6)]
    sums: Annotated[Array, (MOST_LIMBS, 6, 6)]
    """Sum of `K^-1` of each limb and those after it, on the branches `trial`."""
    roots: Annotated[Array, (MOST_LIMBS,)]
    """Lower bounds of the sixth roots of the determinants that the limbs before each add."""
    combination: Limbs
    """Branch of each limb that is looked at."""
    option_count: Limbs
    """Number of branches of each limb that are combined."""
    options: Annotated[IntArray, (MOST_LIMBS, BRANCHES), np.int64]
    """These branches."""
    option_index: Limbs
    """Which of them is looked at."""
    status: Annotated[IntArray, (MOST_LIMBS, BRANCHES), np.int64]
    """What a limb touches on a branch, other limbs apart, -1 where unknown."""
    pairs: Annotated[IntArray, (MOST_LIMBS, BRANCHES, MOST_LIMBS, BRANCHES), np.int64]
    """What two limbs on their branches do to each other, -1 where unknown."""
    gaps: Annotated[Array, (MOST_LIMBS, BRANCHES, MOST_LIMBS, BRANCHES)]
    """Least distance of two limbs on their branches, and of a limb to itself and the body [m]; of
    one that is too small any number below it, infinite where unknown."""
    in_body: Annotated[Rows[Shapes], (MOST_LIMBS, BRANCHES)]
    """Each limb on each branch in the body frame, where its status is known."""
    in_world: Shapes
    placed: Placed
    """A limb that does not move."""
    inversion: Inversion
    behind: Behind
    base: Pose
    """The base that is looked at, in the world of the boxes."""
    lifted: Pose
    path: BasePath
    holding: Holding
    allowed: Annotated[IntArray, (MOST_LIMBS, BRANCHES), np.int64]
    kept: Annotated[IntArray, (MOST_LIMBS, BRANCHES), np.int64]
