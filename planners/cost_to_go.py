"""Exact cost-to-go tables: the oracle and expert of the two-limb robot.

With steps checked the cost to the goal depends on the branches the limbs are on. Moving limb j
while limb i holds on branch b depends on b alone, so the table holds `U[s, i, b]`: the least cost
from stance s when limb i holds on b and the other limb moves next. One search backward from the
goal fills all of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import EMPTY, has, only
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.planners.pair_search import (
    EXHAUSTED,
    FOUND,
    LIMIT,
    NO_ROOM,
    UNKNOWN_STEP,
    Progress,
    Weights,
    weights_of,
)
from mlivr_gym.planners.query import Goal
from mlivr_gym.planners.queue import Queue, first, grown, has_room, pop, push, queue
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.pair_steps import PairTable, branches_kept, edge_index, releasable
from mlivr_gym.transitions.rule import can_release, kept_on_edge
from mlivr_gym.transitions.state import State, Successors

FLIPS = 16
"""Number of branches with flips."""


class Backward(NamedTuple):
    """What a search backward knows of each stance and limb that holds, shape (n, 2, ...)."""

    value: Array
    """`U` by branch and flip, shape (n, 2, 16); inf where it is not known."""
    best: Array
    """Least cost found by branch and flip, shape (n, 2, 16)."""
    holding: IntArray
    """Branches expanded with which the limb holds and the other moves next, shape (n, 2)."""
    grasped: IntArray
    """Branches expanded with which the other limb has just grasped, shape (n, 2)."""


def backward(
    graph: PairGraph,
    goal: BoolArray,
    weights: Weights,
    start: int = -1,
    toward: Array | None = None,
) -> tuple[Array, float, bool]:
    """Fill the table by best-first search backward from the goal stances.

    Args:
        graph: The stance graph; steps that the search wants to know are checked.
        goal: Which stances are goals, shape (n,).
        weights: What is minimised, and the most entries to take from the queue.
        start: Stance at which to stop, or -1 to go on to the end.
        toward: Consistent lower bound of the cost from the start to each stance, shape (n,).

    Returns:
        U by stance, limb that holds, and branch and flip, shape (n, 2, 16), inf where the goal
        cannot be reached; lower bound of cost and `toward` together over all states that were not
        expanded; and whether it got to the start.
    """
    n, progress, entries = len(goal), Progress.row(), queue(1 << 16)
    toward = np.zeros(n) if toward is None else toward
    costs = (np.full((n, 2, FLIPS), np.inf) for _ in range(2))
    known = Backward(*costs, *(np.zeros((n, 2), dtype=np.int64) for _ in range(2)))
    while True:
        status = int(_backward(goal, start, toward, weights, graph.steps, known, entries, progress))
        if status == UNKNOWN_STEP:
            graph.know_step(*(int(progress[name]) for name in ("held", "before", "after")))
        elif status == NO_ROOM:
            entries = grown(entries)
        else:
            bound = np.inf if status == EXHAUSTED else float(entries.f[first_entry(entries)])
            return known.value, bound, status == FOUND


def first_entry(entries: Queue) -> int:
    """The entry at which a search stopped."""
    return int(entries.heap[0])


@entry
def _backward(
    goal: BoolArray,
    start: int,
    toward: Array,
    weights: Weights,
    table: PairTable,
    known: Backward,
    entries: Queue,
    progress: Progress,
) -> int:
    """Go on with a search until it ends or stops for a while, see `backward`.

    An entry's node is `4 * stance + 2 * limb + kind`. Kind 0: the limb holds on a branch of `bits`
    and the other moves next, to the stance `link`. Kind 1: the other limb has just grasped: either
    may move next.
    """
    if not progress.seeded:
        if not has_room(entries, 2 * len(goal)):
            return NO_ROOM
        progress.seeded = True
        for s in range(len(goal)):
            if goal[s] and table.mask[s, 0]:
                for held in range(2):
                    node = 4 * s + 2 * held + 1
                    push(entries, toward[s], 0.0, 0.0, node, -1, table.mask[s, held])
    while entries.filled.size > 0:
        item = first(entries)
        s, held = entries.node[item] // 4, entries.node[item] // 2 % 2
        grasped = entries.node[item] % 2 == 1
        new, done = entries.bits[item], known.grasped if grasped else known.holding
        new &= ~done[s, held]
        if new == 0:
            pop(entries)
            continue
        if progress.expanded >= weights.limit:
            return LIMIT
        if not grasped and table.check:
            edge = table.edges[edge_index(held, s, entries.link[item], table)]
            if not edge.known:
                progress.held, progress.before, progress.after = held, s, entries.link[item]
                return UNKNOWN_STEP
        first_time = False
        if not has_room(entries, 2 + table.degree[held, table.points[s, held]]):
            return NO_ROOM
        progress.expanded += 1
        if grasped:
            pop(entries)
            known.grasped[s, held] |= new
            _hold_before(s, held, new, entries.cost[item], toward, weights, table, (known, entries))
            continue
        if table.check:
            edge = table.edges[edge_index(held, s, entries.link[item], table)]
            new = kept_on_edge(new, branches_kept(edge))
        if new:
            first_time = _note(s, held, new, entries.cost[item], table, known)
            if s == start:
                return FOUND
        pop(entries)
        if new:
            _grasp_before(s, held, new, first_time, item, table, entries)
    return EXHAUSTED


@kernel
def _note(s: int, held: int, new: int, cost: float, table: PairTable, known: Backward) -> bool:
    """Note the cost of holding on some branches.

    Returns whether one of them is the first on which the limb can be released here.
    """
    branches = releasable(table, s, held) if table.check else table.mask[s, held]
    first_time = can_release(new, branches) and not can_release(known.holding[s, held], branches)
    known.holding[s, held] |= new
    for b in range(FLIPS):
        if has(new, b):
            known.value[s, held, b] = cost
    return first_time


@kernel
def _grasp_before(
    s: int, held: int, new: int, first_time: bool, item: int, table: PairTable, entries: Queue
) -> None:
    """Put what comes before a state into the queue in which a limb holds on branches `new`.

    The other limb may have grasped here; so may this one, if the other held meanwhile. Where the
    limb that holds grasped here, the other came holding and must be releasable.
    """
    f, cost = entries.f[item], entries.cost[item]
    push(entries, f, 0.0, cost, 4 * s + 2 * held + 1, -1, new)
    if first_time:
        other = 1 - held
        leave = releasable(table, s, other) if table.check else table.mask[s, other]
        push(entries, f, 0.0, cost, 4 * s + 2 * other + 1, -1, leave)


@kernel
def _hold_before(
    s: int,
    held: int,
    new: int,
    cost: float,
    toward: Array,
    weights: Weights,
    table: PairTable,
    arrays: tuple[Backward, Queue],
) -> None:
    """Put the stances into the queue from which the other limb may have come to grasp here."""
    known, entries = arrays
    point, check = table.points[s, held], table.check
    first_edge = table.offset[held, point] + table.local[held, s] * table.degree[held, point]
    x, y, z = table.base[s, 0], table.base[s, 1], table.base[s, 2]
    for k in range(table.row_start[held, point], table.row_start[held, point + 1]):
        s2 = table.rows[held, k]
        if s2 == s:
            continue
        keep = kept_on_edge(new, table.mask[s2, held]) & ~known.holding[s2, held]
        if keep == 0:
            continue
        sure = not check
        if check:
            edge = table.edges[first_edge + table.local[held, s2]]
            if edge.known:
                sure, keep = True, kept_on_edge(keep, branches_kept(edge))
        dx = table.row_base[held, k, 0] - x
        dy = table.row_base[held, k, 1] - y
        dz = table.row_base[held, k, 2] - z
        cost2 = cost + weights.base * np.sqrt(dx * dx + dy * dy + dz * dz) + weights.step
        better = EMPTY
        for b in range(FLIPS):
            if has(keep, b) and cost2 < known.best[s2, held, b]:
                if sure:
                    known.best[s2, held, b] = cost2
                better |= only(b)
        if better:
            push(entries, cost2 + toward[s2], 0.0, cost2, 4 * s2 + 2 * held, s, better)


class CostToGo:
    """Exact cost from every state of a two-limb graph to a goal region.

    Attributes:
        values: Cost from each stance when both limbs have all their branches, shape (n,); inf where
            no goal can be reached.
        goal: The goal.
        is_goal: Which stances are goals, shape (n,).
    """

    def __init__(self, graph: PairGraph, goal: Goal) -> None:
        """Search backward from the goal; the steps it wants are checked, once for all goals."""
        self.graph, self.goal, self.cost = graph, goal, goal.cost
        self.is_goal: BoolArray = goal.reached(graph.base_in_world, graph.points)
        self._held, _, _ = backward(graph, self.is_goal, weights_of(goal.cost))
        self._releasable = graph.releasable if graph.settings.transitions else graph.mask
        self.values: Array = np.where(self.is_goal, 0.0, self._held.min(axis=(1, 2)))

    def value(self, state: State) -> float:
        """Cost from a state to the goal; infinity from a stance that cannot be held.

        Raises:
            StanceError: If it is no state on this map.
        """
        self.graph.check(state)
        if state.pose is not None:
            return self._from_given_pose(state)
        s = self.graph.find(state.stance)
        if s < 0:
            return np.inf
        if self.is_goal[s]:
            return 0.0
        return float(
            min(
                self._held[s, i][_bits(state.masks[i])].min()
                if can_release(state.masks[1 - i], int(self._releasable[s, 1 - i]))
                else np.inf
                for i in range(2)
            )
        )

    def _from_given_pose(self, state: State) -> float:
        if self.goal.reached(np.array(state.pose)[:3], state.stance):
            return 0.0
        return float(self.action_values(state, self.graph.successors(state)).min(initial=np.inf))

    def action_values(self, state: State, successors: Successors) -> Array:
        """Cost of taking each step that leaves a state and going on optimally, shape (k,)."""
        out = np.empty(len(successors.limb))
        shift = np.linalg.norm(
            successors.base_in_world - self.graph.posture_of(state).base_position[0], axis=1
        )
        for k in range(len(out)):
            after = successors.after(state, k)
            out[k] = self.cost.base_weight * shift[k] + self.cost.step_weight + self.value(after)
        return out

    def best(self, state: State, successors: Successors) -> int:
        """Index of the best step among those that leave a state, the first of equal ones."""
        values = self.action_values(state, successors)
        return int(np.flatnonzero(values <= values.min() + 1e-12)[0])


def _bits(mask: int) -> list[int]:
    """Branches and flips of a mask by number."""
    return [b for b in range(16) if mask >> b & 1]
