"""Cost-to-go over `StepTables`, with costs that may depend on the stance a step leads to.

The table holds `U[s, i, b]`, the minimum cost from stance s when limb i holds on branch b and the
other limb moves next. A label-correcting search computes it, which relaxes edges until Bellman's
equation holds. Sets of points can be removed from its arrays within a millisecond, as training on
many layouts requires, and where grasps may fail it computes expected costs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import has, only
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.kinematics.batches import distances
from mlivr_gym.planners.costs import Cost
from mlivr_gym.stances.step_tables import StepTables
from mlivr_gym.transitions.rule import can_release, kept_on_edge


class StepPrices(NamedTuple):
    """Prices of steps to n stances on m points."""

    step: Array
    """Price of a step to each stance by the limb that moves, shape (n, 2)."""
    metre: Array
    """Price of each metre of base displacement of a step to each point [1/m], shape (m,)."""


class CostTables(NamedTuple):
    """Minimum costs from n stances to g goals."""

    by_branch: Array
    """Cost when a limb holds on a branch and the other moves next, shape (g, n, 2, 16)."""
    grasped: Array
    """Minimum over branches when a limb has just grasped and the other moves next, shape (g, n,
    2)."""


@entry
def compute_costs(
    goal: BoolArray,
    prices: StepPrices,
    tables: StepTables,
    costs: CostTables,
    g: int,
    most: float,
    queue: IntArray,
    queued: NDArray[np.int8],
) -> None:
    """Compute the costs to goal g by label correcting backward from its stances, of n in all.

    `goal`, `queue` and `queued`, of which the last two are scratch, have shape (n,); the entries of
    the goal in `costs`, initially infinite, are written, but none above `most`.
    """
    n, value, grasped = len(goal), costs.by_branch[g], costs.grasped[g]
    step_cost, base_cost = prices.step, prices.metre
    head = size = 0
    for s in range(n):
        if goal[s]:
            grasped[s, 0] = grasped[s, 1] = 0.0
            for limb in range(2):
                for b in range(16):
                    if has(tables.branch_sets[s, limb], b):
                        value[s, limb, b] = 0.0
            queue[size] = s
            queued[s] = 1
            size += 1
    while size:
        s2 = queue[head]
        head = (head + 1) % n
        size -= 1
        queued[s2] = 0
        for moving in range(2):
            support, point = 1 - moving, tables.points[s2, moving]
            least = grasped[s2, moving]
            for b in range(16):
                least = min(least, value[s2, support, b])
            if step_cost[s2, moving] + least > most:
                continue
            for e in range(tables.start[2 * s2 + moving], tables.start[2 * s2 + moving + 1]):
                s = tables.after[e]
                if goal[s]:
                    continue
                square = 0.0
                for axis in range(3):
                    square += (tables.base_position[s, axis] - tables.base_position[s2, axis]) ** 2
                cost = step_cost[s2, moving] + base_cost[point] * np.sqrt(square)
                branches, changed = tables.kept[e], False
                for b in range(16):
                    if has(branches, b):
                        # The support limb may move next if it can be released on its branch.
                        remaining = np.inf
                        if can_release(only(b), tables.releasable[s2, support]):
                            remaining = grasped[s2, moving]
                        through = cost + min(value[s2, support, b], remaining)
                        if through <= most and through < value[s, support, b] - 1e-9:
                            value[s, support, b] = through
                            if can_release(only(b), tables.releasable[s, support]):
                                grasped[s, support] = min(grasped[s, support], through)
                            changed = True
                if changed and not queued[s]:
                    queue[(head + size) % n] = s
                    queued[s] = 1
                    size += 1


@entry
def step_values(
    stances: IntArray,
    branch_sets: IntArray,
    goal_of_state: IntArray,
    is_goal: BoolArray,
    prices: StepPrices,
    tables: StepTables,
    costs: CostTables,
    out: Array,
) -> None:
    """Compute the cost of each action of k states, followed by a path of minimum cost.

    States have branch sets (k, 2) and the index of a goal each; `is_goal` tells whether each stance
    is in each goal region, shape (g, n). The costs of possible actions are written into `out`,
    initially infinite, shape (k, 2 m).
    """
    m, values, grasped = out.shape[1] // 2, costs.by_branch, costs.grasped
    step_cost, base_cost = prices.step, prices.metre
    for k in range(len(stances)):
        s, g = stances[k], goal_of_state[k]
        for moving in range(2):
            support = 1 - moving
            if not can_release(branch_sets[k, moving], tables.releasable[s, moving]):
                continue
            for e in range(tables.start[2 * s + moving], tables.start[2 * s + moving + 1]):
                branches = kept_on_edge(branch_sets[k, support], tables.kept[e])
                if not branches:
                    continue
                s2 = tables.after[e]
                point = tables.points[s2, moving]
                square, remaining = 0.0, np.inf
                if can_release(branches, tables.releasable[s2, support]):
                    remaining = grasped[g, s2, moving]
                for axis in range(3):
                    square += (tables.base_position[s, axis] - tables.base_position[s2, axis]) ** 2
                for b in range(16):
                    if has(branches, b):
                        remaining = min(remaining, values[g, s2, support, b])
                if is_goal[g, s2]:
                    remaining = 0.0
                out[k, moving * m + point] = (
                    step_cost[s2, moving] + base_cost[point] * np.sqrt(square) + remaining
                )


def expected_prices(cost: Cost, failure: Array, points: NDArray[np.integer]) -> StepPrices:
    """Return the expected prices of steps and metres to n stances if attempts may fail.

    A failed attempt costs a step, with its price, and the base displacement there and back. It is
    repeated until it succeeds, after `1 / (1 - p)` attempts on average, with the probability p of
    each point, (m,). The stances hold points (n, 2).
    """
    step = (cost.step_weight + cost.of_nodes(points)) / (1.0 - failure)[points]
    return StepPrices(step, cost.base_weight * (1.0 + failure) / (1.0 - failure))


def in_goal_region(tables: StepTables, goals: Array, tolerance: float) -> BoolArray:
    """Return whether each base is within a tolerance [m] of goal positions, (g, 3) -> (g, n)."""
    return np.array([distances(tables.base_position, goal) <= tolerance for goal in goals])


class TableValues:
    """Minimum costs to g goals on one layout of the points.

    Attributes
    ----------
    tables
        The steps of the layout.
    is_goal
        Whether each stance is in each goal region, shape (g, n).
    values
        Costs by goal, stance, holding limb and branch, shape (g, n, 2, 16); infinite where the goal
        cannot be reached.
    grasped
        Their minimum by goal, stance and limb that has just grasped, shape (g, n, 2).
    """

    def __init__(
        self,
        tables: StepTables,
        is_goal: BoolArray,
        cost: Cost,
        failure: Array | None = None,
        most: float = np.inf,
    ) -> None:
        """Compute the costs backward from the stances of each goal region, shape (g, n).

        With probabilities that an attempt at each point fails, shape (m,), they are expected costs.
        Those above `most` are infinite, which saves the time of all that is far from the goals.
        """
        self.tables = tables
        sure = np.zeros(int(tables.points.max()) + 1)
        self.prices = expected_prices(cost, sure if failure is None else failure, tables.points)
        n, count = len(tables.points), len(is_goal)
        self.is_goal: BoolArray = is_goal & (tables.branch_sets != 0).all(axis=1)
        self._costs = CostTables(np.full((count, n, 2, 16), np.inf), np.full((count, n, 2), np.inf))
        self.values, self.grasped = self._costs
        for g in range(count):
            queue, queued = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int8)
            goal = self.is_goal[g]
            compute_costs(goal, self.prices, tables, self._costs, g, most, queue, queued)

    def of_stances(self, g: int) -> Array:
        """Return the cost from each stance to goal `g` with all its branches, shape (n,)."""
        return np.where(self.is_goal[g], 0.0, self.values[g].min(axis=(1, 2)))

    def of_states(self, stances: IntArray, branch_sets: IntArray, goal_of_state: IntArray) -> Array:
        """Return the cost from k states, with branch sets (k, 2) and the index of a goal each."""
        on_branch = branch_sets[:, :, None] >> np.arange(16) & 1 != 0
        values = np.where(on_branch, self.values[goal_of_state, stances], np.inf).min(axis=2)
        # A limb may hold while the other one can be released, as `transitions.rule` says.
        can_move = branch_sets & self.tables.releasable[stances] != 0
        least = np.where(can_move[:, ::-1], values, np.inf).min(axis=1)
        found: Array = np.where(self.is_goal[goal_of_state, stances], 0.0, least)
        return found

    def of_actions(
        self, stances: IntArray, branch_sets: IntArray, goal_of_state: IntArray, actions: int
    ) -> Array:
        """Return the cost of each action in k states, followed by a path of minimum cost.

        The costs have shape (k, actions), and are infinite where an action is not possible. States
        have branch sets (k, 2) and the index of a goal each; there are 2 m actions.
        """
        out: Array = np.full((len(stances), actions), np.inf)
        step_values(
            stances,
            branch_sets,
            goal_of_state,
            self.is_goal,
            self.prices,
            self.tables,
            self._costs,
            out,
        )
        return out
