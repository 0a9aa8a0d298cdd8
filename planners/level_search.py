"""Fewest steps of two limbs over steps that are checked on demand.

As in LazySP (Dellin and Srinivasa 2016) a path of fewest steps is found as if every unchecked step
were possible, its unchecked steps are checked, and so on until a path has none: it is optimal.
Where steps of a path fail, some others of the smallest cut are checked as well, a cut being the
steps after which as many remain. If all of them fail, every plan has more steps. So steps are
checked where the module is hard to pass, and along few paths elsewhere. Whenever the fewest steps
rise, the search is repeated with start and goal exchanged: stances for which the sum of the steps
from the start and to the goal exceeds them are on no path as short, and are left out until they
rise again. `docs/mathematics.md` has the proof.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.planners.level_graph import ARRIVAL, Levels, Origins, compute_remaining
from mlivr_gym.planners.level_paths import LARGEST_CUT, Cuts, find_cuts, find_path
from mlivr_gym.planners.path_search import EDGE_EFFORT, PathSearch, StatePath
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.stances.two_limb_rows import connected_parts
from mlivr_gym.stances.two_limb_steps import TwoLimbTable, edge_indices
from mlivr_gym.transitions.rule import kept_on_edge
from mlivr_gym.transitions.state import State

LEAST_ALTERNATIVES = 48
"""Maximum number of steps of a cut that are checked at once, if few stances are left."""

STANCES_PER_ALTERNATIVE = 256
"""Number of stances left for each of them, if many are: on a large map it takes longer to search
again than to check more steps."""


class LevelSearch(PathSearch):
    """A search for the fewest steps of two limbs, whose steps are not all known."""

    graph: TwoLimbGraph

    def __init__(self, graph: TwoLimbGraph, search: SearchQuery, start: State) -> None:
        """Prepare a search from a state."""
        super().__init__(graph, search, start)
        is_goal = self.goal.reached(graph.base_position, graph.points)
        self._goals = np.flatnonzero(is_goal)
        self._levels = Levels.allocate(is_goal, graph.steps)
        if graph.steps.releases["known"].any():
            self._levels.is_checked[...] = _with_known_steps(graph.steps)
        self._explored: list[IntArray] = []
        self._fewest, self._too_far = -1, np.zeros_like(is_goal)
        self._from_start: IntArray = np.zeros(len(is_goal), dtype=np.int64)
        self._set_origins()

    @staticmethod
    def answers(graph: object, search: SearchQuery) -> bool:
        """Return whether a query is one for the fewest steps of two limbs with unknown steps.

        Among obstacles few steps of a complete table are to be checked, for which `table_search` is
        quicker.
        """
        unknown = isinstance(graph, TwoLimbGraph) and not graph.is_complete_without_obstacles
        return unknown and search.heuristic == "relaxed" and search.goal.cost.counts_steps

    def _set_origins(self) -> None:
        """Set the states at which paths over stances of the graph may start."""
        states, self._first_steps = [self.start], 0
        if self.start.pose is not None:
            # Steps that leave a given base pose are no edges of the graph.
            steps = self.graph.successors_by_pieces(self.start, self.clock.pieces)
            states = [steps.after(self.start, k) for k in range(len(steps.limb))]
            self._first_steps = 1
        nodes = np.array([self.graph.find(state.stance) for state in states], dtype=np.int64)
        sets = np.array([state.branch_sets for state in states], dtype=np.int64).reshape(-1, 2)
        self._states, self._branch_sets = states, sets
        self._origins = Origins(nodes, np.zeros_like(sets))
        at_goal = nodes[np.isin(nodes, self._goals)]
        self._origin_at_goal = int(at_goal[0]) if len(at_goal) else -1

    def _paths(self) -> Iterator[StatePath]:
        """Yield a path of fewest steps, if there is one."""
        step_weight = self.goal.cost.step_weight
        while not self.is_late and self.expanded < self.search.limit:
            steps = self._fewest_steps()
            self.lower_bound = np.inf if steps < 0 else step_weight * (steps + self._first_steps)
            if steps < 0:
                return
            path: IntArray = np.zeros((steps, 4), dtype=np.int64)
            unchecked = (
                find_path(self.graph.steps, self._origins, self._levels, path) if steps else 0
            )
            is_known, moving = self.graph.steps.releases["known"], 1 - path[:, :1]
            if unchecked == 0 and is_known[path[:, 1:3], moving].all():
                self.incumbent_cost = self.lower_bound
                yield self._state_path(path[:, :3])
                return
            self.expanded += steps
            failed = self._check(path[:, :3]) & path[:, 3] == 0
            if failed.any():
                self._check(self._alternatives(failed[::-1]))

    def _update(self) -> None:
        """Update what is known of releases, and where paths start."""
        table, nodes, releasable = self.graph.steps, self._origins.nodes, self._levels.releasable
        known, branches = table.releases["known"], table.releases["branches"]
        releasable[...] = table.branch_sets
        releasable[...] &= np.where(known, branches, ALL)
        can_move = self._branch_sets & releasable[nodes] != 0
        self._origins.supports[...] = np.where(can_move[:, ::-1], self._branch_sets, 0)

    def _check(self, steps: IntArray) -> IntArray:
        """Check steps, shape (k, 3); return the branches that their support limbs keep."""
        support, before, after = steps.T.copy()
        self._explored.append(steps)
        self.check_effort += EDGE_EFFORT * len(steps)
        for s in (before, after):
            self._levels.is_checked[s, support] = True
        pieces = self.clock.pieces("edges", len(steps))
        kept = [self.graph.kept_branches(support[k], before[k], after[k]) for k in pieces]
        return np.concatenate([np.zeros(0, dtype=np.int64), *kept])

    def _fewest_steps(self) -> int:
        """Return the fewest steps from an origin to the goal, -1 if none lead there."""
        if self._origin_at_goal >= 0:
            return 0
        steps = self._steps_to_goal()
        if 0 <= steps == self._fewest:
            self._too_far |= self._levels_of_stances(steps) + self._from_start > steps
            return steps
        if self._too_far.any():
            self._too_far[...] = False
            steps = self._steps_to_goal()
        self._fewest = steps
        if steps < 0:
            return -1
        to_goal = self._levels_of_stances(steps)
        self._from_start = self._steps_from_start()
        self._too_far = to_goal + self._from_start > steps
        return self._steps_to_goal()

    def _steps_to_goal(self) -> int:
        """Return the fewest steps through stances that are not too far, -1 if none lead there."""
        self._update()
        self._levels.releasable[self._too_far] = 0
        found = compute_remaining(self._goals, self.graph.steps, self._origins, self._levels)
        self.backward_expanded += int((self._levels.reached[ARRIVAL] > 0).any(axis=1).sum())
        return int(found)

    def _steps_from_start(self) -> IntArray:
        """Return lower bounds of the steps from the origins to each stance, shape (n,).

        A step keeps the same branches in both directions, so they are found by the same search.
        """
        table, is_origin = self.graph.steps, np.zeros_like(self._levels.is_goal)
        is_origin[self._origins.nodes] = True
        can_move = self._levels.releasable[self._goals] != 0
        supports = np.where(can_move[:, ::-1], table.branch_sets[self._goals], 0)
        steps = compute_remaining(
            np.flatnonzero(is_origin), table, Origins(self._goals, supports),
            self._levels._replace(is_goal=is_origin),
        )  # fmt: skip
        return self._levels_of_stances(int(steps))

    def _levels_of_stances(self, last: int) -> IntArray:
        """Return the first level on which each stance was reached, else the one after the last."""
        log, level = self._levels.log, np.full(len(self._too_far), last + 1)
        start = log.start[: last + 2]
        each = np.repeat(np.arange(last + 1), np.diff(start))
        level[log.stances[: start[-1]][::-1]] = each[::-1]
        return level

    def _alternatives(self, failed: BoolArray) -> IntArray:
        """Return some of the smallest cut of those in which steps of a path failed, shape (k, 3).

        Which failed is given by the steps that remain after them, shape (D,). Steps on paths with
        few unchecked steps come first, and of those the short ones.
        """
        cuts, position = Cuts.allocate(np.append(False, failed)), self.graph.base_position
        self.expanded += int(find_cuts(self.graph.steps, self._origins, self._levels, cuts))
        self.generated += int(cuts.size.sum())
        smallest = np.where(cuts.size, cuts.size, LARGEST_CUT + 1).argmin()
        steps = cuts.steps[smallest, : cuts.size[smallest]]
        moved = np.linalg.norm(position[steps[:, 1]] - position[steps[:, 2]], axis=1)
        count = np.count_nonzero(~self._too_far) // STANCES_PER_ALTERNATIVE
        first = np.lexsort((moved, steps[:, 3]))[: max(count, LEAST_ALTERNATIVES)]
        return np.asarray(steps[first, :3])

    def _state_path(self, path: IntArray) -> StatePath:
        """Return the states of a path whose steps and releases are known."""
        graph, first = self.graph, path[0, 1] if len(path) else self._origin_at_goal
        k = int(np.flatnonzero(self._origins.nodes == first)[0])
        states = [self._states[k]]
        for support, before, after in path.tolist():
            sets = [0, 0]
            kept = graph.kept_branches(support, before, np.array([after]))[0]
            sets[support] = int(kept_on_edge(states[-1].branch_sets[support], int(kept)))
            sets[1 - support] = int(graph.releasable[after, 1 - support])
            states.append(State(tuple(graph.points[after].tolist()), tuple(sets)))
        nodes = np.append(first, path[:, 2])
        positions = graph.base_position[nodes]
        if self._first_steps:
            states = [self.start, *states]
            positions = np.concatenate([self.start_posture.base_position, positions])
        return StatePath(tuple(states), positions)

    def is_connected(self) -> bool:
        """Return whether moves may connect the start with the goal, whatever the obstacles are."""
        if self.start.pose is not None:
            return bool(len(self._goals))
        _, part = connected_parts(self.graph.points, len(self.graph.grasp_map))
        return bool(np.isin(part[self._origins.nodes], part[self._goals]).any())

    def tree(self) -> Array:
        """Return base positions at both ends of the steps that were checked, (e, 2, 3) [m]."""
        checked = np.concatenate([np.zeros((0, 3), dtype=np.int64), *self._explored])
        return np.asarray(self.graph.base_position[checked[:, 1:]])


def _with_known_steps(table: TwoLimbTable) -> BoolArray:
    """Return of which stances steps of each support limb are known, shape (n, 2)."""
    found = np.zeros(table.points.shape, dtype=np.bool_)
    for support, rows in enumerate(table.rows):
        first = edge_indices(support, rows, rows, table) - table.local[support, rows]
        end = first[-1] + table.degree[support, table.points[rows[-1], support]]
        found[rows, support] = np.logical_or.reduceat(table.edges["known"][:end], first)
    return found
