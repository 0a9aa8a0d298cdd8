"""Best-first search over an implicit graph, for any number of limbs.

A stance of three or four limbs has hundreds of neighbours, few of which are nodes, and most of the
time goes into postures and step checks. So a neighbour is evaluated in three parts, each when it
comes first in an open queue, as in Lazy Weighted A* (Cohen, Phillips and Likhachev 2014): first its
points alone are known, in a block with the other neighbours of its parent; then its posture is
computed; then the edge to it is checked, which makes it a state. Neighbours with
the same part to be evaluated form batches.

Every item has a lower bound of the cost of plans through it, by the triangle inequality and
`set_bounds`, or `move_bounds` if there are no stance sets. The minimum over the open queue bounds
the cost of every plan, which gives the optimality bound. A search for an optimal plan takes
items by their lower bound, a weighted or greedy one by `f = cost_weight * g + h`. An anytime search
alternates two queues (Helmert 2006): one by an inadmissible estimate, which may lead into local
minima, and one by the lower bound with the cost-to-go inflated, which leads out of them; once there
is a plan every fifth item is taken by its lower bound, to raise the proved bound. If a graph has a
table of nodes, `table_search` is used instead.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.planners.move_bounds import MoveBounds
from mlivr_gym.planners.path_search import COST_TOLERANCE, EDGE_EFFORT, PathSearch, StatePath
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.planners.queues import Block, Entry, OpenQueue
from mlivr_gym.planners.set_bounds import SetBounds
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.transitions.state import State

POSTURE_BATCH, BLOCK_BATCH, STEP_BATCH = 128, 8, 32
"""Maximum number of stances whose postures are computed in one batch, of those from one block, and
of steps checked in one batch."""

COST_TO_GO_INFLATION = 2.0
"""Factor on the cost-to-go in the queue that leads out of local minima."""

PROOF_INTERVAL = 5
"""Once there is a plan, one of this many items is taken by its lower bound, to prove the plan
good."""

PROGRESS_INTERVAL = 20
"""Number of expansions between two reports of progress."""


class ImplicitSearch(PathSearch):
    """A search over an implicit graph."""

    graph: ImplicitGraph

    def __init__(self, graph: ImplicitGraph, search: SearchQuery, start: State) -> None:
        """Prepare a search from a state."""
        super().__init__(graph, search, start)
        self.max_displacement, self.generated, self._taken = graph.max_displacement, 1, 0
        self._by_lower_bound, self._by_estimate, self._inflated = (OpenQueue() for _ in range(3))
        self._explored: list[Entry] = []
        """Expanded entries, in order."""
        self._labels: dict[tuple[int, ...], list[tuple[tuple[int, ...], float]]] = {}
        """Branch sets and costs with which each stance was expanded."""
        self._fully_expanded: dict[tuple[int, ...], float] = {}
        """Minimum cost with which each stance was expanded with all its branches."""

    @cached_property
    def moves(self) -> MoveBounds | SetBounds:
        """Lower bounds of the steps to the goal."""
        graph, goal = self.graph, self.goal
        sets = graph.sets(build=False) if graph.searches_sets else None
        if sets is None:
            return MoveBounds(graph, goal, self.clock)
        return SetBounds(graph, sets, goal, self.clock)

    def _paths(self) -> Iterator[StatePath]:
        """Yield paths to the goal, each cheaper than the one before, see `PathSearch.paths`."""
        self._push_start()
        while self._continues():
            queue = self._next_queue()
            item = queue.pop()
            if isinstance(item, Block):
                self._compute_postures(queue, item)
            elif isinstance(item, Entry) and not item.checked:
                self._check_steps(queue, item)
            elif isinstance(item, Entry) and self._expand(item):
                self.incumbent_cost, path = item.cost, item.path()
                positions = np.array([entry.position for entry in path])
                yield StatePath(tuple(entry.state for entry in path), positions)

    def is_connected(self) -> bool:
        """Return whether moves may connect the start with the goal, whatever the obstacles are."""
        return self.expanded > 0

    def tree(self) -> Array:
        """Return base positions at both ends of explored edges, shape (e, 2, 3) [m]."""
        ends = [(e.parent.position, e.position) for e in self._explored if e.parent is not None]
        return np.array(ends).reshape(-1, 2, 3)

    def _push_start(self) -> None:
        """Push the start into the queues."""
        start, posture, lower_bound = self.start, self.start_posture, 0.0
        if start.pose is None:  # from a given pose limbs may reach farther
            stance, remaining = np.array([start.stance]), self._remaining(posture.base_position)
            lower_bound = float(self._lower_bounds(stance, remaining, np.zeros(1))[0])
        self._push(Entry(start, None, 0.0, lower_bound, 0.0, posture, checked=True))

    def _continues(self) -> bool:
        """Update the lower bound; return whether to continue the search."""
        first = self._by_lower_bound.top()
        self.lower_bound = np.inf if first is None else first.lower_bound
        if first is None or (
            self.incumbent_cost < np.inf and self.bound() <= self.search.inflation
        ):
            return False
        return not (self.expanded and (self.is_late or self.expanded >= self.search.limit))

    def _next_queue(self) -> OpenQueue:
        """Return the queue from which the next item is taken, see the module."""
        self._taken += 1
        if not self.search.anytime:
            return self._by_lower_bound if self.search.inflation == 1.0 else self._by_estimate
        if self.has_path and self._taken % PROOF_INTERVAL == 0:
            return self._by_lower_bound
        return self._inflated if self._taken % 2 else self._by_estimate

    def _push(self, item: Block | Entry) -> None:
        """Push an item into the queues."""
        lower_bound = item.lower_bound
        self._by_lower_bound.push(lower_bound, item)
        self._by_estimate.push(item.estimate, item)
        if self.search.anytime:
            self._inflated.push(item.cost + COST_TO_GO_INFLATION * (lower_bound - item.cost), item)

    def _may_improve(self, entry: Entry) -> bool:
        """Return whether an entry may lead to a better plan; otherwise drop it."""
        is_known = self._fully_expanded.get(entry.state.stance, np.inf) <= entry.cost
        if is_known or self._is_too_dear(entry):
            entry.done = True
        return not entry.done

    def _is_too_dear(self, item: Block | Entry) -> bool:
        """Return whether no path through an item is cheaper than the incumbent."""
        return item.lower_bound >= self.incumbent_cost * (1.0 - COST_TOLERANCE)

    def _remaining(self, positions: Array) -> Array:
        """Return the distances of base positions from the goal region [m]."""
        return np.maximum(self.goal.distance(positions) - self.goal.tolerance, 0.0)

    def _lower_bounds(
        self, stances: IntArray, remaining: Array, costs: Array, ahead: int = 0
    ) -> Array:
        """Return lower bounds of the cost of plans through stances, shape (k,).

        The base is at a distance from the goal region [m] at some cost so far, and the stances are
        0 or 1 steps ahead of that.
        """
        cost = self.goal.cost
        if self.search.heuristic == "zero":
            return costs + ahead * cost.step_weight
        moves = ahead + self.moves.steps(stances)
        if not ahead:
            moves = np.maximum(moves, np.ceil(remaining / self.max_displacement - 1e-9))
        is_possible = np.isfinite(moves)
        steps = np.where(is_possible, moves, 0.0)
        lower_bounds = costs + cost.base_weight * remaining + cost.step_weight * steps
        return np.where(is_possible, lower_bounds, np.inf)

    def _estimates(self, stances: IntArray, positions: Array, costs: Array) -> Array:
        """Return the keys of stances in the search for a first plan, shape (k,)."""
        distances = self.goal.distance(positions)
        if self.search.anytime:
            moves = self.moves.steps(stances) if isinstance(self.moves, SetBounds) else None
            return costs + self.goal.cost.inadmissible_estimate(distances, moves)
        return self.search.cost_weight * costs + self.search.estimate(
            distances, self.max_displacement
        )

    def _compute_postures(self, queue: OpenQueue, item: Block | Entry | None) -> None:
        """Compute postures of the stances of blocks, and push those stances that are nodes."""
        parents: list[Entry] = []
        stances: list[tuple[int, ...]] = []
        taken = 0
        while isinstance(item, Block):
            if self._is_too_dear(item):
                item.take(len(item.stances))
            else:
                some = item.take(BLOCK_BATCH).tolist()
                taken += len(some)
                if not item.done:
                    self._push(item)
                for stance in map(tuple, some):
                    if self._fully_expanded.get(stance, np.inf) > item.cost:
                        parents.append(item.parent)
                        stances.append(stance)
            item = queue.pop(item.stage) if taken < POSTURE_BATCH else None
        if not stances:
            return
        rows = np.array(stances, dtype=np.int64)
        self.check_effort += EDGE_EFFORT * len(rows)  # a posture counts as an edge
        pieces = self.clock.pieces("postures", len(rows))
        postures = join(*[self.graph.nodes(rows[piece]) for piece in pieces])
        nodes = np.flatnonzero(self.graph.is_node(postures))
        if not len(nodes):
            return
        positions, cost = postures.base_position[nodes], self.goal.cost
        before = np.array([parents[k].position for k in nodes])
        costs = np.array([parents[k].cost for k in nodes])
        costs += cost.base_weight * np.linalg.norm(positions - before, axis=1) + cost.step_weight
        lower_bounds = self._lower_bounds(rows[nodes], self._remaining(positions), costs)
        keys = costs, lower_bounds, self._estimates(rows[nodes], positions, costs)
        for k, g, f, key in zip(nodes.tolist(), *(one.tolist() for one in keys), strict=True):
            state = State(stances[k], tuple(postures.branch_sets[k].tolist()))
            entry = Entry(state, parents[k], g, f, key, postures.take(np.array([k])))
            if self._may_improve(entry):
                self._push(entry)

    def _check_steps(self, queue: OpenQueue, item: Block | Entry | None) -> None:
        """Check the steps to stances, and drop stances that cannot be reached by them."""
        batch: list[Entry] = []
        while isinstance(item, Entry):
            if self._may_improve(item):
                batch.append(item)
            item = queue.pop(item.stage) if len(batch) < STEP_BATCH else None
        if not batch:
            return
        self.check_effort += EDGE_EFFORT * len(batch)
        pieces = self.clock.pieces("edges", len(batch))
        branch_sets = np.concatenate([self._branch_sets_after(batch[piece]) for piece in pieces])
        for entry, after in zip(batch, branch_sets, strict=True):
            entry.done = not after.all()
            if not entry.done:
                entry.state, entry.checked = State(entry.state.stance, tuple(after.tolist())), True
                self._push(entry)

    def _branch_sets_after(self, batch: list[Entry]) -> IntArray:
        """Check the steps to stances; return the branch sets after them, shape (k, N)."""
        parents = list(dict.fromkeys(entry.parent for entry in batch if entry.parent is not None))
        found: IntArray = self.graph.branch_sets_after(
            [parent.state for parent in parents],
            join(*(parent.posture for parent in parents)),
            np.array([parents.index(entry.parent) for entry in batch if entry.parent is not None]),
            np.array([entry.state.stance for entry in batch], dtype=np.int64),
            join(*(entry.posture for entry in batch)),
        )
        return found

    def _expand(self, entry: Entry) -> bool:
        """Expand an entry unless it is dominated; return whether it is at the goal."""
        may_improve, entry.done = self._may_improve(entry), True
        if not may_improve or self._is_dominated(entry):
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
        lower_bounds = self._lower_bounds(stances, self._remaining(position), so_far, 1)
        shift = np.linalg.norm(likely_base - position, axis=1)
        costs = so_far + cost.step_weight
        estimates = self._estimates(stances, likely_base, costs + cost.base_weight * shift)
        promising = np.flatnonzero(np.isfinite(lower_bounds) & (lower_bounds < self.incumbent_cost))
        if not len(promising):
            return
        promising = promising[np.argsort(estimates[promising], kind="stable")]
        least = np.minimum.accumulate(lower_bounds[promising][::-1])[::-1]
        self._push(Block(entry, float(costs[0]), stances[promising], least, estimates[promising]))
        self.generated += len(promising)
