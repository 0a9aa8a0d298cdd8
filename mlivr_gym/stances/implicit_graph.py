"""Stance graph of any number of limbs, whose nodes and steps are computed on demand."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.postures.base_poses import OPPOSED_HEIGHTS
from mlivr_gym.postures.postures import Postures
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.sharing import unlocked
from mlivr_gym.stances.checked_steps import Pieces, at_once, join
from mlivr_gym.stances.node_steps import candidate_steps, node_stances
from mlivr_gym.stances.node_table_file import NODE_TABLES
from mlivr_gym.stances.parts import Progress
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.stance_sets import StanceSets
from mlivr_gym.transitions.records import StanceArrays
from mlivr_gym.transitions.rule import can_release
from mlivr_gym.transitions.state import State, Successors
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

SAME = 1e-9
"""Difference up to which two base poses are the same [m], also for entries of rotations."""

MOST_RELEASES, MOST_POSTURES = 1 << 16, 1 << 14
"""Number of releases and of postures without obstacles that are kept for other obstacles; they take
some 30 and 8 MB."""

FEW = 64
"""Number of stances up to which postures are kept."""


class ImplicitGraph(StanceGraph):
    """Stance graph of any number of limbs, whose nodes and steps are computed on demand."""

    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Start with no results."""
        super().__init__(grasp_map, robot, settings)
        len(self.pairs)  # raises an error at once if no two points may be held
        self._releases: dict[tuple[bytes, int], Any] = {}
        self._free_releases: dict[tuple[bytes, int], Any] = {}
        self._free_postures: dict[bytes, Postures] = {}
        self._sets: StanceSets | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy what the graph is made of, its world, and a table that no file has."""
        kind, made_of, world = super().__reduce__()
        found = None if self.table is None else NODE_TABLES.find(self)
        is_stored = found is not None and found[0] is not None
        return kind, made_of, (*world, is_stored, None if is_stored else self.table)

    def __setstate__(self, world: tuple[Any, ...]) -> None:
        """Take a world, and a table that is given or stored."""
        *rest, is_stored, table = world
        super().__setstate__(tuple(rest))
        found = NODE_TABLES.find(self) if is_stored else None
        self.table = found[1] if found else table

    def postures(self, stances: IntArray) -> Postures:
        """Return the postures of stances, see `StanceGraph.postures`; those of a few are kept."""
        rows = self.rows_of_points(stances)
        if not 0 < len(rows) <= FEW:
            return super().postures(rows)
        known = self._free_postures
        if len(known) > MOST_POSTURES:
            known.clear()
        keys = [row.tobytes() for row in rows]
        new = [k for k, key in enumerate(keys) if key not in known]
        if new:
            found = self.solver.solve(rows[new])
            known |= {keys[k]: found.take(slice(n, n + 1)) for n, k in enumerate(new)}
        return self.among_obstacles(rows, join(*(known[key] for key in keys)))

    @unlocked  # a thread computes them while a planner, which has the lock, waits for it
    def sets(self, progress: Progress | None = None, *, build: bool = True) -> StanceSets | None:
        """Return the sets of points that limbs may hold at once, see `StanceSets.of`."""
        if self._sets is None:
            self._sets = StanceSets.of(self, progress, build=build)
        return self._sets

    @property
    def searches_sets(self) -> bool:
        """Whether searches without a node table use stance sets.

        With four limbs these take longer to compute than a search gains by them.
        """
        return self.limbs == 3

    def _check_releases(self, stances: StanceArrays, todo: IntArray) -> None:
        """Compute releases, see `CheckedSteps`, and store them."""
        new = []
        todo = todo[~stances.releases["known"][todo[:, 0], todo[:, 1]]]
        for row, limb in todo.tolist():
            key = (stances.points[row].tobytes() + stances.base[row].tobytes(), limb)
            found = self._releases.get(key)
            if found is None:
                new.append((row, limb, key))
            else:
                stances.releases[row, limb] = found
        unknown = np.array([k[:2] for k in new], dtype=np.int64).reshape(-1, 2)
        if self.obstacles:
            self._check_releases_among_obstacles(stances, unknown, [key for *_, key in new])
        else:
            super()._check_releases(stances, unknown)
        rows, limbs = unknown.T
        stances.releases["branches"][rows, limbs] &= stances.branch_sets[rows, limbs]
        for row, limb, key in new:
            self._releases[key] = stances.releases[row, limb].copy()

    def _check_releases_among_obstacles(
        self, stances: StanceArrays, todo: IntArray, keys: list[tuple[bytes, int]]
    ) -> None:
        """Compute releases among obstacles, each with its key.

        The motion by which a limb is released is chosen without obstacles, which only remove
        branches from it: so obstacles never add a step. It is kept for other obstacles.
        """
        known = self._free_releases
        if len(known) > MOST_RELEASES:
            known.clear()
        new = [k for k, key in enumerate(keys) if key not in known]
        if new:
            for k, release in zip(new, self._released_freely(stances, todo[new]), strict=True):
                known[keys[k]] = release.copy()
        for (row, limb), key in zip(todo.tolist(), keys, strict=True):
            stances.releases[row, limb] = known[key]
        every = stances._replace(branch_sets=np.full_like(stances.branch_sets, ALL))
        self.checks.release(every, todo, self.checks.world(self.obstacle_grid, obstacles_only=True))

    def _released_freely(self, stances: StanceArrays, todo: IntArray) -> Any:
        """Return releases without obstacles, rows of `ReleaseRecord`, shape (k,).

        Branches on which the table says that a limb cannot be released need no check, and if it can
        reach one fold at most, its motion is known.
        """
        rows, limbs = todo.T
        chosen, place = np.unique(rows, return_inverse=True)
        free = StanceArrays(*(one[place] for one in self._free_stances(stances, chosen)))
        releases, items = free.releases, np.arange(len(rows))
        is_known = releases["known"][items, limbs]
        able, folds = releases["branches"][items, limbs], releases["folds"][items, limbs]
        free.branch_sets[items[is_known], limbs[is_known]] = able[is_known]
        fold = np.bitwise_count(np.maximum(folds, 1) - 1)
        releases["root"][items, limbs], releases["via"][items, limbs] = fold, fold[:, None]
        one_fold = is_known & (np.bitwise_count(folds) <= 1)
        checked = np.stack([items, limbs], axis=1)[~one_fold]
        self.checks.release(free, checked, self.checks.world(None))
        return releases[items, limbs]

    def _free_stances(self, stances: StanceArrays, rows: IntArray) -> StanceArrays:
        """Return some stances as they are without obstacles, with releases that the table knows."""
        points, base = stances.points[rows], stances.base[rows]
        position, rotation = base["position"], base["rotation"]
        if self.table is None:
            found, given = self.solver.solve(points, nodes_only=True), np.zeros(len(rows), np.bool_)
            free = self.checks.stances(points, found)
        else:
            known, relabellings = self.table.find(points, self.robot)
            free = node_stances(self.grasp_map, self.robot, self.table, known, -relabellings)
            given = known < 0
        given |= (abs(free.base["position"] - position) > SAME).any(axis=1)
        given |= (abs(free.base["rotation"] - rotation) > SAME).any(axis=(1, 2))
        if given.any():
            where = points[given], position[given], rotation[given]
            free.branch_sets[given] = self.solver.at(*where, thresholds=(0.0, 0.0)).branch_sets
            free.releases["known"][given] = False
        return free._replace(points=points, base=base)

    def _obstacles_changed(self, added: tuple[Box, ...] | None) -> None:
        self._releases = {}

    def neighbouring_nodes(
        self, stance: tuple[int, ...], pieces: Pieces = at_once
    ) -> tuple[IntArray, Postures]:
        """Return the neighbouring nodes of a stance, see `StanceGraph.neighbouring_nodes`."""
        self.check_stance(stance)
        stances = self._neighbouring(stance, range(self.limbs))
        found = [self.nodes(stances[piece]) for piece in pieces("postures", len(stances))]
        postures = join(self.nodes(stances[:0]), *found)
        node = self.is_node(postures)
        return stances[node], postures.take(node)

    def successors(self, state: State) -> Successors:
        """Return all steps that leave a state; see `StanceGraph.successors`.

        For a node of the table only the steps that it allows are checked.
        """
        self.check(state)
        is_occupied = not self.occupied.isdisjoint(state.stance)
        if self.table is None or state.pose is not None or self.obstacles or is_occupied:
            return super().successors(state)
        (row,), (relabelling,) = (
            one.tolist() for one in self.table.find(np.array([state.stance]), self.robot)
        )
        if row < 0:
            return super().successors(state)
        moves = candidate_steps(self.table, row, -relabelling)
        rows, relabellings = np.append(row, moves.rows), np.append(-relabelling, moves.relabellings)
        stances = node_stances(self.grasp_map, self.robot, self.table, rows, relabellings)
        after = np.arange(1, len(rows))
        vacant = ~np.isin(stances.points[after], list(self.occupied)).any(axis=1)
        limb, after = moves.limb[vacant], after[vacant]
        steps = self.checks.steps(stances, np.zeros_like(after), after)
        before = np.tile(np.array(state.branch_sets, dtype=np.int64), (len(after), 1))
        found = self.branch_sets_of_steps(steps, stances, before)
        kept = found.all(axis=1)
        limb, after = limb[kept], after[kept]
        return Successors(
            limb, stances.points[after, limb], stances.base["position"][after], found[kept]
        )

    def neighbours(self, state: State, posture: Postures) -> IntArray:
        """Return the stances one step from a state by limbs that can be released, (k, N).

        Neither their postures nor the steps to them are checked.
        """
        able = [
            limb
            for limb in range(self.limbs)
            if not self.settings.transitions
            or can_release(
                state.branch_sets[limb], self.releasable_branches(state.stance, posture, limb)
            )
        ]
        return self._neighbouring(state.stance, able)

    def _neighbouring(self, stance: tuple[int, ...], limbs: Iterable[int]) -> IntArray:
        """Return the stances after moves of some limbs to points that their others allow, (k, N).

        Stances that are no nodes by the table, or by the sets of points, are omitted.
        """
        after = [np.zeros((0, self.limbs), dtype=np.int64)]
        for limb in limbs:
            others = [point for i, point in enumerate(stance) if i != limb]
            able = np.flatnonzero(self.compatible[others].all(axis=0))
            able = able[able != stance[limb]]
            after.append(np.tile(np.array(stance, dtype=np.int64), (len(able), 1)))
            after[-1][:, limb] = able
        stances = np.concatenate(after)
        if self.table is not None:
            kept = self.table.find(stances, self.robot)[0] >= 0
        else:
            sets = self.sets(build=False) if self.searches_sets else None
            kept = np.full(len(stances), True) if sets is None else sets.find(stances) >= 0
        return np.asarray(stances[kept])

    def likely_base(self, stances: IntArray) -> Array:
        """Return a likely base position at stances, shape (k, N) -> (k, 3) [m].

        It lies above the centroid of the grasps at the mean height; the posture may have another.
        """
        positions, normals = self.grasp_map.positions[stances], self.grasp_map.normals[stances]
        height = float(np.mean(self.robot.heights))
        likely: Array = positions.mean(axis=1) + height * normals.mean(axis=1)
        return likely

    @property
    def max_displacement(self) -> float:
        """An upper bound of the base displacement of one step [m].

        The supports stay where they are, and each is within reach of the base before and after.
        Also the centroid of the grasps moves at most `2 span / N`, and the base is at most the
        largest height from it.
        """
        robot = self.robot
        height = max(max(map(abs, robot.heights)), max(OPPOSED_HEIGHTS))
        by_reach = 2.0 * robot.reach
        return min(by_reach, 2.0 * robot.span / self.limbs + 2.0 * height)
