"""Best-first search over an implicit graph, for any number of limbs.

A stance of three or four limbs has hundreds of neighbours, few of which are nodes, and most of the
time goes into postures and step checks. So a neighbour is evaluated in three parts, each when it
comes first in the open queue, as in Lazy Weighted A* (Cohen, Phillips and Likhachev 2014): first
its points alone are known, in a block with the other neighbours of its parent; then its posture is
computed; then the edge to it is checked, which makes it a state. Neighbours with the same part to
be evaluated form batches.

A search for an optimal plan takes items by their lower bound, a weighted or greedy one by
`f = cost_weight * g + h`, an anytime search by an inadmissible estimate. An item is dropped if its
lower bound proves the incumbent good enough. So in whatever order items are taken, the least lower
bound of those that wait or were dropped bounds the cost of every plan not found yet, which gives
the optimality bound. If a graph has a table of nodes, `table_search` is used instead.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.planners.clock import OutOfTime
from mlivr_gym.planners.costs import moved_points
from mlivr_gym.planners.path_search import COST_TOLERANCE, PathSearch, StatePath
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.present_table import EDGE_EFFORT
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

BLOCK_BATCH = 8
"""Maximum number of stances whose postures are computed at once of those from one block."""

BATCHES = 16, 32, 1
"""Maximum number of items in one batch, by their stage."""

PROGRESS_INTERVAL = 20
"""Number of expansions between two reports of progress."""


@dataclass(slots=True, eq=False)
class Entry:
    """A stance with a known posture, once expanded a node of the search tree."""

    state: State
    """Its state, with all branches of its posture until the step to it is checked."""
    parent: Entry | None
    """The expanded entry before it, None at the start."""
    cost: float
    """Cost so far."""
    lower_bound: float
    """Lower bound of the cost of plans through it."""
    key: float
    """Key by which the open queue is ordered."""
    posture: Postures
    """Its posture."""
    checked: bool = False
    """Whether the step to it was checked."""

    @property
    def position(self) -> Array:
        """Base position [m], shape (3,)."""
        position: Array = self.posture.base_position[0]
        return position

    @property
    def stage(self) -> int:
        """Number of its parts that are known: 1 before the step to it is checked, 2 after."""
        return 1 + self.checked

    def path(self) -> list[Entry]:
        """Return the entries from the start to it."""
        entries = [self]
        while entries[-1].parent is not None:
            entries.append(entries[-1].parent)
        return entries[::-1]


@dataclass(slots=True, eq=False)
class Block:
    """Neighbours of an expanded state, in order of key, of which only the points are known."""

    parent: Entry
    """The expanded entry."""
    cost: float
    """Lower bound of the cost so far at each of them."""
    stances: IntArray
    """Their points, shape (k, N)."""
    lower_bounds: Array
    """Lower bounds of the cost of plans through each of them and all after it, shape (k,)."""
    keys: Array
    """Keys by which the open queue is ordered, shape (k,)."""
    stage: ClassVar[int] = 0

    @property
    def lower_bound(self) -> float:
        """Lower bound of the cost of plans through any of them."""
        return float(self.lower_bounds[0])

    @property
    def key(self) -> float:
        """Key of the first."""
        return float(self.keys[0])

    def part(self, some: slice) -> Block:
        """Return some of them."""
        bounds, keys = self.lower_bounds[some], self.keys[some]
        return Block(self.parent, self.cost, self.stances[some], bounds, keys)


class ImplicitSearch(PathSearch):
    """A search over an implicit graph."""

    graph: StanceGraph

    def __init__(self, graph: StanceGraph, search: SearchQuery, start: State) -> None:
        """Prepare a search from a state."""
        super().__init__(graph, search, start)
        self.max_displacement, self.generated = graph.max_displacement, 1
        self._open: list[tuple[float, float, int, Block | Entry]] = []
        """The open queue, a heap; ties go to the larger cost so far."""
        self._pushed = 0
        self._dropped = np.inf
        """Least lower bound of the items that were dropped since the incumbent is good enough."""
        self._explored: list[Entry] = []
        """Expanded entries, in order."""
        self._labels: dict[tuple[int, ...], list[tuple[tuple[int, ...], float]]] = {}
        """Branch sets and costs with which each stance was expanded."""
        self._fully_expanded: dict[tuple[int, ...], float] = {}
        """Minimum cost with which each stance was expanded with all its branches."""

    def _paths(self) -> Iterator[StatePath]:
        """Yield paths to the goal, each cheaper than the one before, see `PathSearch.paths`."""
        self._push_start()
        while self._open and not (
            self.expanded and (self.is_late or self.expanded >= self.search.limit)
        ):
            batch = self._next_batch()
            try:
                reached = self._evaluate(batch)
            except OutOfTime:
                for item in batch:
                    self._push(item)
                self._update_lower_bound()
                raise
            if reached is not None:
                self.incumbent_cost, path = reached.cost, reached.path()
                self._update_lower_bound()
                positions = np.array([entry.position for entry in path])
                yield StatePath(tuple(entry.state for entry in path), positions)
        self._update_lower_bound()

    def _update_lower_bound(self) -> None:
        """Update the lower bound of all plans that are not found yet."""
        waiting = min((item.lower_bound for *_, item in self._open), default=np.inf)
        self.lower_bound = min(waiting, self._dropped)

    def _next_batch(self) -> list[Block | Entry]:
        """Take the first items of the open queue that have the same part to be evaluated."""
        batch: list[Block | Entry] = []
        stage = self._open[0][-1].stage
        while self._open and self._open[0][-1].stage == stage and len(batch) < BATCHES[stage]:
            item = heapq.heappop(self._open)[-1]
            if isinstance(item, Block) and len(item.stances) > BLOCK_BATCH:
                self._push(item.part(slice(BLOCK_BATCH, None)))
                item = item.part(slice(BLOCK_BATCH))
            batch.append(item)
        return batch

    def _evaluate(self, batch: list[Block | Entry]) -> Entry | None:
        """Evaluate the next part of some items; return the entry at the goal, if it is one."""
        kept = [item for item in batch if self._may_improve(item)]
        blocks = [item for item in kept if isinstance(item, Block)]
        entries = [item for item in kept if isinstance(item, Entry)]
        if blocks:
            self._compute_postures(blocks)
        elif entries and not entries[0].checked:
            self._check_steps(entries)
        elif entries and self._expand(entries[0]):
            return entries[0]
        return None

    def is_connected(self) -> bool:
        """Return whether moves may connect the start with the goal, whatever the obstacles are."""
        return self.expanded > 0

    def tree(self) -> Array:
        """Return base positions at both ends of explored edges, shape (e, 2, 3) [m]."""
        ends = [(e.parent.position, e.position) for e in self._explored if e.parent is not None]
        return np.array(ends).reshape(-1, 2, 3)

    def _push_start(self) -> None:
        """Push the start into the queue."""
        start, posture, lower_bound = self.start, self.start_posture, 0.0
        if start.pose is None:  # from a given pose limbs may reach farther
            remaining = self._remaining(posture.base_position)
            lower_bound = float(self._lower_bounds(remaining, np.zeros(1))[0])
        if self._is_goal_in_reach():
            self._push(Entry(start, None, 0.0, lower_bound, 0.0, posture, checked=True))

    def _is_goal_in_reach(self) -> bool:
        """Return whether there are points for all limbs from which a base can be at the goal."""
        grasp_map, robot, goal = self.graph.grasp_map, self.graph.robot, self.goal
        at_goal = goal.distance(grasp_map.positions) <= robot.reach + goal.tolerance + 1e-9
        if goal.on_face is not None:
            at_goal &= goal.on_face
        return int(at_goal.sum()) >= robot.limbs

    def _push(self, item: Block | Entry) -> None:
        """Push an item into the queue."""
        self._pushed += 1
        heapq.heappush(self._open, (item.key, -item.cost, self._pushed, item))

    def _may_improve(self, item: Block | Entry) -> bool:
        """Return whether an item may lead to a better plan than required."""
        if isinstance(item, Entry):
            least = self._fully_expanded.get(item.state.stance, np.inf)
            if least <= item.cost:
                return False
        required = self.incumbent_cost
        if self.has_path:
            required *= (1.0 - COST_TOLERANCE) / self.search.inflation
        if item.lower_bound >= required:
            self._dropped = min(self._dropped, item.lower_bound)
            return False
        return True

    def _remaining(self, positions: Array) -> Array:
        """Return the distances of base positions from the goal region [m]."""
        return np.maximum(self.goal.distance(positions) - self.goal.tolerance, 0.0)

    def _lower_bounds(self, remaining: Array, costs: Array, ahead: int = 0) -> Array:
        """Return lower bounds of the cost of plans through stances, shape (k,).

        The base is at a distance from the goal region [m] at some cost so far, and the stances are
        0 or 1 steps ahead of that.
        """
        cost = self.goal.cost
        if self.search.heuristic == "zero":
            return costs + ahead * cost.step_weight
        steps = np.maximum(np.ceil(remaining / self.max_displacement - 1e-9), ahead)
        lower_bounds: Array = costs + cost.base_weight * remaining + cost.step_weight * steps
        return lower_bounds

    def _keys(self, positions: Array, costs: Array, lower_bounds: Array) -> Array:
        """Return the keys of stances in the open queue, shape (k,)."""
        distances = self.goal.distance(positions)
        if self.search.anytime:
            return costs + self.goal.cost.inadmissible_estimate(distances)
        if self.search.inflation == 1.0:
            return lower_bounds
        return self.search.cost_weight * costs + self.search.estimate(
            distances, self.max_displacement
        )

    def _compute_postures(self, blocks: list[Block]) -> None:
        """Compute postures of the stances of blocks, and push those that are nodes."""
        parents: list[Entry] = []
        stances: list[tuple[int, ...]] = []
        for block in blocks:
            for stance in map(tuple, block.stances.tolist()):
                if self._fully_expanded.get(stance, np.inf) > block.cost:
                    parents.append(block.parent)
                    stances.append(stance)
        rows = np.array(stances, dtype=np.int64).reshape(-1, self.graph.limbs)
        self.check_effort += EDGE_EFFORT * len(rows)  # a posture counts as an edge
        pieces = self.clock.pieces("postures", len(rows))
        found = [self.graph.nodes(rows[piece]) for piece in pieces]
        if not found:
            return
        postures = join(*found)
        nodes = np.flatnonzero(self.graph.is_node(postures))
        positions, cost = postures.base_position[nodes], self.goal.cost
        before = np.array([parents[k].position for k in nodes]).reshape(-1, 3)
        costs = np.array([parents[k].cost for k in nodes])
        shift = np.linalg.norm(positions - before, axis=1)
        held = np.array([parents[k].state.stance for k in nodes]).reshape(-1, self.graph.limbs)
        costs += cost.of_steps(shift, rows[nodes], moved_points(held, rows[nodes]))
        lower_bounds = self._lower_bounds(self._remaining(positions), costs)
        keys = costs, lower_bounds, self._keys(positions, costs, lower_bounds)
        for k, g, f, key in zip(nodes.tolist(), *(one.tolist() for one in keys), strict=True):
            state = State(stances[k], tuple(postures.branch_sets[k].tolist()))
            entry = Entry(state, parents[k], g, f, key, postures.take(np.array([k])))
            if self._may_improve(entry):
                self._push(entry)

    def _check_steps(self, batch: list[Entry]) -> None:
        """Check the steps to stances, and push the stances that can be reached by them."""
        self.check_effort += EDGE_EFFORT * len(batch)
        pieces = self.clock.pieces("edges", len(batch))
        branch_sets = np.concatenate([self._branch_sets_after(batch[piece]) for piece in pieces])
        for entry, after in zip(batch, branch_sets, strict=True):
            if after.all():
                entry.state, entry.checked = State(entry.state.stance, tuple(after.tolist())), True
                self._push(entry)

    def _branch_sets_after(self, batch: list[Entry]) -> IntArray:
        """Check the steps to stances; return the branch sets after them, shape (k, N)."""
        parents = list(dict.fromkeys(entry.parent for entry in batch if entry.parent is not None))
        branch_sets: IntArray = self.graph.branch_sets_after(
            [parent.state for parent in parents],
            join(*(parent.posture for parent in parents)),
            np.array([parents.index(entry.parent) for entry in batch if entry.parent is not None]),
            np.array([entry.state.stance for entry in batch], dtype=np.int64),
            join(*(entry.posture for entry in batch)),
        )
        return branch_sets

    def _expand(self, entry: Entry) -> bool:
        """Expand an entry unless it is dominated; return whether it is at the goal."""
        if self._is_dominated(entry):
            return False
        self._explored.append(entry)
        progress = self.search.progress
        if progress is not None and self.expanded % PROGRESS_INTERVAL == 0:
            progress(self.expanded)
        self.expanded += 1
        if self.goal.reached(entry.position, entry.state.stance):
            return True
        self._push_neighbours(entry)
        return False

    def _is_dominated(self, entry: Entry) -> bool:
        """Return whether an expanded label of a stance dominates that of an entry, else add it."""
        state, cost = entry.state, entry.cost
        if state.pose is not None:
            return False  # a start in a given pose is not the state of its stance
        labels = self._labels.setdefault(state.stance, [])
        for branch_sets, least in labels:
            pairs = zip(state.branch_sets, branch_sets, strict=True)
            if least <= cost and all(one & ~other == 0 for one, other in pairs):
                return True
        labels.append((state.branch_sets, cost))
        if state.branch_sets == tuple(entry.posture.branch_sets[0].tolist()):
            self._fully_expanded[state.stance] = cost
        return False

    def _push_neighbours(self, entry: Entry) -> None:
        """Push the neighbours of an expanded entry as a block."""
        graph, cost, position = self.graph, self.goal.cost, entry.position
        stances = graph.neighbours(entry.state, entry.posture)
        if not len(stances):
            return
        likely_base, so_far = graph.likely_base(stances), np.full(len(stances), entry.cost)
        # The base path of a plan through a neighbour is no shorter than the straight line.
        lower_bounds = self._lower_bounds(self._remaining(position), so_far, 1)
        shift = np.linalg.norm(likely_base - position, axis=1)
        costs = so_far + cost.step_weight
        likely_costs = costs + cost.base_weight * shift
        keys = self._keys(likely_base, likely_costs, lower_bounds)
        promising = np.flatnonzero(lower_bounds < self.incumbent_cost)
        if not len(promising):
            return
        promising = promising[np.argsort(keys[promising], kind="stable")]
        least = np.minimum.accumulate(lower_bounds[promising][::-1])[::-1]
        self._push(Block(entry, float(costs[0]), stances[promising], least, keys[promising]))
        self.generated += len(promising)
