"""Records that the choice of a posture reads and writes, and its scratch."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.collisions.against_boxes import GraspSurface
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.placement import Shapes
from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.compiled.bit_sets import BRANCHES, CLASSES
from mlivr_gym.compiled.records import Matrix, Record, Rows, Vector
from mlivr_gym.kinematics.grasps import Grasp
from mlivr_gym.kinematics.manipulability import Inversion
from mlivr_gym.kinematics.poses import Pose
from mlivr_gym.robot.sizes import MOST_LIMBS
from mlivr_gym.robot.validators import MOST_POSES

Limbs = Annotated[IntArray, (MOST_LIMBS,), np.int64]
"""An integer for each limb."""


class Thresholds(Record):
    """Thresholds that postures and steps must meet."""

    w_m: float
    """Minimum limb manipulability of a stance."""
    w_b: float
    """Minimum base manipulability of a stance."""
    floor: float
    """Minimum limb manipulability along a motion."""
    clearance: float
    """Clearance that shapes must keep [m]."""


class PostureRule(Record):
    """The candidates of a robot's stances, see `base_poses`, and how one is chosen, see `rule`."""

    height_count: Annotated[IntArray, (2,), np.int64]
    """Number of candidate heights, and of those between opposite walls."""
    heights: Annotated[Array, (2, MOST_POSES)]
    """These heights [m]."""
    roll_count: Annotated[IntArray, (2,), np.int64]
    """Number of candidate rolls, and of those between opposite walls."""
    rolls: Annotated[Array, (2, MOST_POSES)]
    """These rolls [rad]."""
    mounts: Annotated[Array, (MOST_LIMBS, 2)]
    """Directions of the mounts across the body's z axis."""
    finds_first: bool
    """Whether the grasps determine the first limb; else it is limb 0."""
    turns: Annotated[Array, (MOST_LIMBS, 3, 3)]
    """Axes of the base by its first limb, if that were limb 0."""
    tool_length: float
    """Distance from the flange to the grasped point [m]."""
    is_given: bool
    """Whether a base pose in the world is given, which is the only candidate."""
    thresholds: Thresholds
    """Thresholds of a node."""
    scale_m: float
    """Limb manipulability at margin 1."""
    scale_b: float
    """Base manipulability at margin 1."""
    node_margin: float
    """A margin slightly below that of every node."""
    nodes_only: bool
    """Whether to omit the results for stances that are no nodes; most are then rejected early."""
    check_branches: bool
    """Whether to compute sets of branches; otherwise every node has all branches."""
    among_boxes: bool
    """Whether the boxes count; without them the robot keeps the clearance from itself alone."""


class MapPoints(NamedTuple):
    """The m graspable points of a map."""

    positions: Array
    """The points [m], shape (m, 3)."""
    rotations: Array
    """Their axes in the world: rail, side and normal, shape (m, 3, 3)."""


class PostureWorld(NamedTuple):
    """What all stances share."""

    robots: Any
    """The robot, a record of `RobotModel`, shape (1,)."""
    rules: Any
    """The rule, a record of `PostureRule`, shape (1,)."""
    points: MapPoints
    """The graspable points."""
    grid: BoxGrid
    """The boxes."""


class StanceGeometry(Record):
    """The grasps of a stance, limb by limb from its first limb on, and axes of its candidates.

    They are seen from the grasp of the first limb, and from the world where a base pose is given.
    """

    first: int
    """The first limb."""
    place: Pose
    """Frame in which the grasps are seen: that of this limb's grasp, with rail, side and normal."""
    grasps: Annotated[Rows[Grasp], (MOST_LIMBS,)]
    """Grasp of each limb."""
    centroid: Vector
    """Centroid of the grasps [m]."""
    frame: Matrix
    """Body axes at roll zero, as columns."""
    out: Vector
    """Outward direction."""
    line: Vector
    """Roll axis."""
    opposed: int
    """1 if the held walls are opposite, else 0."""
    keys: Annotated[Array, (5, MOST_LIMBS)]
    """What chooses the first limb, see `base_poses.first_limb`."""


class Posture(Record):
    """The posture of a stance, limb by limb from its first limb on."""

    pose_number: int
    """Index of the base pose among the candidates; -1 for none."""
    w_m: Annotated[Array, (MOST_LIMBS,)]
    """Limb manipulability; 0 where the stance cannot be held."""
    w_b: float
    """Base manipulability."""
    is_node: bool
    """Whether the thresholds are met."""
    branch: Limbs
    """Branch of each limb at which the posture has its margin."""
    branch_sets: Limbs
    """Branches and flips on which each limb may hold."""
    cause: int
    """Cause of the collision where only a collision keeps the stance from being a node, else 0."""


class PostureScratch(Record):
    """Scratch for the choice of one posture."""

    geometry: StanceGeometry
    """The grasps of the stance."""
    base: Pose
    """The base pose that is evaluated, in the frame of the stance's grasps."""
    base_in_world: Pose
    """The same in the world."""
    other: Posture
    """Another posture of the stance."""
    w_m: Annotated[Array, (MOST_LIMBS, CLASSES)]
    """`w_m` of each class of branches of each limb at that pose; 0 if out of reach."""
    information: Annotated[Array, (MOST_LIMBS, BRANCHES, 6, 6)]
    """`K^-1` of each limb on each branch on which it is placed."""
    sums: Annotated[Array, (2, 6, 6)]
    """Sum of `K^-1` over the limbs on the branches in `combination`, and what its determinant is
    computed with."""
    combination: Limbs
    """Branch of each limb in the combination that is evaluated."""
    option_count: Limbs
    """Number of branches of each limb that are combined."""
    options: Annotated[IntArray, (MOST_LIMBS, BRANCHES), np.int64]
    """These branches."""
    gaps: Annotated[Array, (MOST_LIMBS, BRANCHES)]
    """Distance of each limb from itself and the body on each branch on which it is placed [m]."""
    in_body: Annotated[Rows[Shapes], (MOST_LIMBS, BRANCHES)]
    """Capsules of each limb in the body frame on each branch on which it is placed."""
    frames: Annotated[Array, (7, 4, 3)]
    """Link frames of a limb in its base frame, see `chain.link_frames`."""
    inversion: Inversion
    """Work arrays of matrix inversion."""
    surface: GraspSurface
    """The grasp at which a gripper is."""
    lines: LineScratch
    """The motion of the base that stands for a departure."""
