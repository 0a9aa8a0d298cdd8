"""The parts of a plan: what was asked for, the world, the motion, and what the search spent."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.boxes import Box

COSTS = ("base", "steps", "weighted")
"""Names of the costs."""

SWING_KINDS = ("direct", "over", "folded", "changed", "unchecked")
"""Names of the kinds of swings, the shortest first; `unchecked` without collisions."""


@dataclass(frozen=True)
class Step:
    """One regrasp and the base motion that goes with it.

    Attributes
    ----------
    limb
        Limb that moves.
    from_point
        Point it leaves.
    to_point
        Point it grasps.
    path
        `"straight"`, `"arc"`, or `"unchecked"` where steps were not checked.
    pivot
        Centre of the arc: centroid of the held points [m].
    displacement
        Base displacement [m].
    swing
        Kind of the limb's swing, one of `mlivr_gym.motion.swings.SWING_KINDS`.
    knots
        Base parameter from 0 to 1 and the limb's six joint angles [rad] at each knot of its
        swing, from above the point it leaves to above the point it grasps; in between both
        change linearly.
    rounded
        Shares of the lines before and after each knot that lie on its rounded corner,
        see `mlivr_gym.motion.rounded_lines`; 0 and 0 where the swing comes to rest.
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
    """What was asked for.

    Attributes
    ----------
    goal
        Goal position [m].
    goal_tolerance
        Radius of the goal region [m].
    cost_name
        Name of the cost, one of `COSTS`.
    regrasp_price
        Metres charged for a regrasp, if the cost is `"weighted"`.
    method
        Search method.
    heuristic
        Heuristic.
    goal_face
        Face of the map whose points all limbs hold at the goal; None for any.
    """

    goal: tuple[float, float, float]
    goal_tolerance: float
    cost_name: str
    regrasp_price: float | None
    method: str
    heuristic: str
    goal_face: str | None = None

    def cost_of(self, positions: Array) -> float:
        """Cost of a way along base positions, shape (K, 3) [m]."""
        away = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
        steps = float(len(positions) - 1)
        return steps if self.cost_name == "steps" else away + steps * (self.regrasp_price or 0.0)


@dataclass(frozen=True)
class World:
    """Where the plan was made, and for which robot.

    Attributes
    ----------
    map_name
        Name of the map.
    map_fingerprint
        Hash of the map's points and boxes.
    obstacles
        Boxes that stood there when the plan was made, besides those of the map.
    occupied
        Ids of points that were not to be grasped.
    robot
        Description of the robot.
    settings
        Thresholds and switches.
    """

    map_name: str
    map_fingerprint: str
    obstacles: tuple[Box, ...] = ()
    occupied: tuple[str, ...] = ()
    robot: RobotSpec = field(default_factory=RobotSpec)
    settings: Settings = field(default_factory=Settings)

    @classmethod
    def of(cls, graph: StanceGraph) -> World:
        """The world of a stance graph as it is now."""
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
        Point ids of each limb, K tuples of N.
    steps
        Committed steps, K - 1.
    base_positions
        Base positions in the world, shape (K, 3) [m].
    base_quaternions
        Base orientations in the world w, x, y, z, shape (K, 4).
    joint_positions
        Joint angles, shape (K, N, 6) [rad]; continuous while a limb holds.
    branches
        Branch of each limb, shape (K, N).
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
        """How many stances and limbs there are, in one line."""
        return f"<Motion: {len(self.stances)} stances of {len(self.stances[0])} limbs>"


@dataclass(frozen=True)
class Statistics:
    """What the search found and spent.

    Attributes
    ----------
    cost
        Cost of the plan.
    expanded
        States expanded.
    generated
        States generated.
    feasibility_time
        Time spent on postures and stances for this query [s].
    search_time
        Time spent on search and step checks [s].
    backward
        Stances that searches backward have expanded for the heuristic, for this query.
    bound
        Factor of the least cost of any plan of the graph within which the cost is proved to
        be, 1 if it is the least; None if nothing is proved.
    """

    cost: float
    expanded: int
    generated: int
    feasibility_time: float = 0.0
    search_time: float = 0.0
    backward: int = 0
    bound: float | None = None
