"""The stances of a robot on a map, their postures, and the table of the nodes among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.limb_branch_sets import unpacked
from mlivr_gym.errors import RobotError, SettingError, StanceError, shortened
from mlivr_gym.postures.given_pose import given_pose
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import FieldPath
from mlivr_gym.settings import Settings
from mlivr_gym.sharing import locked
from mlivr_gym.stances.checked_steps import CheckedSteps, join
from mlivr_gym.stances.graph_table import GraphTable, ListedStances
from mlivr_gym.stances.node_steps import node_stances
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.stances.point_pairs import check_distances, nearest_told, pairs_within
from mlivr_gym.stances.present_table import PresentTable
from mlivr_gym.transitions.records import StanceArrays
from mlivr_gym.transitions.state import State, check_integers, check_state
from mlivr_gym.world.given_points import STANCE
from mlivr_gym.world.grasp_map import GraspMap

SAME = 1e-9
"""Difference up to which two base poses are the same [m], also for entries of rotations."""

MOST_POSTURES, FEW = 1 << 14, 64
"""Number of postures without obstacles that are kept, some 8 MB, and the number of stances up to
which those of one call are."""


class StancePostures(CheckedSteps):
    """Stances and their postures, of one robot on one map under one set of thresholds.

    Attributes
    ----------
    graph_table
        The table of nodes and edges without obstacles and occupied points; None if there is none.
    """

    graph_table: GraphTable | None = None

    @checked()
    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Prepare the solver."""
        super().__init__(grasp_map, robot, settings, PostureSolver(grasp_map, robot, settings))
        self.limb_threshold, self.base_threshold = settings.thresholds(robot.limbs)
        self._free_postures: dict[bytes, Postures] = {}
        self._present: PresentTable | None = None
        len(self.pairs)  # raises an error at once if no two points may be held

    @property
    def table(self) -> NodeTable | None:
        """Nodes and edges without obstacles and occupied points; None if there is no table."""
        return None if self.graph_table is None else self.graph_table.nodes

    @property
    @locked
    def present(self) -> PresentTable:
        """The table among the present obstacles, with the results of earlier checks there."""
        known, present = self.graph_table, self._present
        if known is None:
            raise SettingError(f"no table of robot {self.robot.name!r} was built for this map")
        if present is None or present.version != self.version or not present.is_of(known):
            self._present = present = PresentTable(self, known, present)
        return present

    @property
    def listed(self) -> ListedStances:
        """What is known of all stances, see `GraphTable.listed`.

        Raises a `SettingError` if the graph does not list all.
        """
        known = self.graph_table
        if known is None or known.listed is None:
            raise SettingError(
                f"exact tables need two limbs; robot {self.robot.name!r} has {self.limbs}"
            )
        return known.listed

    @property
    def lists_all(self) -> bool:
        """Whether all stances are listed, with their postures, which those of two limbs are."""
        return self.graph_table is not None and self.graph_table.listed is not None

    @property
    def is_complete(self) -> bool:
        """Whether all stances are listed and every step is known among the present obstacles."""
        return self.lists_all and self.present.is_complete

    def __len__(self) -> int:
        """Return the number of listed stances."""
        return len(self.listed.postures.w_b)

    @cached_property
    def points(self) -> IntArray:
        """Point indices of each listed stance, shape (n, N), in lexical order."""
        assert self.listed is not None
        assert self.table is not None
        return self.table.points.astype(np.int64)

    @cached_property
    def by_point(self) -> tuple[IntArray, IntArray]:
        """Rows of the listed stances by the point of each limb, shape (N, n), and their starts.

        The starts of the points, and the end of all, have shape (N, m + 1).
        """
        rows = np.argsort(self.points, axis=0, kind="stable").T
        ordered, every = np.take_along_axis(self.points.T, rows, axis=1), len(self.grasp_map) + 1
        return rows, np.array([np.searchsorted(one, np.arange(every)) for one in ordered])

    @property
    def base_position(self) -> Array:
        """Base positions of the listed stances [m], shape (n, 3)."""
        return self.listed.postures.base_position

    @property
    def base_rotation(self) -> Array:
        """Base rotations of the listed stances, the axes in columns, shape (n, 3, 3)."""
        return self.listed.postures.base_rotation

    @property
    def w_m(self) -> Array:
        """Limb manipulability of the listed stances, shape (n, N)."""
        return self.listed.postures.w_m

    @property
    def w_b(self) -> Array:
        """Base manipulability of the listed stances, shape (n,)."""
        return self.listed.postures.w_b

    @property
    def branch(self) -> IntArray:
        """Branch of each limb in the postures of the listed stances, shape (n, N)."""
        return self.listed.postures.branch

    @property
    @locked
    def branch_sets(self) -> IntArray:
        """Branches and flips on which limbs may hold at the listed stances at present, (n, N)."""
        return self.node_postures(np.arange(len(self))).branch_sets

    def find(self, stance: Sequence[int]) -> int:
        """Return the row of a stance in the table, given by point indices, -1 if it is no node."""
        self.check_stance(stance)
        return self._row(stance)[0]

    def _row(self, stance: Sequence[int]) -> tuple[int, int]:
        """Return the row of a stance in the table, -1 if it has none, and its relabelling."""
        if self.table is None:
            return -1, 0
        rows, relabellings = self.table.find(np.array([stance], dtype=np.int64), self.robot)
        return int(rows[0]), int(relabellings[0])

    @cached_property
    def pairs(self) -> IntArray:
        """Ordered pairs of points that may be held at once, shape (p, 2).

        Raises a `RobotError` if there is none.
        """
        grasp_map, robot = self.grasp_map, self.robot
        positions, pairs = grasp_map.positions, pairs_within(grasp_map, robot.span)
        distance = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
        pairs = pairs[distance >= robot.grasp_separation - 1e-9]
        if not len(pairs):
            raise RobotError(
                f"robot {robot.name!r} cannot hold any stance on map {grasp_map.name!r}: no two of "
                f"its points are between {robot.grasp_separation:g} m and {robot.span:g} m apart"
                f"{nearest_told(grasp_map, robot.span)}"
            )
        both = np.concatenate([pairs, pairs[:, ::-1]])
        ordered: IntArray = both[np.lexsort((both[:, 1], both[:, 0]))]
        return ordered

    @cached_property
    def partner_start(self) -> IntArray:
        """First pair of each point, and the end of all, shape (m + 1,)."""
        start: IntArray = np.searchsorted(self.pairs[:, 0], np.arange(len(self.grasp_map) + 1))
        return start

    @cached_property
    def compatible(self) -> BoolArray:
        """Which points two limbs may hold at once, shape (m, m)."""
        compatible = np.zeros((len(self.grasp_map),) * 2, dtype=np.bool_)
        compatible[tuple(self.pairs.T)] = True
        return compatible

    def partners(self, point: int) -> IntArray:
        """Return the points that may be held at once with `point`."""
        first = self.grasp_map.index(point)
        return self.pairs[self.partner_start[first] : self.partner_start[first + 1], 1]

    def indices(self, stance: Sequence[str | int]) -> tuple[int, ...]:
        """Return the point indices of a stance given by ids or indices.

        Raises a `StanceError` if the number of points, an id, or the distance of two points is not
        valid.
        """
        named = STANCE.read(stance, FieldPath("stance", StanceError))
        if len(named) != self.limbs:
            raise StanceError(
                f"stance {shortened(stance)} must name {self.limbs} points, one for each limb of "
                f"{self.robot.name!r}"
            )
        points = tuple(self.grasp_map.index(point) for point in named)
        check_distances(self.grasp_map, self.robot, points)
        return points

    def ids(self, stance: Sequence[int]) -> tuple[str, ...]:
        """Return the point ids of a stance."""
        named = STANCE.read(stance, FieldPath("stance", StanceError))
        return tuple(self.grasp_map.ids[self.grasp_map.index(point)] for point in named)

    def postures(self, stances: IntArray) -> Postures:
        """Return the postures of stances, shape (k, N), feasible or not.

        Stances that touch an obstacle or hold an occupied point cannot be held. Raises a
        `StanceError` if they are not rows of N point indices.
        """
        rows = self.rows_of_points(stances)
        if (found := self._listed_postures(rows)) is not None:
            return found
        if not 0 < len(rows) <= FEW:
            return self.among_obstacles(rows, self.solver.solve(rows))
        known = self._free_postures
        if len(known) > MOST_POSTURES:
            known.clear()
        keys = [row.tobytes() for row in rows]
        new = [k for k, key in enumerate(keys) if key not in known]
        if new:
            solved = self.solver.solve(rows[new])
            known |= {keys[k]: solved.take(slice(n, n + 1)) for n, k in enumerate(new)}
        return self.among_obstacles(rows, join(*(known[key] for key in keys)))

    def nodes(self, stances: IntArray) -> Postures:
        """Return postures as `postures` does, but only empty branch sets for what is no node."""
        rows = self.rows_of_points(stances)
        if (found := self._listed_postures(rows)) is not None:
            return found
        return self.among_obstacles(rows, self.solver.solve(rows, nodes_only=True))

    def _listed_postures(self, stances: IntArray) -> Postures | None:
        """Return the postures of stances that are all listed, (k, N); None if one is not."""
        if not self.lists_all or self.table is None:
            return None
        rows, _ = self.table.find(stances, self.robot)
        return self.node_postures(rows) if (rows >= 0).all() else None

    def node_postures(self, rows: IntArray) -> Postures:
        """Return the present postures of listed stances, given by their rows, shape (k,)."""
        present, found = self.present, self.listed.postures.take(rows)
        present.check_nodes(rows)
        branch_sets = unpacked(present.table.branch_sets[rows], self.limbs)
        if self.occupied:
            branch_sets[np.isin(self.points[rows], list(self.occupied)).any(axis=1)] = 0
        return replace(found, branch_sets=branch_sets)

    def rows_of_points(self, stances: Any) -> IntArray:
        """Check that stances are rows of point indices, see `postures`, and return them, (k, N)."""
        m = len(self.grasp_map)
        try:
            rows = np.asarray(stances)
        except ValueError:  # rows of different lengths
            rows = np.zeros(0)
        inside = rows.dtype.kind in "iu" and rows.shape[1:] == (self.limbs,)
        if not inside or not ((rows >= 0) & (rows < m)).all():
            raise StanceError(
                f"stances {shortened(stances)} must be rows of {self.limbs} point indices "
                f"from 0 to {m - 1}"
            )
        return rows.astype(np.int64)

    def check(self, state: State) -> None:
        """Check that a state is one of this map.

        Raises a `StanceError` if its stance or branch sets are not numbers of points and branches,
        and a `SettingError` if its base pose is not valid.
        """
        check_state(state, self.limbs, len(self.grasp_map))
        if state.pose is not None:
            given_pose(state.pose)

    def check_stance(self, stance: Sequence[int]) -> None:
        """Check that a stance has a point index for each limb, see `check`."""
        check_integers(stance, self.limbs, len(self.grasp_map) - 1, "stance")

    def posture(self, stance: Sequence[int]) -> Postures:
        """Return the posture of a stance given by point indices; arrays have a leading 1."""
        self.check_stance(stance)
        return self.postures(np.array([stance], dtype=np.int64))

    def postures_at(
        self,
        stances: IntArray,
        positions: Array,
        rotations: Array,
        thresholds: tuple[float, float] = (0.0, 0.0),
    ) -> Postures:
        """Return postures at given base poses, among obstacles and occupied points.

        Stances have shape (k, N), base positions in the world shape (k, 3) [m], base rotations
        shape (k, 3, 3); the thresholds are those of `w_m` and `w_b`.
        """
        postures = self.solver.at(stances, positions, rotations, thresholds=thresholds)
        return self.among_obstacles(stances, postures)

    def _known_releases(self, stances: StanceArrays, todo: IntArray) -> tuple[BoolArray, Any]:
        """Return which releases the table knows without obstacles, see `CheckedSteps`."""
        chosen, place = np.unique(todo[:, 0], return_inverse=True)
        told = self._told_stances(stances, chosen)[0].releases[place, todo[:, 1]]
        known = told["known"].copy()
        if not self.lists_all:
            # Tables tell the folds, but not which each branch reaches first.
            known &= np.bitwise_count(told["folds"]) <= 1
            fold = np.bitwise_count(np.maximum(told["folds"], 1) - 1)
            told["root"], told["via"] = fold, fold[:, None]
        return known, told

    def _free_stances(self, stances: StanceArrays, rows: IntArray) -> StanceArrays:
        """Return some stances as they are without obstacles, with releases that the table knows."""
        told, unknown = self._told_stances(stances, rows)
        if unknown.any():
            points, base = told.points[unknown], told.base[unknown]
            solved = self.solver.solve(points, nodes_only=True)
            given, branch_sets = _differ(solved.base_rows, base), solved.branch_sets
            where = points[given], base["position"][given], base["rotation"][given]
            branch_sets[given] = self.solver.at(*where, thresholds=(0.0, 0.0)).branch_sets
            told.branch_sets[unknown] = branch_sets
        return told

    def _told_stances(
        self, stances: StanceArrays, rows: IntArray
    ) -> tuple[StanceArrays, BoolArray]:
        """Return some stances as the table has them, and which it has not at their pose, (k,).

        Their releases are known if the table knows them.
        """
        points, base, known = stances.points[rows], stances.base[rows], self.graph_table
        if known is None or not len(known.nodes.points):
            sets = stances.branch_sets[rows].copy()
            return (
                StanceArrays(points, base, sets, self.checks.unknown_releases(sets)),
                np.ones(len(rows), dtype=np.bool_),
            )
        found, relabellings = known.nodes.find(points, self.robot)
        if known.listed is None:
            told = node_stances(self.grasp_map, self.robot, known.nodes, found, -relabellings)
        else:
            told = self.checks.stances(points, known.listed.postures.take(found))
            if known.listed.releases is not None:
                told = told._replace(releases=known.listed.releases[found])
        off: BoolArray = (found < 0) | _differ(told.base, base)
        told.releases["known"][off | (not known.is_built)] = False
        return told._replace(points=points, base=base), off


def _differ(bases: Any, others: Any) -> BoolArray:
    """Return which base poses differ, rows of `Pose`, shape (k,)."""
    position = abs(bases["position"] - others["position"]) > SAME
    rotation = abs(bases["rotation"] - others["rotation"]) > SAME
    return np.asarray(position.any(axis=1) | rotation.any(axis=(1, 2)))
