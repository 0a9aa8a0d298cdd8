"""Edge table of two limbs, filled on demand."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.queries import CheckedPostures
from mlivr_gym.stances.two_limb_rows import StanceRows
from mlivr_gym.stances.two_limb_steps import TwoLimbEdge, TwoLimbTable, edge_indices
from mlivr_gym.transitions.records import StanceArrays
from mlivr_gym.transitions.step_check import StepChecks


class TwoLimbEdges:
    """Releases computed and edges checked in one state of the world.

    Attributes
    ----------
    stances
        The stances, with their releases.
    table
        The steps.
    close
        Stances that may touch an obstacle on a step from or to them, shape (n,).
    unchecked
        Stances of which some branches may touch an obstacle themselves, shape (n,).
    """

    is_complete: bool
    """Whether every step is known."""

    def __init__(
        self,
        checks: StepChecks,
        stances: StanceArrays,
        rows: StanceRows,
        base: Array,
        edges: Any = None,
    ) -> None:
        """Start without steps, or with all of them; base positions have shape (n, 3) [m]."""
        self.checks, settings = checks, checks.solver.settings
        self.collisions, self.stances = settings.collisions, stances
        self.close, self.unchecked = np.zeros((2, len(base)), dtype=np.bool_)
        self._world = checks.world(None)
        count = int((rows.degree**2).sum()) if settings.transitions else 1
        self.is_complete = not settings.transitions or (edges is not None and len(edges) == count)
        if edges is None or len(edges) != count:
            edges = TwoLimbEdge.rows(count)
        self.table = TwoLimbTable(
            settings.transitions,
            stances.points,
            base,
            stances.branch_sets,
            stances.releases,
            rows.rows,
            rows.row_start,
            base[rows.rows],
            rows.degree,
            rows.offset,
            rows.local,
            edges,
        )

    def among_obstacles(
        self,
        branch_sets: IntArray,
        unchecked: BoolArray,
        close: BoolArray,
        obstacles: BoxGrid | None,
    ) -> TwoLimbEdgesAmongObstacles:
        """Return the steps among obstacles and occupied points.

        Branch sets, shape (n, 2), are empty at points that are occupied or touch an obstacle.
        `unchecked` tells of which stances some branches may touch an obstacle, `close` which may
        touch one on a step from or to them, both of shape (n,).
        """
        return TwoLimbEdgesAmongObstacles(self, branch_sets, unchecked, close, obstacles)

    def index(self, support: Any, before: Any, after: Any) -> Any:
        """Return the index of steps, of numbers or arrays; see `two_limb_steps.edge_indices`."""
        return edge_indices(support, before, after, self.table)

    def step(self, support: int, before: int, after: int) -> Any:
        """Return the record of a step, a row of `TwoLimbEdge`; check it unless it is known."""
        self.check_steps(*(np.array([one]) for one in (support, before, after)))
        return self.table.edges[self.index(support, before, after)]

    def check_nodes(self, chosen: slice | IntArray) -> None:
        """Remove the branches of stances that touch obstacles, once."""

    def check_releases(self, todo: IntArray) -> None:
        """Compute releases once, given by stances and limbs, shape (k, 2)."""
        todo = todo[~self.stances.releases["known"][todo[:, 0], todo[:, 1]]]
        if len(todo) > 1:
            todo = np.unique(todo, axis=0)
        self.checks.release(self.stances, todo, self._world)

    def check_steps(self, support: IntArray, before: IntArray, after: IntArray) -> None:
        """Check steps once, given by support limb, stance before and stance after, shape (k,)."""
        support, before, after = self._unknown(support, before, after)
        if not len(support):
            return
        both = np.concatenate([before, after])
        self.check_releases(np.stack([np.repeat(both, 2), np.tile([0, 1], len(both))], axis=1))
        steps = self._steps(support, before, after)
        self.checks.check(steps, self.stances, self._world)
        self._store(support, before, after, steps)

    def _unknown(
        self, support: IntArray, before: IntArray, after: IntArray
    ) -> tuple[IntArray, IntArray, IntArray]:
        """Return the steps that are not known, each once.

        They are always checked from the stance with the lower index, since the swing that is found
        may depend on the direction.
        """
        if self.collisions:
            before, after = np.minimum(before, after), np.maximum(before, after)
        entry = self.index(support, before, after)
        new = np.flatnonzero(self.table.edges["known"][entry] == 0)
        if len(new) > 1:
            new = new[np.unique(entry[new], return_index=True)[1]]
        return support[new], before[new], after[new]

    def _steps(self, support: IntArray, before: IntArray, after: IntArray) -> Any:
        """Return rows of `StepRecord` to be checked."""
        steps, branch_sets = self.checks.steps(len(support)), self.stances.branch_sets
        steps["limb"], steps["before"], steps["after"] = 1 - support, before, after
        positions = self.checks.solver.grasps["point"]
        steps["pivot"] = positions[self.table.points[before, support]]
        steps["branches"][np.arange(len(support)), support] = (
            branch_sets[before, support] & branch_sets[after, support]
        )
        return steps

    def _store(self, support: IntArray, before: IntArray, after: IntArray, steps: Any) -> None:
        """Store the results of steps in both directions."""
        found = TwoLimbEdge.rows(len(support))
        found["known"] = 1
        found["kept"] = steps["kept"][np.arange(len(support)), support]
        found["on_arc"], found["line_branches"] = steps["on_arc"], steps["line_branches"]
        found["fold_on_line"], found["fold_on_arc"] = steps["folds"].T
        self.table.edges[self.index(support, before, after)] = found
        first, last = found["line_branches"] // 8, found["line_branches"] % 8
        found["line_branches"] = np.where(found["line_branches"] < 0, -1, 8 * last + first)
        self.table.edges[self.index(support, after, before)] = found


class TwoLimbEdgesAmongObstacles(TwoLimbEdges):
    """Releases computed and edges checked among obstacles and occupied points.

    Only the motions of the steps without obstacles are checked, and only close to them.
    """

    def __init__(
        self,
        free: TwoLimbEdges,
        branch_sets: IntArray,
        unchecked: BoolArray,
        close: BoolArray,
        obstacles: BoxGrid | None,
    ) -> None:
        """Start from the steps without obstacles, see `TwoLimbEdges.among_obstacles`."""
        self.free, self.close, self.unchecked, self._obstacles = free, close, unchecked, obstacles
        self.checks, self.collisions = free.checks, free.collisions
        self._world = self.checks.world(obstacles, obstacles_only=True)
        # As bytes: NumPy copies records field by field, which takes fourteen times as long.
        releases = free.stances.releases
        releases = releases.view(np.uint8).copy().view(releases.dtype)
        gone = ~branch_sets.any(axis=1)
        releases["branches"][gone] = 0
        releases["known"][gone] = True
        releases["known"][close & ~gone] = False
        self.stances = free.stances._replace(branch_sets=branch_sets, releases=releases)
        # If no obstacle is close, only the branch sets differ.
        edges = TwoLimbEdge.rows(len(free.table.edges)) if close.any() else free.table.edges
        self.is_complete = free.is_complete and edges is free.table.edges
        self.table = free.table._replace(branch_sets=branch_sets, releases=releases, edges=edges)
        no_branch, no_cause = np.full_like(branch_sets, -1), np.zeros(len(close), dtype=np.int64)
        self._postures = CheckedPostures(
            free.table.points, free.stances.base, no_branch, branch_sets, no_cause, np.array([True])
        )

    def check_nodes(self, chosen: slice | IntArray) -> None:
        """Remove the branches of stances that touch obstacles, once."""
        if isinstance(chosen, slice):
            rows = np.arange(len(self.unchecked))[chosen]
        else:
            rows = np.unique(chosen)
        rows = rows[self.unchecked[rows]]
        if len(rows) and self._obstacles is not None:
            self.unchecked[rows] = False
            self.checks.solver.remove_touching(rows, self._postures, self._obstacles)

    def check_releases(self, todo: IntArray) -> None:
        """Compute releases once, given by stances and limbs, shape (k, 2)."""
        todo = todo[~self.stances.releases["known"][todo[:, 0], todo[:, 1]]]
        if len(todo):
            self._check_releases(np.unique(todo, axis=0))

    def _check_releases(self, todo: IntArray) -> None:
        """Compute releases that are not known, each once."""
        releases, branch_sets = self.stances.releases, self.stances.branch_sets
        self.free.check_releases(todo)
        s, limb = todo.T
        self.check_nodes(s)
        releases[s, limb] = self.free.stances.releases[s, limb]
        blocked = branch_sets[s, 1 - limb] == 0
        releases["branches"][s[blocked], limb[blocked]] = 0
        close = todo[self.close[s] & ~blocked]
        self.checks.release(self.stances, close, self._world)

    def check_steps(self, support: IntArray, before: IntArray, after: IntArray) -> None:
        """Check steps once, given by support limb, stance before and stance after, shape (k,)."""
        if self.table.edges is self.free.table.edges:
            self.free.check_steps(support, before, after)
            both = np.concatenate([before, after])
            self.check_releases(np.stack([np.repeat(both, 2), np.tile([0, 1], len(both))], axis=1))
            return
        support, before, after = self._unknown(support, before, after)
        if not len(support):
            return
        self.free.check_steps(support, before, after)
        both = np.concatenate([before, after])
        self.check_releases(np.stack([np.repeat(both, 2), np.tile([0, 1], len(both))], axis=1))
        self.check_nodes(both)
        steps = self._steps(support, before, after)
        known = self.free.table.edges[self.index(support, before, after)]
        branches = self.stances.releases["branches"]
        able = (branches[before, 1 - support] != 0) & (branches[after, 1 - support] != 0)
        rows = np.arange(len(support))
        steps["recheck"] = True
        steps["kept"][rows, support] = np.where(
            able, known["kept"] & steps["branches"][rows, support], 0
        )
        steps["on_arc"], steps["line_branches"] = known["on_arc"], known["line_branches"]
        steps["folds"][:, 0], steps["folds"][:, 1] = known["fold_on_line"], known["fold_on_arc"]
        close = self.close[before] | self.close[after]
        checked = steps[close]
        self.checks.check(checked, self.stances, self._world)
        steps[close] = checked
        steps["on_arc"] &= steps["kept"][rows, support]
        self._store(support, before, after, steps)
