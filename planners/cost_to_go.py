"""Exact cost-to-go of the two-limb robot, with all steps checked: oracle and expert.

The cost to the goal depends on the branches that the limbs are on. Whether limb j can move while
limb i holds on branch b depends on b alone, so the table holds `U[s, i, b]`, the minimum cost from
stance s when limb i holds on b and the other limb moves next, see `table_values`.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.planners.query import Goal
from mlivr_gym.planners.table_values import TableValues
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import step_tables
from mlivr_gym.transitions.state import State, Successors

FIRST = np.zeros(1, dtype=np.int64)
"""Index of the only goal, for one state."""


class CostToGo:
    """Exact cost from every state of a two-limb graph to a goal region.

    Attributes
    ----------
    values
        Cost from each stance when both limbs have all their branches, shape (n,); infinite where no
        goal can be reached.
    goal
        The goal.
    is_goal
        Whether each stance is at the goal, shape (n,).
    """

    @checked()
    def __init__(self, graph: StanceGraph, goal: Goal) -> None:
        """Compute the costs of a goal; steps not checked before are checked, once for all goals."""
        self.graph, self.goal, self.cost = graph, goal, goal.cost
        self.is_goal: BoolArray = goal.reached(graph.base_position, graph.points)
        self._table = TableValues(step_tables(graph), self.is_goal[None], goal.cost)
        self.values: Array = self._table.of_stances(0)

    def value(self, state: State) -> float:
        """Return the cost from a state to the goal; infinite for a stance that cannot be held.

        Raises a `StanceError` if it is no state on this map.
        """
        self.graph.check(state)
        if state.pose is not None:
            return self._from_given_pose(state)
        s = self.graph.find(state.stance)
        if s < 0:
            return np.inf
        return float(self._table.of_states(np.array([s]), np.array([state.branch_sets]), FIRST)[0])

    def _from_given_pose(self, state: State) -> float:
        """Return the cost from a state with a given base pose, by its successors."""
        if self.goal.reached(np.array(state.pose)[:3], state.stance):
            return 0.0
        return float(self.action_values(state, self.graph.successors(state)).min(initial=np.inf))

    @checked(late=True)
    def action_values(self, state: State, successors: Successors) -> Array:
        """Return the cost of each step from a state and an optimal path after it, shape (k,)."""
        shift = np.linalg.norm(
            successors.base_position - self.graph.posture_of(state).base_position[0], axis=1
        )
        steps = self.cost.of_steps(shift, successors.stances(state), successors.point)
        rest = [self.value(successors.after(state, k)) for k in range(len(steps))]
        values: Array = steps + np.array(rest)
        return values

    @checked(late=True)
    def best(self, state: State, successors: Successors) -> int:
        """Return the index of the best step that leaves a state, the first of equal ones."""
        values = self.action_values(state, successors)
        return int(np.flatnonzero(values <= values.min() + 1e-12)[0])
