"""Tasks with layouts: which points are occupied, and a start and goal that a plan joins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mlivr_gym.arguments import NOT_NEGATIVE, checked
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.envs.task import Task
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.kinematics.batches import distance, distances
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.table_values import TableValues, in_goal_region
from mlivr_gym.schema import FieldPath, Flag
from mlivr_gym.stances.moves import TableMoves
from mlivr_gym.stances.random_states import TRIES
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import StepTables, state_of, step_tables
from mlivr_gym.transitions.state import State
from mlivr_gym.world.grasp_map import GraspMap

OCCUPIED_SHARES = 0.3, 0.5
"""Least and largest share of the points that `LayoutTasks` makes occupied."""

CLUSTER_RADIUS = 0.4
"""Distance from a drawn point within which points of clustered layouts are occupied [m]."""


@dataclass(frozen=True)
class LayoutTasks:
    """Task generator that draws which points are occupied, and a start and goal joined by a plan.

    The share of occupied points is uniform in `OCCUPIED_SHARES`, and each set of points of that
    size is as likely as another, or the points lie in clusters, see `clustered`; points of a start
    that is given stay free. They become the occupied points of the graph. The goal is the base
    position of a random stance that is left, if it lies in the cabin. The start is a random one of
    the stances outside the goal region from which an exact search finds the goal. If there is none,
    all three are drawn again.

    Attributes
    ----------
    clustered
        Whether occupied points lie together, as behind bags: points are drawn one after the other,
        and of each all points within `CLUSTER_RADIUS` become occupied, the closest first, until the
        share is reached. Starts from which the fewest steps are less than half of the most that a
        start has are then not drawn.
    """

    clustered: bool = False

    def __post_init__(self) -> None:
        """Check the field."""
        Flag().read(self.clustered, FieldPath("clustered", SettingError))

    @checked({"tolerance": NOT_NEGATIVE})
    def draw(
        self,
        graph: StanceGraph,
        rng: np.random.Generator,
        tolerance: float,
        start: State | None = None,
    ) -> Task:
        """Return a task, and occupy the points of its layout; see `TaskGenerator.draw`.

        Raises a `SettingError` if the robot has more than two limbs, or the start has a pose of its
        own, and a `StanceError` if no task is found; the graph then has the occupied points that it
        had before.
        """
        if start is not None and start.pose is not None:
            raise SettingError("tasks='random' starts in the posture of a stance; give no pose")
        before, points = graph.occupied, np.arange(len(graph.grasp_map))
        low, high = graph.grasp_map.cabin
        free = points if start is None else np.setdiff1d(points, start.stance)
        for _ in range(TRIES):
            count = min(round(rng.uniform(*OCCUPIED_SHARES) * len(points)), len(free))
            graph.vacate()
            graph.occupy(self._occupied(graph.grasp_map, rng, free, count))
            tables = step_tables(graph)
            feasible = np.flatnonzero((tables.branch_sets != 0).all(axis=1))
            if not len(feasible):
                continue
            goal = tables.base_position[rng.choice(feasible)]
            if (goal < low).any() or (goal > high).any():
                continue
            fewest = _step_values(tables, goal, tolerance).of_stances(0)
            reached = np.isfinite(fewest) & (fewest > 0.0)
            if self.clustered:
                reached &= fewest >= 0.5 * fewest[reached].max(initial=0.0)
            starts = np.flatnonzero(reached)
            if start is not None:
                starts = starts[(tables.points[starts] == start.stance).all(axis=1)]
            if len(starts):
                s = int(rng.choice(starts))
                return Task(start or state_of(tables, s, tables.branch_sets[s]), goal)
        graph.vacate()
        graph.occupy(sorted(before))
        raise StanceError(
            f"no layout with a goal that can be reached was found on map {graph.grasp_map.name!r} "
            f"in {TRIES} draws"
        )

    def _occupied(
        self, grasp_map: GraspMap, rng: np.random.Generator, free: IntArray, count: int
    ) -> list[int]:
        """Return which of the points that may become occupied do, `count` of them."""
        if not self.clustered:
            found: list[int] = rng.choice(free, count, replace=False).tolist()
            return found
        positions, taken = grasp_map.positions[free], dict[int, None]()
        for centre in rng.permutation(len(free)).tolist():
            away = distances(positions, positions[centre])
            close = np.argsort(away, kind="stable")[: int((away <= CLUSTER_RADIUS).sum())]
            taken.update(dict.fromkeys(free[close].tolist()))
            if len(taken) >= count:
                break
        return list(taken)[:count]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data from which `TASKS` builds this generator."""
        return {"kind": "clutter" if self.clustered else "random"}


def _step_values(tables: StepTables, goal: Array, tolerance: float) -> TableValues:
    """Return the fewest steps to a goal position [m]."""
    return TableValues(tables, in_goal_region(tables, goal[None], tolerance), Cost.named("steps"))


def fewest_steps(moves: TableMoves, state: State, goal: Array, tolerance: float) -> int:
    """Return the number of steps of an optimal plan, -1 if there is none.

    The goal position has shape (3,) [m], and `tolerance` is the radius of the goal region [m].
    """
    if distance(moves.stance_properties(state).base_position, goal.tolist()) <= tolerance:
        return 0
    # The successors are asked, since a start may have a pose of its own.
    values, steps = _step_values(moves.tables, goal, tolerance), moves.successors(state)
    s = moves.stance_at[tuple(steps.stances(state).T)]
    fewest = 1 + values.of_states(s, steps.branch_sets, np.zeros(len(s), np.int64)).min()
    return int(fewest) if np.isfinite(fewest) else -1
