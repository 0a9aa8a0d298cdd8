"""Regret: how much more an episode costs than an optimal one, by the exact cost-to-go.

With two limbs the cost-to-go of each goal is computed when its episode starts. With more limbs
there is a lower bound of it, from the table of nodes if the graph has one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.errors import SettingError
from mlivr_gym.kinematics.batches import distance
from mlivr_gym.planners.cost_to_go import CostToGo
from mlivr_gym.planners.lower_bounds import LowerBounds
from mlivr_gym.planners.query import Goal
from mlivr_gym.planners.table_values import TableValues, in_goal_region

if TYPE_CHECKING:
    from mlivr_gym.stances.step_tables import StepTables
    from mlivr_gym.transitions.state import State


class Regret:
    """Cost so far and at the start of k episodes, for the information of the environments."""

    def __init__(self, k: int, names: tuple[str, str] = ("optimal_cost", "regret")) -> None:
        """Prepare for k episodes; the names are those of cost-to-go and regret."""
        self._names, self._spent, self._least = names, np.zeros(k), np.zeros(k)

    def start(self, which: BoolArray, costs_to_go: Array) -> None:
        """Start some of the episodes, with costs-to-go (k,)."""
        self._spent[which], self._least[which] = 0.0, costs_to_go[which]

    def charge(self, which: BoolArray, costs: Array | float) -> None:
        """Add the costs of an action in some of the episodes."""
        self._spent[which] += costs

    def info(self, costs_to_go: Array) -> dict[str, Array]:
        """Return costs-to-go and regrets, (k,), infinite where no goal can be reached."""
        known = np.isfinite(costs_to_go) & np.isfinite(self._least)
        regret = np.full(len(known), np.inf)
        regret[known] = (self._spent + costs_to_go)[known] - self._least[known]
        return dict(zip(self._names, (costs_to_go, regret), strict=True))


class OptimalCosts:
    """Costs-to-go in k environments of two limbs, which take five megabytes each on the JEM.

    Where grasps may fail they are expected costs, as those of `ExpertPolicy`.
    """

    def __init__(self, env: Any, k: int) -> None:
        """Prepare for the cost and the goal region of an environment.

        Raises a `SettingError` if its reward is an object of the user, whose cost is not known.
        """
        self._env, self._cost = env, env.reward.cost
        self._tables: StepTables | None = None
        self._values: list[tuple[bytes, TableValues] | None] = [None] * k

    def of(
        self, tables: StepTables, goals: Array, stances: IntArray, branch_sets: IntArray
    ) -> Array:
        """Return the costs-to-go of stances (k,) with branch sets (k, 2) and goals (k, 3) [m]."""
        if self._tables is not tables:
            self._tables, self._values = tables, [None] * len(self._values)
        env, found, first = self._env, np.empty(len(goals)), np.zeros(1, dtype=np.int64)
        for k, goal in enumerate(goals):
            stored = self._values[k]
            if stored is None or stored[0] != goal.tobytes():
                region = in_goal_region(tables, goal[None], env.goal_tolerance)
                values = TableValues(tables, region, self._cost, env.failure_probability)
                stored = self._values[k] = goal.tobytes(), values
            found[k] = stored[1].of_states(stances[k : k + 1], branch_sets[k : k + 1], first)[0]
        return found

    def of_state(self, env: Any, state: State) -> float:
        """Return the cost-to-go of a state; a start in a pose of its own is taken not to fail."""
        moves = env.table_moves()
        if state.pose is not None:
            goal = Goal(env.goal, env.goal_tolerance, self._cost)
            return CostToGo(moves.graph, goal).value(state)
        stances = np.array([moves.stance_at[state.stance]], dtype=np.int64)
        return float(
            self.of(moves.tables, env.goal[None], stances, np.array([state.branch_sets]))[0]
        )


class CostBounds:
    """Lower bounds of the cost-to-go of three or more limbs."""

    def __init__(self, env: Any) -> None:
        """Prepare for the cost of an environment; errors are those of `OptimalCosts`."""
        self._cost = env.reward.cost
        self._bounds = None if env.graph.table is None else LowerBounds(env.graph)

    def of_state(self, env: Any, state: State) -> float:
        """Return a lower bound of the cost-to-go of a state."""
        goal, graph = Goal(env.goal, env.goal_tolerance, self._cost), env.graph
        if self._bounds is not None and state.pose is None:
            rows, _ = self._bounds.table.find(np.array([state.stance]), graph.robot)
            if rows[0] >= 0:
                bounds = self._bounds.cached(goal, rows) or self._bounds.compute(goal, rows)
                return float(bounds.h[rows[0]])
        away = distance(env.moves.stance_properties(state).base_position, env.goal.tolist())
        longest = graph.max_displacement
        return float(self._cost.heuristic("consistent", np.array(away), goal.tolerance, longest))


class EpisodeRegret:
    """Regret of the episodes of one environment."""

    def __init__(self, env: Any) -> None:
        """Prepare for an environment.

        Raises a `SettingError` if it has actions beside the steps, or a reward of the user's.
        """
        if env.further_actions:
            raise SettingError(
                f"info_regret is True; {type(env).__name__} has actions beside the steps, and no "
                "known optimum"
            )
        self._costs: OptimalCosts | CostBounds
        if env.graph.lists_all:
            self._costs, self._regret = OptimalCosts(env, 1), Regret(1)
        else:
            names = "optimal_cost_lower_bound", "lower_bound_gap"
            self._costs, self._regret = CostBounds(env), Regret(1, names)

    def start(self, env: Any) -> dict[str, Any]:
        """Start an episode in the present state, and return the information."""
        here = np.array([self._costs.of_state(env, env.state)])
        self._regret.start(np.ones(1, dtype=np.bool_), here)
        return self._numbers(here)

    def charge(self, env: Any, cost: float) -> dict[str, Any]:
        """Add the cost of the action that led to the present state; return the information."""
        self._regret.charge(np.ones(1, dtype=np.bool_), cost)
        return self._numbers(np.array([self._costs.of_state(env, env.state)]))

    def _numbers(self, costs_to_go: Array) -> dict[str, Any]:
        """Return the information of the only episode."""
        return {name: float(row[0]) for name, row in self._regret.info(costs_to_go).items()}
