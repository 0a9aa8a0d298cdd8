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

import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.planners.move_bounds import MoveBounds
from mlivr_gym.planners.outcome import (
    GOAL_REACHED,
    LIMIT_REACHED,
    SEARCH_EXHAUSTED,
    Improvement,
    SearchResult,
    path_indices,
    search_tree,
)
from mlivr_gym.planners.query import SearchQuery
from mlivr_gym.planners.queues import Block, Entry, OpenQueue
from mlivr_gym.planners.set_bounds import SetBounds
from mlivr_gym.postures.postures import Postures
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

COST_TOLERANCE = 1e-9
"""Relative tolerance within which costs are equal."""


@dataclass
class ImplicitSearchResult:
    """Result of a search: the expanded states with their parents, costs and postures.

    Attributes
    ----------
    status
        `GOAL_REACHED`, `SEARCH_EXHAUSTED` or `LIMIT_REACHED`.
    goal
        Index of the state at the end of the best plan, or of the last expanded state.
    bound
        Optimality bound of the plan.
    """

    status: str = SEARCH_EXHAUSTED
    states: list[State] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    postures: list[Postures] = field(default_factory=list)
    generated: int = 1
    goal: int = -1
    bound: float = np.inf
    improvements: list[Improvement] = field(default_factory=list)


def search_implicit_graph(
    graph: ImplicitGraph, start: State, search: SearchQuery
) -> SearchResult | None:
    """Search from a state to the goal; return None if no sequence of moves leads there."""
    result = _ImplicitSearch(graph, start, search).run()
    if not result.states:
        return None
    position = np.concatenate([p.base_position for p in result.postures])
    states = tuple(result.states[k] for k in path_indices(result.parents, result.goal))
    counts, tree = (len(result.states), result.generated), search_tree(position, result.parents)
    return SearchResult(
        result.status, states, result.costs[result.goal], *counts, tree,
        bound=result.bound, improvements=tuple(result.improvements),
    )  # fmt: skip


