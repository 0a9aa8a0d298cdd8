"""Exact cost-to-go tables: the oracle and expert of the two-limb robot.

With steps checked the cost to the goal depends on the branches the limbs are on. Moving limb j while limb
i holds on branch b depends on b alone, so the table holds `U[s, i, b]`: the least cost from stance s when limb i
holds on b and the other limb moves next. One search backward from the goal settles all of it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.compiled import kernel
from mlivr_gym.pair_graph import PairGraph, fill_rows
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.pair_search import _grown, _sift_down, _sift_up
from mlivr_gym.stance_graph import State, Successors

Array = NDArray[np.float64]


@kernel
def backward(goal, base_weight, step_weight, check, rows, row_start, row_position, edges, value, done, best):
    """Fill the table by best-first search backward from the goal stances.

    A queue entry is (cost, stance, limb, mask, kind). Kind 0: limb holds on a branch of the mask and the other
    moves next. Kind 1: the other limb has just landed, so that either may move next.

    Args:
        goal: Which stances are goals, shape (n,).
        base_weight: Weight of the base displacement [1/m].
        step_weight: Charge for each step.
        check: Whether steps are checked.
        rows: `PairGraph.rows`.
        row_start: `PairGraph.row_start`.
        row_position: `PairGraph.row_position`.
        edges: `PairGraph.edges`, with every entry known if steps are checked.
        value: Shape (n, 2, 16), filled with U by holding limb and bit; inf where the goal cannot be reached.
        done: Zeros, shape (n, 2, 2); branches settled by holding limb and kind.
        best: Infinities, shape (n, 2, 16); least costs found.
    """
    points, local, degree, offset, table, position, mask, released = (
        edges[0], edges[1], edges[2], edges[3], edges[4], edges[5], edges[7], edges[17][2],
    )  # fmt: skip
    n = len(goal)
    size_pool = 1 << 16
    f, none = np.empty(size_pool), np.empty(size_pool)
    node, bits, heap = np.empty(size_pool, np.int64), np.empty(size_pool, np.int64), np.empty(size_pool, np.int64)
    used = size = 0
    for s in range(n):
        if goal[s]:
            for held in range(2):
                if used == size_pool:
                    f, none, node, bits, heap = _grown(f), _grown(none), _grown(node), _grown(bits), _grown(heap)
                    size_pool *= 2
                f[used], none[used], node[used], bits[used] = 0.0, 0.0, 4 * s + 2 * held + 1, mask[s, held]
                heap[size] = used
                used += 1
                size += 1
    while size > 0:
        item = heap[0]
        size -= 1
        if size > 0:
            heap[0] = heap[size]
            _sift_down(heap, size, f, none)
        s, held, kind = node[item] >> 2, node[item] >> 1 & 1, node[item] & 1
        cost = f[item]
        new = bits[item] & ~done[s, held, kind]
        if new == 0:
            continue
        if kind == 0:
            # Where the limb that holds landed here, the other came holding and must be able to let go.
            land = released[s, held] & 0xFFFF if check else mask[s, held]
            first = new & land != 0 and done[s, held, 0] & land == 0
            done[s, held, 0] |= new
            for b in range(16):
                if new >> b & 1:
                    value[s, held, b] = cost
            # The other limb may have landed here; so may this one, if the other holds and it came.
            if used + 2 > size_pool:
                f, none, node, bits, heap = _grown(f), _grown(none), _grown(node), _grown(bits), _grown(heap)
                size_pool *= 2
            f[used], none[used], node[used], bits[used] = cost, 0.0, 4 * s + 2 * held + 1, new
            heap[size] = used
            used += 1
            size += 1
            _sift_up(heap, size, f, none)
            if first:
                other = 1 - held
                leave = released[s, other] & 0xFFFF if check else mask[s, other]
                f[used], none[used], node[used], bits[used] = cost, 0.0, 4 * s + 2 * other + 1, leave
                heap[size] = used
                used += 1
                size += 1
                _sift_up(heap, size, f, none)
            continue
        done[s, held, 1] |= new
        point = points[s, held]
        first_entry = offset[held, point] + local[held, s] * degree[held, point]
        x, y, z = position[s, 0], position[s, 1], position[s, 2]
        for k in range(row_start[held, point], row_start[held, point + 1]):
            s2 = rows[held, k]
            if s2 == s:
                continue
            after = new & mask[s2, held] & ~done[s2, held, 0]
            if check:
                after &= table[first_entry + local[held, s2]]
            if after == 0:
                continue
            dx = row_position[held, k, 0] - x
            dy = row_position[held, k, 1] - y
            dz = row_position[held, k, 2] - z
            cost2 = cost + base_weight * np.sqrt(dx * dx + dy * dy + dz * dz) + step_weight
            better = np.int64(0)
            for b in range(16):
                if after >> b & 1 and cost2 < best[s2, held, b]:
                    best[s2, held, b] = cost2
                    better |= 1 << b
            if better == 0:
                continue
            if used == size_pool:
                f, none, node, bits, heap = _grown(f), _grown(none), _grown(node), _grown(bits), _grown(heap)
                size_pool *= 2
            f[used], none[used], node[used], bits[used] = cost2, 0.0, 4 * s2 + 2 * held, better
            heap[size] = used
            used += 1
            size += 1
            _sift_up(heap, size, f, none)


class CostToGo:
    """Exact cost from every state of a two-limb graph to a goal region.

    Attributes:
        values: Cost from each stance when both limbs have all their branches, shape (n,); inf where there is no way.
        is_goal: Which stances are goals, shape (n,).
    """

    def __init__(
        self,
        graph: PairGraph,
        goal: Array,
        tolerance: float,
        cost: Cost,
        progress: Callable[[int, int], None] | None = None,
    ) -> None:
        """Check every step of the graph, once for all goals, and search backward from this one."""
        self.graph, self.cost = graph, cost
        self.is_goal: NDArray[np.bool_] = np.linalg.norm(graph.position - goal, axis=1) <= tolerance
        if graph.settings.transitions:
            fill_rows(graph, progress)
        self._leave = graph.edges[17][2] & 0xFFFF if graph.settings.transitions else graph.mask
        self._held = np.full((len(graph), 2, 16), np.inf)
        backward(
            self.is_goal, cost.base_weight, cost.step_weight, graph.settings.transitions, graph.rows,
            graph.row_start, graph.row_position, graph.edges, self._held,
            np.zeros((len(graph), 2, 2), dtype=np.int64), np.full((len(graph), 2, 16), np.inf),
        )  # fmt: skip
        self.values: Array = np.where(self.is_goal, 0.0, self._held.min(axis=(1, 2)))

    def value(self, state: State) -> float:
        """Cost from a state to the goal."""
        s = self.graph.find(state.stance)
        if self.is_goal[s]:
            return 0.0
        leave = self._leave[s] & state.masks
        return float(min(self._held[s, i][_bits(state.masks[i])].min() if leave[1 - i] else np.inf for i in range(2)))

    def action_values(self, state: State, successors: Successors) -> Array:
        """Cost of taking each step that leaves a state and going on optimally, shape (k,)."""
        here = self.graph.find(state.stance)
        out = np.empty(len(successors.limb))
        shift = np.linalg.norm(successors.position - self.graph.position[here], axis=1)
        for k in range(len(out)):
            stance = list(state.stance)
            stance[successors.limb[k]] = int(successors.point[k])
            after = State((stance[0], stance[1]), (int(successors.masks[k, 0]), int(successors.masks[k, 1])))
            out[k] = self.cost.base_weight * shift[k] + self.cost.step_weight + self.value(after)
        return out

    def best(self, state: State, successors: Successors) -> int:
        """Index of the best step among those that leave a state, the first of equal ones."""
        values = self.action_values(state, successors)
        return int(np.flatnonzero(values <= values.min() + 1e-12)[0])


def _bits(mask: int) -> list[int]:
    return [b for b in range(16) if mask >> b & 1]
