"""The parts of a plan: the query, the world, the motion, and the statistics of the search."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.world.boxes import Box

if TYPE_CHECKING:
    from mlivr_gym.stances.stance_graph import StanceGraph

COSTS = ("base", "steps", "weighted")
"""Names of the costs."""

SWING_KINDS = ("direct", "over", "folded", "changed", "unchecked")
"""Names of the kinds of swings; `"unchecked"` is one of a plan without collision checks."""


@dataclass(frozen=True)
class Step:
    """One regrasp, with the base path that goes with it.

    Attributes
    ----------
    limb
        Index of the limb that moves.
    from_point
        Id of the point that it releases.
    to_point
        Id of the point that it grasps.
    path
        Kind of the base path: `"straight"`, `"arc"`, or `"unchecked"` if the plan was made
        without checks of the steps.
    pivot
        Centre of the arc in the world: the centroid of the points that the support limbs
        hold [m].
    displacement
        Base displacement [m].
    swing
        Kind of the swing, one of `mlivr_gym.motion.plan_parts.SWING_KINDS`.
    knots
        Knots of the swing, from above the point that the limb releases to above the point
        that it grasps: base parameter from 0 to 1 and the six joint angles of the limb [rad].
        Both change linearly between two knots.
    rounded
        Fractions of the lines before and after each knot that its rounded corner replaces, see
        `mlivr_gym.motion.rounded_lines`; 0 and 0 where the swing stops.
    """

    limb: int
    from_point: str
    to_point: str
    path: str
    pivot: tuple[float, float, float]
    displacement: float
    swing: str = "unchecked"
    knots: tuple[tuple[float, ...], ...] = ()
    rounded: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True)
class Query:
    """The query that a plan answers.

    Attributes
    ----------
    goal
        Goal position of the base in the world [m].
    goal_tolerance
        Radius of the goal region [m].
    cost_name
        Name of the cost, one of `COSTS`.
    regrasp_price
        Price of a regrasp [m] if the cost is `"weighted"`, otherwise None.
    method
        Name of the search method.
    heuristic
        Name of the heuristic, as requested; see `Planner.plan` for when another one is used.
    goal_face
        Face of the map on which all limbs hold points at the goal; None for any face.
    """

    goal: tuple[float, float, float]
    goal_tolerance: float
    cost_name: str
    regrasp_price: float | None
    method: str
    heuristic: str
    goal_face: str | None = None

    def cost_of(self, positions: Array) -> float:
        """Return the cost of a sequence of base positions, shape (K, 3) [m]."""
        away = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
        steps = float(len(positions) - 1)
        return steps if self.cost_name == "steps" else away + steps * (self.regrasp_price or 0.0)


@dataclass(frozen=True)
class World:
    """The map, obstacles, robot and settings for which a plan was made.

    Attributes
    ----------
    map_name
        Name of the map.
    map_fingerprint
        Hash of the points and boxes of the map.
    obstacles
        Boxes in addition to those of the map.
    occupied
        Ids of the occupied points, which no limb may grasp.
    robot
        Description of the robot.
    settings
        Thresholds and switches of the stance graph.
    """

    map_name: str
    map_fingerprint: str
    obstacles: tuple[Box, ...] = ()
    occupied: tuple[str, ...] = ()
    robot: RobotSpec = field(default_factory=RobotSpec)
    settings: Settings = field(default_factory=Settings)

    @classmethod
    def of(cls, graph: StanceGraph) -> World:
        """Return the present world of a stance graph."""
        grasp_map = graph.grasp_map
        return cls(
            grasp_map.name, grasp_map.fingerprint, graph.obstacles,
            graph.ids(sorted(graph.occupied)), graph.robot, graph.settings,
        )  # fmt: skip


@dataclass(frozen=True, repr=False)
class Motion:
    """K stances, the steps between them, and the configuration in each stance.

    Attributes
    ----------
    stances
        Ids of the points that the limbs hold, K tuples of N.
    steps
        The K - 1 committed steps.
    base_positions
        Base positions in the world, shape (K, 3) [m].
    base_quaternions
        Base orientations in the world w, x, y, z, shape (K, 4).
    joint_positions
        Joint angles, shape (K, N, 6) [rad]; a limb keeps branch and winding while it holds.
    branches
        Inverse-kinematics branch of each limb, shape (K, N).
    w_m
        Limb manipulability, shape (K, N).
    w_b
        Base manipulability, shape (K,).
    """

    stances: tuple[tuple[str, ...], ...]
    steps: tuple[Step, ...]
    base_positions: Array
    base_quaternions: Array
    joint_positions: Array
    branches: IntArray
    w_m: Array
    w_b: Array

    def __repr__(self) -> str:
        """Return the number of stances and limbs in one line."""
        return f"<Motion: {len(self.stances)} stances of {len(self.stances[0])} limbs>"


@dataclass(frozen=True)
class Statistics:
    """Cost of a plan, and the effort of the search that returned it.

    Attributes
    ----------
    cost
        Cost of the plan ([m] or number of steps).
    expanded
        Number of states that the search expanded.
    generated
        Number of states that the search put into its open queue.
    feasibility_time
        Time spent on checking the start state [s].
    search_time
        Time spent on the search and on step checks [s].
    backward
        Number of nodes that backward searches settled to compute the lower bounds.
    bound
        Factor of the optimal cost within which the cost is proved to lie, 1 for an optimal
        plan; None if nothing is proved.
    """

    cost: float
    expanded: int
    generated: int
    feasibility_time: float = 0.0
    search_time: float = 0.0
    backward: int = 0
    bound: float | None = None
