"""The parts of a plan: the query, the world, the motion, and the statistics of the search."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import scipy

from mlivr_gym.arguments import NOT_NEGATIVE, checked
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import PlanError
from mlivr_gym.motion.joint_path import JointPath
from mlivr_gym.robot.specification import ROBOT, RobotSpec
from mlivr_gym.schema import NAME, Choice, Integer, ListOf, OrNone, Tuples
from mlivr_gym.settings import SETTINGS, Settings
from mlivr_gym.values import MAX_LENGTH, MAX_POINTS
from mlivr_gym.world.boxes import Box, Boxes

if TYPE_CHECKING:
    from mlivr_gym.stances.stance_graph import StanceGraph

COSTS = ("base", "steps", "weighted")
"""Names of the costs."""

CUSTOM = "custom"
"""Name of every cost of the user's own, which a plan does not contain."""

SWING_KINDS = ("direct", "over", "folded", "changed", "unchecked")
"""Names of the kinds of swings; `"unchecked"` is one of a plan without collision checks."""

COUNT = Integer(0, 1 << 62)
"""Validator of a number of states."""


@dataclass(frozen=True, eq=False)
class Step:
    """One regrasp, with the joint path by which it is carried out, see `joint_path`."""

    limb: int
    """Index of the limb that moves."""
    from_point: str
    """Id of the point that it releases."""
    to_point: str
    """Id of the point that it grasps."""
    leader: int
    """Index of the support limb that carries the base."""
    displacement: float
    """Base displacement [m]."""
    swing: str = "unchecked"
    """Kind of the swing, one of `mlivr_gym.motion.plan_parts.SWING_KINDS`."""
    rests: tuple[int, ...] = ()
    """Indices of the knots at which the robot is at rest: the first and the last, and those between
    departure, parts of the swing, and approach."""
    knots: Array = field(default_factory=lambda: np.zeros((0, 0, 6)))
    """Knots of the joint path: joint angles of all limbs, the control points of their spline, shape
    (k, N, 6) [rad]. There are none if steps are not checked and the limbs cannot follow."""

    def _values(self) -> tuple[Any, ...]:
        """Return all fields as values that can be compared and hashed."""
        return tuple(
            (value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value
            for value in vars(self).values()
        )

    def __eq__(self, other: object) -> bool:
        """Return whether two steps are equal in all fields."""
        return isinstance(other, Step) and self._values() == other._values()

    def __hash__(self) -> int:
        """Return a hash of all fields."""
        return hash(self._values())


def step_along(step: Step, path: JointPath, swing: str) -> Step:
    """Return a step along a joint path with a swing of a kind."""
    return replace(step, leader=path.leader, swing=swing, rests=path.rests, knots=path.knots)


@dataclass(frozen=True)
class Query:
    """The query that a plan answers."""

    goal: Annotated[tuple[float, float, float], Tuples((3,), most=MAX_LENGTH, unit="m")]
    """Goal position of the base in the world [m]."""
    goal_tolerance: Annotated[float, NOT_NEGATIVE]
    """Radius of the goal region [m]."""
    cost_name: Annotated[str, Choice((*COSTS, CUSTOM))]
    """Name of the cost, one of `COSTS`, or `"custom"` for a cost of the user's own."""
    regrasp_price: Annotated[float | None, OrNone(NOT_NEGATIVE)]
    """Price of a regrasp [m] if the cost is `"weighted"`, otherwise None."""
    method: Annotated[str, NAME]
    """Name of the search method."""
    heuristic: Annotated[str, NAME]
    """Name of the heuristic, as requested, or the default of method and robot. Over a node table of
    more limbs the bounds are the relaxed cost-to-go, see `SearchOptions.heuristic`."""
    goal_face: Annotated[str | None, OrNone(NAME)] = None
    """Face of the map on which all limbs hold points at the goal; None for any face."""

    def cost_of(self, positions: Array) -> float:
        """Return the cost of a sequence of base positions, shape (K, 3) [m].

        Raises a `PlanError` if it is a cost of the user's own, which the plan does not contain.
        """
        if self.cost_name == CUSTOM:
            raise PlanError("a plan does not contain a cost of the user's own to charge")
        away = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
        steps = float(len(positions) - 1)
        return steps if self.cost_name == "steps" else away + steps * (self.regrasp_price or 0.0)


@dataclass(frozen=True)
class World:
    """The map, obstacles, robot and settings for which a plan was made."""

    map_name: Annotated[str, NAME]
    """Name of the map."""
    map_fingerprint: Annotated[str, NAME]
    """Hash of the points and boxes of the map."""
    obstacles: Annotated[tuple[Box, ...], Boxes()] = ()
    """Boxes in addition to those of the map."""
    occupied: Annotated[tuple[str, ...], ListOf(NAME, most=MAX_POINTS)] = ()
    """Ids of the occupied points, which no limb may grasp."""
    robot: Annotated[RobotSpec, ROBOT] = field(default_factory=RobotSpec)
    """Description of the robot."""
    settings: Annotated[Settings, SETTINGS] = field(default_factory=Settings)
    """Thresholds and switches of the stance graph."""

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
    """K stances, the steps between them, and the configuration in each stance."""

    stances: tuple[tuple[str, ...], ...]
    """Ids of the points that the limbs hold, K tuples of N."""
    steps: tuple[Step, ...]
    """The K - 1 committed steps."""
    base_positions: Array
    """Base positions in the world, shape (K, 3) [m]."""
    base_quaternions: Array
    """Base orientations in the world w, x, y, z, shape (K, 4)."""
    joint_positions: Array
    """Joint angles, shape (K, N, 6) [rad]; a limb keeps branch and winding while it holds."""
    branches: IntArray
    """Inverse-kinematics branch of each limb, shape (K, N)."""
    w_m: Array
    """Limb manipulability, shape (K, N)."""
    w_b: Array
    """Base manipulability, shape (K,)."""

    @cached_property
    def base_rotations(self) -> Array:
        """Base orientations in the world, shape (K, 3, 3)."""
        turns = scipy.spatial.transform.Rotation.from_quat(self.base_quaternions, scalar_first=True)
        return np.asarray(turns.as_matrix())

    @checked()
    def joint_path(self, robot: RobotSpec, index: int) -> JointPath:
        """Return the joint path of a step of this robot, by its index from 0.

        Raises a `PlanError` if there is no such step, or it has no joint path.
        """
        if not 0 <= index < len(self.steps):
            count = len(self.steps)
            raise PlanError(f"the plan has no step {index}; it has {count}, counted from 0")
        step = self.steps[index]
        if not len(step.knots):
            raise PlanError(
                f"step {index} has no joint path: its steps were not checked, and a limb cannot "
                "follow the base"
            )
        return JointPath(
            robot, step.limb, step.leader, self.base_positions[index], self.base_rotations[index],
            np.array(step.knots), step.rests,
        )  # fmt: skip

    def __repr__(self) -> str:
        """Return the number of stances and limbs in one line."""
        return f"<Motion: {len(self.stances)} stances of {len(self.stances[0])} limbs>"


@dataclass(frozen=True)
class Statistics:
    """Cost of a plan, and the effort of the search that returned it."""

    cost: Annotated[float, NOT_NEGATIVE]
    """Cost of the plan ([m] or number of steps)."""
    expanded: Annotated[int, COUNT]
    """Number of states that the search expanded."""
    generated: Annotated[int, COUNT]
    """Number of states that the search put into its open queue."""
    feasibility_time: Annotated[float, NOT_NEGATIVE] = 0.0
    """Time spent on checking the start state [s]."""
    search_time: Annotated[float, NOT_NEGATIVE] = 0.0
    """Time spent on the search and on step checks [s]."""
    backward: Annotated[int, COUNT] = 0
    """Number of nodes and labels from which backward searches computed the lower bounds."""
    bound: Annotated[float | None, OrNone(Tuples((), 1.0))] = None
    """Factor of the optimal cost within which the cost is proved to lie, 1 for an optimal plan;
    None if nothing is proved."""
