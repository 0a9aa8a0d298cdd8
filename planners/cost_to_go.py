"""Exact cost-to-go tables: the oracle and expert of the two-limb robot.

With steps checked the cost to the goal depends on the branches the limbs are on. Moving limb j
while limb i holds on branch b depends on b alone, so the table holds `U[s, i, b]`: the least cost
from stance s when limb i holds on b and the other limb moves next. One search backward from the
goal fills all of it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.kernels import allocating_kernel
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.heap import grown, sift_down, sift_up
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.pair_steps import KNOWN, edge_entry
from mlivr_gym.transitions.rule import can_release, kept_on_edge, mask_of_grasp
from mlivr_gym.transitions.state import State, Successors


@allocating_kernel
def backward(
    goal: BoolArray, start: int, toward: Array, base_weight: float, step_weight: float, limit: int,
    check: bool, rows: IntArray, row_start: IntArray, row_position: Array, edges: tuple[Any, ...],
    value: Array, done: IntArray, best: Array,
) -> tuple[float, bool]:  # fmt: skip
    """Fill the table by best-first search backward from the goal stances.

    Steps are checked when the search wants them. A queue entry is (cost, stance, limb, mask, kind).
    Kind 0: limb holds on a branch of the mask and the other moves next. Kind 1: the other limb has
    just grasped: either may move next.

    Args:
        goal: Which stances are goals, shape (n,).
        start: Stance at which to stop, or -1 to go on to the end.
        toward: Consistent lower bound of the cost from the start to each stance, shape (n,); zeros
            without one.
        base_weight: Weight of the base displacement [1/m].
        step_weight: Charge for each step.
        limit: Most entries to take from the queue.
        check: Whether steps are checked.
        rows: `PairGraph.rows`.
        row_start: `PairGraph.row_start`.
        row_position: `PairGraph.row_position`.
        edges: `PairGraph.edges`.
        value: Shape (n, 2, 16), filled with U by holding limb and bit; inf where the goal cannot be
            reached.
        done: Zeros, shape (n, 2, 2); branches expanded by holding limb and kind.
        best: Infinities, shape (n, 2, 16); least costs found.

    Returns:
        Lower bound of cost and `toward` together over all states that were not expanded, and
        whether it got to the start.
    """
    points, local, degree, offset, table, position, mask, released = (
        edges[0], edges[1], edges[2], edges[3], edges[4], edges[5], edges[7], edges[17][2],
    )  # fmt: skip
    n = len(goal)
    size_pool = 1 << 16
    f, none = np.empty(size_pool), np.empty(size_pool)
    node, bits = np.empty(size_pool, np.int64), np.empty(size_pool, np.int64)
    heap = np.empty(size_pool, np.int64)
    after, spent = np.empty(size_pool, np.int64), np.empty(size_pool)
    used = size = taken = 0
    for s in range(n):
        if goal[s] and mask[s, 0]:
            for held in range(2):
                if used == size_pool:
                    f, none, node, bits = grown(f), grown(none), grown(node), grown(bits)
                    heap, after, spent = grown(heap), grown(after), grown(spent)
                    size_pool *= 2
                f[used], none[used] = toward[s], 0.0
                node[used], bits[used] = 4 * s + 2 * held + 1, mask[s, held]
                spent[used], after[used], heap[size] = 0.0, -1, used
                used += 1
                size += 1
                sift_up(heap, size, f, none)
    while size > 0:
        item = heap[0]
        size -= 1
        if size > 0:
            heap[0] = heap[size]
            sift_down(heap, size, f, none)
        s, held, kind = node[item] >> 2, node[item] >> 1 & 1, node[item] & 1
        cost, next = spent[item], after[item]
        new = bits[item] & ~done[s, held, kind]
        if new == 0:
            continue
        if taken >= limit:
            return f[item], False
        taken += 1
        if kind == 0:
            if check:
                new = kept_on_edge(new, edge_entry(held, s, next, edges))
                if new == 0:
                    continue
            # Where the limb that holds grasped here, the other came holding and must be releasable.
            releasable = mask_of_grasp(released[s, held]) if check else mask[s, held]
            first = can_release(new, releasable) and not can_release(done[s, held, 0], releasable)
            done[s, held, 0] |= new
            for b in range(16):
                if new >> b & 1:
                    value[s, held, b] = cost
            if s == start:
                return f[item], True
            # The other limb may have grasped here; so may this one, if the other held meanwhile.
            if used + 2 > size_pool:
                f, none, node, bits = grown(f), grown(none), grown(node), grown(bits)
                heap, after, spent = grown(heap), grown(after), grown(spent)
                size_pool *= 2
            for turn in range(2 if first else 1):
                holder = held if turn == 0 else 1 - held
                leave = mask_of_grasp(released[s, holder]) if check else mask[s, holder]
                f[used], none[used], node[used] = f[item], 0.0, 4 * s + 2 * holder + 1
                bits[used] = new if turn == 0 else leave
                spent[used], after[used], heap[size] = cost, -1, used
                used += 1
                size += 1
                sift_up(heap, size, f, none)
            continue
        done[s, held, 1] |= new
        point = points[s, held]
        first_entry = offset[held, point] + local[held, s] * degree[held, point]
        x, y, z = position[s, 0], position[s, 1], position[s, 2]
        for k in range(row_start[held, point], row_start[held, point + 1]):
            s2 = rows[held, k]
            if s2 == s:
                continue
            keep = kept_on_edge(new, mask[s2, held]) & ~done[s2, held, 0]
            if keep == 0:
                continue
            entry = table[first_entry + local[held, s2]] if check else KNOWN
            if check and entry & KNOWN:
                keep = kept_on_edge(keep, entry)
            dx = row_position[held, k, 0] - x
            dy = row_position[held, k, 1] - y
            dz = row_position[held, k, 2] - z
            cost2 = cost + base_weight * np.sqrt(dx * dx + dy * dy + dz * dz) + step_weight
            better = 0
            for b in range(16):
                if keep >> b & 1 and cost2 < best[s2, held, b]:
                    if entry & KNOWN:
                        best[s2, held, b] = cost2
                    better |= 1 << b
            if better == 0:
                continue
            if used == size_pool:
                f, none, node, bits = grown(f), grown(none), grown(node), grown(bits)
                heap, after, spent = grown(heap), grown(after), grown(spent)
                size_pool *= 2
            f[used], none[used] = cost2 + toward[s2], 0.0
            node[used], bits[used] = 4 * s2 + 2 * held, better
            spent[used], after[used], heap[size] = cost2, s, used
            used += 1
            size += 1
            sift_up(heap, size, f, none)
    return np.inf, False


NO_LIMIT = int(np.iinfo(np.int64).max)
"""Entries that a search may take from its queue where nothing limits it."""


class CostToGo:
    """Exact cost from every state of a two-limb graph to a goal region.

    Attributes:
        values: Cost from each stance when both limbs have all their branches, shape (n,); inf where
            no goal can be reached.
        goal: Goal position [m], shape (3,).
        tolerance: Radius of the goal region [m].
        is_goal: Which stances are goals, shape (n,).
    """

    def __init__(self, graph: PairGraph, goal: Array, tolerance: float, cost: Cost) -> None:
        """Search backward from the goal; the steps it wants are checked, once for all goals."""
        self.graph, self.cost, self.goal, self.tolerance = graph, cost, goal, tolerance
        self.is_goal: BoolArray = np.linalg.norm(graph.base_in_world - goal, axis=1) <= tolerance
        self._held = np.full((len(graph), 2, 16), np.inf)
        backward(
            self.is_goal, -1, np.zeros(len(graph)), cost.base_weight, cost.step_weight, NO_LIMIT,
            graph.settings.transitions, graph.rows,
            graph.row_start, graph.row_position, graph.edges, self._held,
            np.zeros((len(graph), 2, 2), dtype=np.int64), np.full((len(graph), 2, 16), np.inf),
        )  # fmt: skip
        self._releasable = graph.releasable if graph.settings.transitions else graph.mask
        self.values: Array = np.where(self.is_goal, 0.0, self._held.min(axis=(1, 2)))

    def value(self, state: State) -> float:
        """Cost from a state to the goal."""
        if state.pose is not None:
            return self._from_given_pose(state)
        s = self.graph.find(state.stance)
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
        if np.linalg.norm(np.array(state.pose)[:3] - self.goal) <= self.tolerance:
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
