"""Cost-to-go over `StepTables`, with costs that may depend on the point a limb takes hold of.

The table holds `U[s, i, b]`, the least cost from stance s when limb i holds on branch b and the
other limb moves next. It is found by relaxing until nothing changes, over arrays that any set of
points can be taken out of in a millisecond: what training on many layouts needs, and expected costs
where grasps may fail.
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
    """What a step to each of m points costs, shape (m,)."""

    step: Array
    """For the step."""
    metre: Array
    """For each metre of base displacement."""


class CostTables(NamedTuple):
    """Least costs to g goals from n stances."""

    held: Array
    """When a limb holds on a branch and the other moves next, shape (g, n, 2, 16)."""
    grasped: Array
    """The least when a limb has just grasped and the other moves next, shape (g, n, 2)."""


@entry
def relax(
    goal: BoolArray,
    prices: StepPrices,
    tables: StepTables,
    costs: CostTables,
    g: int,
    queue: IntArray,
    queued: NDArray[np.int8],
) -> None:
    """Fill the table, label-correcting backward from the goal stances.

    Parameters
    ----------
    goal
        Which stances are goals, shape (n,).
    charges
        What a step to each point costs.
    tables
        `StepTables`.
    costs
        Infinities, filled for one goal.
    g
        Which goal.
    waiting
        Shape (n,).
    queued
        Zeros, shape (n,).
    """
    n, value, grasped = len(goal), costs.held[g], costs.grasped[g]
    step_cost, base_cost = prices.step, prices.metre
    head = size = 0
    for s in range(n):
        if goal[s]:
            grasped[s, 0] = grasped[s, 1] = 0.0
            for limb in range(2):
                for b in range(16):
                    if has(tables.masks[s, limb], b):
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
            held, point = 1 - moving, tables.points[s2, moving]
            for e in range(tables.start[2 * s2 + moving], tables.start[2 * s2 + moving + 1]):
                s = tables.after[e]
                if goal[s]:
                    continue
                square = 0.0
                for axis in range(3):
                    square += (tables.base_in_world[s, axis] - tables.base_in_world[s2, axis]) ** 2
                cost = step_cost[point] + base_cost[point] * np.sqrt(square)
                branches, changed = tables.kept[e], False
                for b in range(16):
                    if has(branches, b):
                        # The limb that holds may move next if it can be released on its branch.
                        remaining = np.inf
                        if can_release(only(b), tables.releasable[s2, held]):
                            remaining = grasped[s2, moving]
                        through = cost + min(value[s2, held, b], remaining)
                        if through < value[s, held, b] - 1e-9:
                            value[s, held, b] = through
                            if can_release(only(b), tables.releasable[s, held]):
                                grasped[s, held] = min(grasped[s, held], through)
                            changed = True
                if changed and not queued[s]:
                    queue[(head + size) % n] = s
                    queued[s] = 1
                    size += 1


@entry
def step_values(
    stances: IntArray,
    masks: IntArray,
    goal_of_state: IntArray,
    goals: BoolArray,
    prices: StepPrices,
    tables: StepTables,
    costs: CostTables,
    out: Array,
) -> None:
    """Cost of taking each possible action and going on at the least cost.

    Parameters
    ----------
    stances
        Stance indices, shape (k,).
    masks
        Branches, shape (k, 2).
    which
        Goal of each state, shape (k,).
    goals
        Which stances are goals, shape (g, n).
    charges
        As in `relax`.
    tables
        `StepTables`.
    costs
        As `relax` has filled them.
    out
        Infinities, shape (k, 2 m), written.
    """
    m, values, grasped = out.shape[1] // 2, costs.held, costs.grasped
    step_cost, base_cost = prices.step, prices.metre
    for k in range(len(stances)):
        s, g = stances[k], goal_of_state[k]
        for moving in range(2):
            held = 1 - moving
            if not can_release(masks[k, moving], tables.releasable[s, moving]):
                continue
            for e in range(tables.start[2 * s + moving], tables.start[2 * s + moving + 1]):
                branches = kept_on_edge(masks[k, held], tables.kept[e])
                if not branches:
                    continue
                s2 = tables.after[e]
                point = tables.points[s2, moving]
                square, remaining = 0.0, np.inf
                if can_release(branches, tables.releasable[s2, held]):
                    remaining = grasped[g, s2, moving]
                for axis in range(3):
                    square += (tables.base_in_world[s, axis] - tables.base_in_world[s2, axis]) ** 2
                for b in range(16):
                    if has(branches, b):
                        remaining = min(remaining, values[g, s2, held, b])
                if goals[g, s2]:
                    remaining = 0.0
                out[k, moving * m + point] = (
                    step_cost[point] + base_cost[point] * np.sqrt(square) + remaining
                )


def expected_prices(cost: Cost, failure: Array) -> StepPrices:
    """Expected charges for a step and for a metre where attempts at points may fail.

    A failed attempt costs a step and the path there and back; it is made again until it succeeds,
    `1 / (1 - p)` times on average.

    Parameters
    ----------
    cost
        Cost of a step.
    failure
        Probability p that an attempt at each point fails, shape (m,).

    Returns
    -------
    Charges
        The charges for each point.
    """
    step = cost.step_weight / (1.0 - failure)
    return StepPrices(step, cost.base_weight * (1.0 + failure) / (1.0 - failure))


def stances_at(tables: StepTables, goals: Array, tolerance: float) -> BoolArray:
    """Which stances have their base within a tolerance [m] of goal positions, (g, 3) -> (g, n)."""
    return np.array([distances(tables.base_in_world, goal) <= tolerance for goal in goals])


class TableValues:
    """Least costs to g goals on one layout of the points.

    Attributes
    ----------
    tables
        The steps of the layout.
    goals
        Which stances are goals, shape (g, n).
    values
        Costs by goal, stance, holding limb and branch, shape (g, n, 2, 16); inf where the
        goal cannot be reached.
    grasped
        Their least by goal, stance and limb that has just grasped, shape (g, n, 2).
    """

    def __init__(
        self, tables: StepTables, goals: BoolArray, cost: Cost, failure: Array | None = None
    ) -> None:
        """Search backward from the stances of each goal.

        Parameters
        ----------
        tables
            The steps.
        goals
            Which stances are at each goal, shape (g, n).
        cost
            Cost of a step.
        failure
            Probability that an attempt at each point fails, shape (m,); costs are then
            expected costs.
        """
        self.tables = tables
        points = int(tables.points.max()) + 1 if failure is None else len(failure)
        self.prices = expected_prices(cost, np.zeros(points) if failure is None else failure)
        n, count = len(tables.points), len(goals)
        self.goals: BoolArray = goals & (tables.masks != 0).all(axis=1)
        self._costs = CostTables(np.full((count, n, 2, 16), np.inf), np.full((count, n, 2), np.inf))
        self.values, self.grasped = self._costs
        for g in range(count):
            queue, queued = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int8)
            relax(self.goals[g], self.prices, tables, self._costs, g, queue, queued)

    def of_stances(self, g: int) -> Array:
        """Least cost from each stance to goal `g` with all branches of both limbs, shape (n,)."""
        return np.where(self.goals[g], 0.0, self.values[g].min(axis=(1, 2)))

    def of_actions(
        self, stances: IntArray, masks: IntArray, goal_of_state: IntArray, actions: int
    ) -> Array:
        """Cost of taking each action in k states and going on at the least cost.

        Parameters
        ----------
        stances
            Stance indices, shape (k,).
        masks
            Branches each limb may be on, shape (k, 2).
        which
            Goal of each state, shape (k,).
        actions
            Number of actions, 2 m.

        Returns
        -------
        Array
            Shape (k, actions), inf where an action is not possible.
        """
        out: Array = np.full((len(stances), actions), np.inf)
        step_values(
            stances, masks, goal_of_state, self.goals, self.prices, self.tables, self._costs, out
        )
        return out