class _ImplicitSearch:
    """A search in progress, with its open queues and its expanded states."""

    def __init__(self, graph: ImplicitGraph, start: State, search: SearchQuery) -> None:
        self.graph, self.search, self.start_time = graph, search, search.start_time
        self.start, self.goal, self.cost = start, search.goal, search.goal.cost
        self.max_displacement = graph.max_displacement
        self.result, self.iteration = ImplicitSearchResult(), 0
        self.by_lower_bound, self.by_estimate, self.inflated = OpenQueue(), OpenQueue(), OpenQueue()
        self.closed: dict[tuple[int, ...], list[tuple[tuple[int, ...], float]]] = {}
        """Branch sets and costs with which each stance was expanded."""
        self.fully_expanded: dict[tuple[int, ...], float] = {}
        """Minimum cost with which each stance was expanded with all its branches."""

    @cached_property
    def moves(self) -> MoveBounds | SetBounds:
        """Lower bounds of the steps to the goal."""
        graph, goal, sets = self.graph, self.goal, self.graph.sets(build=False)
        return MoveBounds(graph, goal) if sets is None else SetBounds(graph, sets, goal)

    def _push_start(self) -> None:
        """Push the start into the queues."""
        start, first = self.start, self.graph.posture_of(self.start)
        entry = Entry(start.stance, -1, 0.0, 0.0, 0.0, first, start)
        if start.pose is None:  # from a given pose limbs may reach farther
            stance = np.array([start.stance])
            entry.lower_bound = float(
                self._lower_bounds(stance, first.base_position, np.zeros(1))[0]
            )
        self._push(entry)

    def _record_state(self, state: State, posture: Postures, parent: int, cost: float) -> None:
        """Record an expanded state."""
        result = self.result
        result.states.append(state)
        result.parents.append(parent)
        result.costs.append(cost)
        result.postures.append(posture)

    def _record_goal(self) -> None:
        """Record that the state expanded last is at the goal."""
        result = self.result
        result.goal = len(result.states) - 1
        elapsed = time.perf_counter() - self.start_time
        result.improvements.append(Improvement(elapsed, result.costs[-1], self._optimality_bound()))

    def run(self) -> ImplicitSearchResult:
        """Process items of the queues until a plan is proved good enough or a limit is reached."""
        result = self.result
        self._push_start()
        while self._continues():
            queue = self._next_queue()
            item = queue.pop()
            if item is None:
                break
            if isinstance(item, Block):
                self._compute_postures(self._block_batch(queue, item))
            elif item.state is None:
                self._check_steps(self._entry_batch(queue, item))
            else:
                self._expand(item)
        if result.goal < 0:
            result.goal = len(result.states) - 1
        else:
            result.status, result.bound = GOAL_REACHED, self._optimality_bound()
        return result

    @property
    def best(self) -> float:
        """Cost of the best plan so far, infinite if there is none."""
        return self.result.costs[self.result.goal] if self.result.goal >= 0 else np.inf

    def _optimality_bound(self) -> float:
        """Return the factor of the minimum within which the best plan is proved."""
        top = self.by_lower_bound.top()
        lower_bound = min(self.best, top.lower_bound if top is not None else np.inf)
        if self.best <= lower_bound * (1.0 + COST_TOLERANCE):
            return 1.0
        return self.best / lower_bound if lower_bound > 0.0 else np.inf

    def _continues(self) -> bool:
        """Return whether to continue the search."""
        search, result = self.search, self.result
        if result.goal >= 0 and self._optimality_bound() <= search.inflation:
            return False
        late = time.perf_counter() > search.deadline
        if result.states and (late or len(result.states) >= search.limit):
            result.status = LIMIT_REACHED
            return False
        return True

    def _next_queue(self) -> OpenQueue:
        """Return the queue from which the next item is taken, see the module."""
        self.iteration += 1
        if not self.search.anytime:
            return self.by_lower_bound if self.search.inflation == 1.0 else self.by_estimate
        if self.result.goal >= 0 and self.iteration % PROOF_INTERVAL == 0:
            return self.by_lower_bound
        return self.inflated if self.iteration % 2 else self.by_estimate

    def _entry_batch(self, queue: OpenQueue, first: Entry) -> list[Entry]:
        """Return an entry and those after it whose steps are not checked either."""
        batch, entry = [], first
        while True:
            if self._may_improve(entry):
                batch.append(entry)
            after = queue.top()
            if not isinstance(after, Entry) or after.state is not None or len(batch) == STEP_BATCH:
                return batch
            queue.pop()
            entry = after

    def _block_batch(self, queue: OpenQueue, first: Block) -> list[tuple[int, float, IntArray]]:
        """Return parent, cost and next stances of a block, and of the blocks after it."""
        blocks, count, block = [], 0, first
        while True:
            if block.lower_bound < self.best * (1.0 - COST_TOLERANCE):
                some = block.stances[block.version : block.version + BLOCK_BATCH]
                blocks.append((block.parent, block.cost, some))
                block.version += len(some)
                count += len(some)
                if not block.done:
                    self._push(block)
            else:
                block.version = len(block.stances)
            after = queue.top()
            if not isinstance(after, Block) or count >= POSTURE_BATCH:
                return blocks
            queue.pop()
            block = after

    def _may_improve(self, entry: Entry) -> bool:
        """Return whether an entry may lead to a better plan; otherwise drop it."""
        is_known = self.fully_expanded.get(entry.stance, np.inf) <= entry.cost
        if is_known or entry.lower_bound >= self.best * (1.0 - COST_TOLERANCE):
            entry.done = True
        return not entry.done

    def _push(self, item: Block | Entry) -> None:
        """Push an item into the queues."""
        lower_bound = item.lower_bound
        self.by_lower_bound.push(lower_bound, item)
        self.by_estimate.push(item.estimate, item)
        if self.search.anytime:
            self.inflated.push(item.cost + COST_TO_GO_INFLATION * (lower_bound - item.cost), item)

    def _lower_bounds(self, stances: IntArray, positions: Array, costs: Array) -> Array:
        """Return lower bounds of plans through stances with known base positions, shape (k,)."""
        goal, cost = self.goal, self.cost
        if self.search.heuristic == "zero":
            return costs
        distance = np.maximum(goal.distance(positions) - goal.tolerance, 0.0)
        by_distance = cost.step_weight * np.ceil(distance / self.max_displacement - 1e-9)
        lower_bound: Array = costs + cost.base_weight * distance
        lower_bound += np.maximum(self._step_costs(self.moves.steps(stances)), by_distance)
        return lower_bound

    def _step_costs(self, moves: Array) -> Array:
        """Return the charge for numbers of steps, infinite for infinitely many, shape (k,)."""
        charged: Array = np.full(len(moves), np.inf)
        some = np.isfinite(moves)
        charged[some] = self.cost.step_weight * moves[some]
        return charged

    def _estimates(self, stances: IntArray, positions: Array, costs: Array) -> Array:
        """Return the keys of stances in the search for a first plan, shape (k,)."""
        distances = self.goal.distance(positions)
        if self.search.anytime:
            moves = self.moves.steps(stances) if isinstance(self.moves, SetBounds) else None
            return costs + self.cost.inadmissible_estimate(distances, moves)
        return self.search.cost_weight * costs + self.search.estimate(
            distances, self.max_displacement
        )

    def _compute_postures(self, blocks: list[tuple[int, float, IntArray]]) -> None:
        """Compute postures of stances, and push those stances that are nodes."""
        rows = [
            (parent, cost, stance)
            for parent, cost, stances in blocks
            for stance in map(tuple, stances.tolist())
            if self.fully_expanded.get(stance, np.inf) > cost
        ]
        if not rows:
            return
        stances = np.array([stance for *_, stance in rows], dtype=np.int64)
        postures = self.graph.nodes(stances)
        nodes = np.flatnonzero(self.graph.is_node(postures))
        if not len(nodes):
            return
        positions = postures.base_position[nodes]
        before = [self.result.postures[rows[k][0]].base_position[0] for k in nodes]
        shift = np.linalg.norm(positions - np.array(before), axis=1)
        costs = np.array([self.result.costs[rows[k][0]] for k in nodes])
        costs += self.cost.base_weight * shift + self.cost.step_weight
        lower_bound = self._lower_bounds(stances[nodes], positions, costs)
        estimate = self._estimates(stances[nodes], positions, costs)
        for n, k in enumerate(nodes.tolist()):
            parent, _, stance = rows[k]
            figures = float(costs[n]), float(lower_bound[n]), float(estimate[n])
            entry = Entry(stance, parent, *figures, postures.take(np.array([k])))
            if self._may_improve(entry):
                self._push(entry)

    def _check_steps(self, batch: list[Entry]) -> None:
        """Check the steps to stances, and drop stances that cannot be reached by them."""
        if not batch:
            return
        parents, before = np.unique([entry.parent for entry in batch], return_inverse=True)
        branch_sets = self.graph.branch_sets_after(
            [self.result.states[k] for k in parents],
            join(*(self.result.postures[k] for k in parents)),
            before,
            np.array([entry.stance for entry in batch], dtype=np.int64),
            join(*(entry.posture for entry in batch)),
        )
        for entry, after in zip(batch, branch_sets, strict=True):
            entry.done = not after.all()
            if not entry.done:
                entry.state = State(entry.stance, tuple(after.tolist()))
                self._push(entry)

    def _expand(self, entry: Entry) -> None:
        """Record a state, and push its neighbours unless it is at the goal."""
        result, state, posture = self.result, entry.state, entry.posture
        may_improve, entry.done = self._may_improve(entry), True
        if state is None or not may_improve or not self._add_to_closed(state, entry):
            return
        here = len(result.states)
        self._record_state(state, posture, entry.parent, entry.cost)
        if self.goal.reached(posture.base_position[0], state.stance):
            self._record_goal()
            return
        if self.search.progress is not None and here % 20 == 0:
            self.search.progress(here)
        self._push_neighbours(here)

    def _add_to_closed(self, state: State, entry: Entry) -> bool:
        """Record the label of an expanded state; return False if an earlier one dominates it."""
        # A start in a given pose is not the state of its stance.
        seen = self.closed.setdefault(state.stance, []) if state.pose is None else []
        for branch_sets, cost in seen:
            covers = all(
                m & ~old == 0 for m, old in zip(state.branch_sets, branch_sets, strict=True)
            )
            if covers and cost <= entry.cost:
                return False
        seen.append((state.branch_sets, entry.cost))
        every = tuple(entry.posture.branch_sets[0].tolist())
        if state.pose is None and state.branch_sets == every:
            self.fully_expanded[state.stance] = entry.cost
        return True

    def _push_neighbours(self, here: int) -> None:
        """Push the neighbours of an expanded state as a block."""
        graph, goal, cost = self.graph, self.goal, self.cost
        state, posture, so_far = (
            self.result.states[here], self.result.postures[here], self.result.costs[here]
        )  # fmt: skip
        stances = graph.neighbours(state, posture)
        if not len(stances):
            return
        costs = np.full(len(stances), so_far + cost.step_weight)
        lower_bound, likely_base = costs, graph.likely_base(stances)
        if self.search.heuristic != "zero":
            # The base path of a plan through a neighbour is no shorter than the straight line.
            distance = max(float(goal.distance(posture.base_position[0])) - goal.tolerance, 0.0)
            lower_bound = (
                costs + cost.base_weight * distance + self._step_costs(self.moves.steps(stances))
            )
        shift = np.linalg.norm(likely_base - posture.base_position, axis=1)
        estimate = self._estimates(stances, likely_base, costs + cost.base_weight * shift)
        promising = np.flatnonzero(np.isfinite(lower_bound) & (lower_bound < self.best))
        if not len(promising):
            return
        promising = promising[np.argsort(estimate[promising], kind="stable")]
        lower_bounds = np.minimum.accumulate(lower_bound[promising][::-1])[::-1]
        self._push(
            Block(here, float(costs[0]), stances[promising], lower_bounds, estimate[promising])
        )
        self.result.generated += len(promising)
