"""Fewest steps of two limbs over steps that are checked on demand.

As in LazySP (Dellin and Srinivasa 2016) a path of fewest steps is found as if every unchecked step
were possible, unchecked steps are checked, and so on until a path has none: it is optimal. Every
path of fewest steps, and among these of fewest unchecked ones, crosses as many cuts as it has
unchecked steps, see `level_graph`. The steps of the smallest cuts are checked: if all steps of a
cut fail, every plan has more steps, or more of them are unchecked. So steps are checked where the
module is hard to pass, and along one path elsewhere. `docs/mathematics.md` has the proof.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.planners.level_graph import (
    LARGEST_CUT,
    Cuts,
    Levels,
    Origins,
    compute_remaining,
    find_cuts,
    find_path,
    unchecked_from_origins,
)
from mlivr_gym.planners.path_search import PathSearch, StatePath
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.stances.two_limb_rows import connected_parts
from mlivr_gym.transitions.rule import kept_on_edge
from mlivr_gym.transitions.state import State

CUT_RATIO, SMALL_CUT = 4, 128
"""Cuts are checked together that have at most this many times the steps of the smallest one, or
this many steps."""


class LevelSearch(PathSearch):
    """A search for the fewest steps of two limbs, whose steps are not all known."""

    graph: TwoLimbGraph

    def __init__(self, graph: TwoLimbGraph, search: SearchQuery, start: State) -> None:
        """Prepare a search from a state."""
        super().__init__(graph, search, start)
        is_goal = self.goal.reached(graph.base_position, graph.points)
        self._goals, self._levels = np.flatnonzero(is_goal), Levels.allocate(is_goal)
        self._explored: list[IntArray] = []
        self._path_failed = False
        self._set_origins()

    @staticmethod
    def answers(graph: object, search: SearchQuery) -> bool:
        """Return whether a query is one for the fewest steps of two limbs with unknown steps.

        Among obstacles few steps of a complete table are to be checked, for which `table_search` is
        quicker.
        """
        unknown = isinstance(graph, TwoLimbGraph) and not graph.is_complete_without_obstacles
        return unknown and search.heuristic == "relaxed" and not search.goal.cost.base_weight

    def _set_origins(self) -> None:
        """Set the states at which paths over stances of the graph may start."""
        states, self._first_steps = [self.start], 0
        if self.start.pose is not None:
            # Steps that leave a given base pose are no edges of the graph.
            steps = self.graph.successors(self.start)
            states = [steps.after(self.start, k) for k in range(len(steps.limb))]
            self._first_steps = 1
        nodes = np.array([self.graph.find(state.stance) for state in states], dtype=np.int64)
        sets = np.array([state.branch_sets for state in states], dtype=np.int64).reshape(-1, 2)
        self._states, self._origins = states, Origins(nodes, sets)
        at_goal = nodes[np.isin(nodes, self._goals)]
        self._origin_at_goal = int(at_goal[0]) if len(at_goal) else -1

    def paths(self) -> Iterator[StatePath]:
        """Yield a path of fewest steps, if there is one."""
        step_weight = self.goal.cost.step_weight
        while not self.is_late and self.expanded < self.search.limit:
            steps = self._fewest_steps()
            self.lower_bound = np.inf if steps < 0 else step_weight * (steps + self._first_steps)
            if steps < 0:
                return
            unchecked, path = self._path(steps)
            releases = self.graph.steps.releases["known"]
            if unchecked == 0 and releases[path[:, 1:]].all():
                self.incumbent_cost = self.lower_bound
                yield self._state_path(path)
                return
            chosen = self._smallest_cuts(steps, unchecked) if unchecked else path
            chosen = chosen if len(chosen) else path
            self._explored.append(chosen)
            kept = self.graph.kept_branches(*chosen.T.copy())
            self._path_failed = chosen is path and not kept.all()

    def _fewest_steps(self) -> int:
        """Return the fewest steps from an origin to the goal, -1 if none lead there."""
        if self._origin_at_goal >= 0:
            return 0
        self._levels.reset()
        found = compute_remaining(self._goals, self.graph.steps, self._origins, self._levels)
        self.backward_expanded += int((self._levels.arrivals > 0).any(axis=1).sum())
        return int(found)

    def _path(self, steps: int) -> tuple[int, IntArray]:
        """Return the unchecked steps of a path of fewest steps, and its steps, shape (D, 3)."""
        path = np.zeros((steps, 3), dtype=np.int64)
        if steps == 0:
            return 0, path
        table, origins, levels = self.graph.steps, self._origins, self._levels
        unchecked = unchecked_from_origins(steps, table, origins, levels)
        find_path(unchecked, table, origins, levels, path)
        return int(unchecked), path

    def _smallest_cuts(self, steps: int, unchecked: int) -> IntArray:
        """Return the steps of the smallest cuts, none if all are large, shape (k, 3)."""
        cuts = Cuts.allocate(unchecked)
        table, origins, levels = self.graph.steps, self._origins, self._levels
        self.expanded += int(find_cuts(steps, table, origins, levels, cuts))
        self.generated += int(cuts.sizes.sum())
        largest = min(max(SMALL_CUT, CUT_RATIO * int(cuts.sizes.min())), LARGEST_CUT)
        some = np.flatnonzero(cuts.sizes <= largest)
        if not len(some) and self._path_failed:
            return np.asarray(cuts.steps[cuts.sizes.argmin()])
        listed = [cuts.steps[k, : cuts.sizes[k]] for k in some]
        return np.concatenate([np.zeros((0, 3), dtype=np.int64), *listed])

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
