"""Edge table of two limbs, filled on demand."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.collisions.queries import CheckedPostures
from mlivr_gym.stances.two_limb_rows import table_of_rows
from mlivr_gym.stances.two_limb_steps import TwoLimbEdge, edge_indices
from mlivr_gym.transitions.records import StanceArrays, StepRecord
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
        self, checks: StepChecks, stances: StanceArrays, m: int, edges: Any = None
    ) -> None:
        """Start on m points without steps, or with all of them."""
        self.checks, settings = checks, checks.solver.settings
        self.collisions, self.stances = settings.collisions, stances
        self.close, self.unchecked = np.zeros((2, len(stances.points)), dtype=np.bool_)
        self.free, self._world = self, checks.world(None)
        self._stored: list[IntArray] = []
        self.table = table_of_rows(stances, m, settings.transitions, edges)
        self.is_complete = not settings.transitions or self.table.edges is edges

    def index(self, support: Any, before: Any, after: Any) -> Any:
        """Return the index of steps, of numbers or arrays; see `two_limb_steps.edge_indices`."""
        return edge_indices(support, before, after, self.table)

    @property
    def checked(self) -> IntArray:
        """Edges that were checked among obstacles: stances before and after, and index, (3, k)."""
        return np.concatenate([np.zeros((3, 0), dtype=np.int64), *self._stored], axis=1)

    @property
    def blocked(self) -> IntArray:
        """Indices of those of them that are no steps, shape (k,)."""
        *_, index = self.checked
        return np.asarray(index[self.table.edges["kept"][index] == 0])

    @cached_property
    def edges_among_obstacles(self) -> Any:
        """Edges among the present obstacles; to copy them all takes longer than to plan."""
        return _as_bounds(self.table.edges)

    def check_nodes(self, chosen: slice | IntArray) -> None:
        """Remove the branches of stances that touch obstacles, once."""

    def check_releases(self, todo: IntArray) -> None:
        """Compute releases once, given by stances and limbs, shape (k, 2)."""
        todo = todo[~self.stances.releases["known"][todo[:, 0], todo[:, 1]]]
        if len(todo):
            self._release(np.stack(np.divmod(np.unique(2 * todo[:, 0] + todo[:, 1]), 2), axis=1))

    def _release(self, todo: IntArray) -> None:
        """Compute releases that are not known, each once."""
        self.checks.release(self.stances, todo, self._world)

    def check_steps(self, support: IntArray, before: IntArray, after: IntArray) -> None:
        """Check steps once, given by support limb, stance before and stance after, shape (k,)."""
        support, before, after = self._unknown(support, before, after)
        if not len(support):
            return
        both, moving = np.concatenate([before, after]), np.tile(1 - support, 2)
        self.check_releases(np.stack([both, moving], axis=1))
        steps = self._steps(support, before, after)
        self.checks.check(steps, self.stances, self._world)
        self._store(support, before, after, _edges_of(steps, support))

    def look(self, support: IntArray, before: IntArray, after: IntArray) -> IntArray:
        """Return the branches that steps keep at most, by what is quick to see, shape (k,)."""
        self.check_steps(support, before, after)
        index = self.index(support, before, after)
        return np.asarray(self.table.edges["kept"][index], dtype=np.int64)

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
        """Return rows of `StepRecord` to be checked, in half the time of `StepChecks.steps`."""
        steps = StepRecord.rows(len(support))
        steps["limb"], steps["before"], steps["after"] = 1 - support, before, after
        return steps

    def _store(self, support: IntArray, before: IntArray, after: IntArray, found: Any) -> IntArray:
        """Store results of steps, rows of `TwoLimbEdge`, both ways; return the indices, (2, k)."""
        there, back = self.index(support, before, after), self.index(support, after, before)
        self.table.edges[there] = found
        self.table.edges[back] = found
        return np.stack([there, back])


class TwoLimbEdgesAmongObstacles(TwoLimbEdges):
    """Releases computed and edges checked among obstacles and occupied points.

    Only releases and steps that are possible without obstacles are checked, and only close to them.
    If all motions of a release that was known before the last obstacles are clear of these, too, it
    is as before; else it is checked among all.
    """

    def __init__(
        self, before: TwoLimbEdges, gone: BoolArray, touching: BoolArray, close: BoolArray,
        obstacles: BoxGrid | None, added: BoxGrid,
    ) -> None:  # fmt: skip
        """Start from what was found before some obstacles and occupied points were added.

        Which stances hold a point that is occupied or touches an obstacle is `gone`, of which some
        branches may touch a new obstacle themselves `touching`, and which may touch one on a step
        from or to them `close`, each of shape (n,). The added obstacles are among the `obstacles`.
        """
        self.free = free = before.free
        self.close, self.unchecked = before.close | close, before.unchecked | touching
        self.checks, self.collisions = free.checks, free.collisions
        self._obstacles, self._world = obstacles, self.checks.world(obstacles, obstacles_only=True)
        branch_sets = before.table.branch_sets.copy()
        branch_sets[gone] = 0
        self._added = self.checks.world(added, obstacles_only=True)
        self._before = before.stances.releases
        self._added_alone = before is free and added is obstacles
        # As bytes: NumPy copies records field by field, which takes fourteen times as long.
        kind = free.stances.releases.dtype
        source = free if close.all() else before
        releases = source.stances.releases.view(np.uint8).copy()
        if source is not free:
            releases[close] = free.stances.releases.view(np.uint8)[close]
        releases = releases.view(kind)
        releases["branches"][gone] = 0
        releases["known"][gone] = True
        releases["known"][close & ~gone] = False
        self.stances = free.stances._replace(branch_sets=branch_sets, releases=releases)
        self.is_complete = free.is_complete and not self.close.any()
        edges = free.table.edges if self.is_complete else free.edges_among_obstacles
        self.table = free.table._replace(branch_sets=branch_sets, releases=releases, edges=edges)
        self._stored = free._stored
        if self._stored:
            self._forget(close if before.table.edges is edges else np.ones_like(close))
        no_branch, no_cause = np.full_like(branch_sets, -1), np.zeros(len(close), dtype=np.int64)
        self._postures = CheckedPostures(
            free.table.points, free.stances.base, no_branch, branch_sets, no_cause, np.array([True])
        )

    def _forget(self, close: BoolArray) -> None:
        """Forget the edges that may touch new obstacles, from or to stances that may, (n,)."""
        before, after, index = self.checked
        gone = close[before] | close[after]
        self._stored[:] = [self.checked[:, ~gone]]
        forgotten = index[gone]
        bounds = _as_bounds(self.free.table.edges[forgotten])
        self.free.edges_among_obstacles[forgotten] = bounds

    def _store(self, support: IntArray, before: IntArray, after: IntArray, found: Any) -> IntArray:
        """Store the results of steps, and which they are; see `TwoLimbEdges`."""
        index = super()._store(support, before, after, found)
        stored = np.stack([[before, after], [after, before], index])
        self._stored.append(stored.reshape(3, -1))
        return index

    def check_nodes(self, chosen: slice | IntArray) -> None:
        """Remove the branches of stances that touch obstacles, once."""
        if isinstance(chosen, slice):
            chosen = np.arange(len(self.unchecked))[chosen]
        rows = chosen[self.unchecked[chosen]]
        if len(rows) and self._obstacles is not None:
            rows = np.unique(rows)
            self.unchecked[rows] = False
            self.checks.solver.remove_touching(rows, self._postures, self._obstacles)

    def _release(self, todo: IntArray) -> None:
        """Compute releases that are not known, each once."""
        releases, branch_sets = self.stances.releases, self.stances.branch_sets
        self.free.check_releases(todo)
        s, limb = todo.T
        self.check_nodes(s)
        releases[s, limb] = self.free.stances.releases[s, limb]
        blocked = branch_sets[s, 1 - limb] == 0
        releases["branches"][s[blocked], limb[blocked]] = 0
        super()._release(self._changed_releases(todo[self.close[s] & ~blocked]))

    def look(self, support: IntArray, before: IntArray, after: IntArray) -> IntArray:
        """Return the branches that steps keep at most, see `TwoLimbEdges`."""
        if not self.free.is_complete:
            return super().look(support, before, after)
        self.check_nodes(np.concatenate([before, after]))
        edges: IntArray = self.free.table.edges["kept"]
        kept: IntArray = edges[self.index(support, before, after)].astype(np.int64)
        close = np.flatnonzero((self.close[before] | self.close[after]) & (kept != 0))
        rows, support = np.arange(len(close)), support[close]
        steps = self._steps(support, before[close], after[close])
        steps["kept"][rows, support] = kept[close]
        self.checks.look(steps, self.stances, self._world)
        kept[close] = steps["kept"][rows, support]
        return kept

    def _changed_releases(self, todo: IntArray) -> IntArray:
        """Return those releases that are not as before the last obstacles, or were unknown, (k, 2).

        The others are filled in.
        """
        releases, before = self.stances.releases, self._before[todo[:, 0], todo[:, 1]]
        known = before["known"]
        s, limb = todo[known].T
        without = releases[s, limb]
        releases[s, limb] = before[known]
        self.checks.release(self.stances, todo[known], self._added)
        if self._added_alone:  # what was found so is what is found among all obstacles
            return np.asarray(todo[~known])
        differs = _differ(releases[s, limb], before[known])
        releases[s[differs], limb[differs]] = without[differs]
        known[known] = ~differs
        return np.asarray(todo[~known])

    def check_steps(self, support: IntArray, before: IntArray, after: IntArray) -> None:
        """Check steps once, given by support limb, stance before and stance after, shape (k,)."""
        support, before, after = self._unknown(support, before, after)
        if not len(support):
            return
        if not self.free.is_complete:
            self.free.check_steps(support, before, after)
        self.check_nodes(np.concatenate([before, after]))
        sets, moving, releases = self.stances.branch_sets, 1 - support, self.stances.releases
        found = self.free.table.edges[self.index(support, before, after)]
        found["kept"] &= (sets[before, support] & sets[after, support]).astype(np.uint16)
        free, able = found.copy(), np.flatnonzero((found["kept"] != 0) & (sets[after, moving] != 0))
        found["kept"] = 0
        # Most steps fail, so what takes less time is checked first; until the release at the end of
        # a step is computed, it is taken to be that without obstacles.
        able = able[self._released(before[able], moving[able])[0] != 0]
        if not self.free.is_complete:
            ends = after[able], moving[able]
            unknown = tuple(one[~releases["known"][ends]] for one in ends)
            releases[unknown] = self.free.stances.releases[unknown]
            releases["known"][unknown] = False
        for _ in range(2):
            steps = support[able], before[able], after[able]
            found[able] = self._among(*steps, free[able])
            able = able[found["kept"][able] != 0]
            ends = after[able], moving[able]
            assumed = releases["branches"][ends], releases["folds"][ends]
            now = self._released(*ends)
            able = able[(now[0] != assumed[0]) | (now[1] != assumed[1])]
        self._store(support, before, after, found)

    def _released(self, s: IntArray, limb: IntArray) -> tuple[IntArray, IntArray]:
        """Return the branches and folds of releases, which are computed once, shape (k,)."""
        self.check_releases(np.stack([s, limb], axis=1))
        releases = self.stances.releases
        return releases["branches"][s, limb], releases["folds"][s, limb]

    def _among(self, support: IntArray, before: IntArray, after: IntArray, stored: Any) -> Any:
        """Return the edges of steps among the obstacles of a world, rows of `TwoLimbEdge`, (k,).

        Known without them are those that are `stored`. The releases are those known so far.
        """
        found, kept = stored.copy(), stored["kept"]
        close = np.flatnonzero(self.close[before] | self.close[after])
        support = support[close]
        steps = self._steps(support, before[close], after[close])
        self.checks.check(steps, self.stances, self.checks.world(self._obstacles))
        found[close] = _edges_of(steps, support)
        found["kept"] &= kept
        return found


def _edges_of(steps: Any, support: IntArray) -> Any:
    """Return the edges of checked steps, rows of `TwoLimbEdge`, shape (k,)."""
    found = TwoLimbEdge.rows(len(steps))
    found["known"], found["kept"] = 1, steps["kept"][np.arange(len(steps)), support]
    return found


def _as_bounds(edges: Any) -> Any:
    """Return edges without obstacles as upper bounds among them, rows of `TwoLimbEdge`.

    Those that are no steps are known to be none.
    """
    # As bytes: NumPy copies records field by field, which takes longer.
    bounds = edges.view(np.uint8).copy().view(edges.dtype)
    bounds["known"] &= bounds["kept"] == 0
    return bounds


def _differ(releases: Any, others: Any) -> BoolArray:
    """Return which releases differ in branches or folds, rows of `ReleaseRecord`, shape (k,)."""
    branches = releases["branches"] != others["branches"]
    return np.asarray(branches | (releases["folds"] != others["folds"]))
