"""Policies that need no training: random actions, the optimal expert, and followers of plans."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Protocol

import numpy as np

from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation
from mlivr_gym.envs.rewards import BaseReward, StepReward
from mlivr_gym.errors import SettingError
from mlivr_gym.planners import Planner
from mlivr_gym.planners.baselines import find_walk
from mlivr_gym.planners.cost_to_go import CostToGo
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.query import Goal
from mlivr_gym.planners.table_values import TableValues, stances_at
from mlivr_gym.stances.moves import TableMoves
from mlivr_gym.stances.pair_graph import PairGraph


class Policy(Protocol):
    """Chooses actions in a `MlivrEnv`."""

    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """The action to take; `mask` tells which are possible, shape (N m,)."""
        ...


class RandomPolicy:
    """Draws from the possible actions."""

    def __init__(self, seed: int = 0) -> None:
        """Seed the draws."""
        self._rng = np.random.default_rng(seed)

    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """A possible action, each as likely as the others."""
        return int(self._rng.choice(np.flatnonzero(mask)))


class ExpertPolicy:
    """Takes the first step of an optimal plan, by the exact cost-to-go of the goal.

    For two limbs only.
    """

    def __init__(self, expect_failures: bool = True) -> None:
        """Start without tables; each is worked out when its goal first comes up.

        Parameters
        ----------
        expect_failures
            Whether costs are expected costs where grasps may fail; otherwise every
            grasp counts as sure.
        """
        self._expect = expect_failures
        self._moves: TableMoves | None = None
        self._goal: tuple[bytes, float] = b"", 0.0

    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """An optimal action for the environment's reward; the first of equal ones."""
        graph = env.graph
        if not isinstance(graph, PairGraph):
            raise SettingError(
                f"the expert policy needs two limbs; robot {graph.robot.name!r} has more"
            )
        moves = env.table_moves()
        goal = (env.goal.tobytes(), env.goal_tolerance)
        if self._moves is not moves or self._goal != goal:
            risk = env.failure_probability if self._expect else np.zeros(len(graph.grasp_map))
            cost = cost_of(env)
            self._moves, self._goal = moves, goal
            goals = stances_at(moves.tables, env.goal[None], env.goal_tolerance)
            self._values = TableValues(moves.tables, goals, cost, risk)
        if env.state.pose is not None:
            # No stance of the table; a first grasp that fails is not expected.
            steps = moves.successors(env.state)
            exact = CostToGo(graph, Goal(env.goal, env.goal_tolerance, cost_of(env)))
            best = exact.best(env.state, steps)
            return int(steps.limb[best] * len(graph.grasp_map) + steps.point[best])
        s = np.array([moves.stance_at[env.state.stance]], dtype=np.int64)
        costs = self._values.of_actions(
            s, np.array([env.state.masks]), np.zeros(1, dtype=np.int64), len(mask)
        )[0]
        # Where nothing leads to the goal any possible action will do.
        return int(np.flatnonzero(mask & (costs <= costs.min() + 1e-9))[0])


def cost_of(env: MlivrEnv) -> Cost:
    """The cost whose negative is the reward of an environment, shaping and bonus aside.

    Raises
    ------
    SettingError
        If the reward is an object of a user, whose cost is not known.
    """
    reward = env.reward.reward
    if isinstance(reward, StepReward | BaseReward):
        return Cost.named("steps" if isinstance(reward, StepReward) else "base")
    raise SettingError(f"the expert knows the rewards 'steps' and 'base', not {reward!r}")


class PlanPolicy:
    """Follows the plan of a method, and plans again where the state is not the plan's.

    Attributes
    ----------
    plans
        Plans made so far.
    """

    def __init__(self, find: Callable[[MlivrEnv], list[int] | None]) -> None:
        """Follow what `find` returns: the actions from the present state to the goal, or None."""
        self._find = find
        self._actions: list[int] = []
        self._expected: tuple[int, ...] | None = None
        self._goal: bytes = b""
        self.plans = 0

    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """The next action of the plan; one that is not possible where there is no plan."""
        if env.state.stance != self._expected or env.goal.tobytes() != self._goal or env.steps == 0:
            self._actions = (self._find(env) or [])[::-1]
            self._goal, self.plans = env.goal.tobytes(), self.plans + 1
        if not self._actions:
            self._expected = None
            return int(np.flatnonzero(~mask)[0])
        action = self._actions.pop()
        self._expected = env.state.stance_after(*divmod(action, len(env.graph.grasp_map)))
        return action


def planner_policy(
    cost: str = "steps", method: str = "astar", planner: Planner | None = None, **options: Any
) -> PlanPolicy:
    """Follows plans of `Planner`, by default made on the stance graph of the environment.

    A query starts from the state: after a grasp that failed the limb that held may be on some of
    its branches only. Plans of another graph of the same map, such as one without manipulability,
    start from its stance and are followed whether they are possible or not.

    Parameters
    ----------
    cost
        Cost of the plans.
    method
        Search method.
    planner
        Plans on another graph.
    **options
        Further arguments of `Planner.plan`.
    """
    made: dict[int, Planner] = {}

    def find(env: MlivrEnv) -> list[int] | None:
        graph, start = env.graph, env.state
        given: dict[str, Any] = {} if planner is None else {"start_pose": start.pose}
        if planner is None and id(graph) not in made:
            made.clear()
            made[id(graph)] = Planner(graph)
        result = (planner or made[id(graph)]).plan(
            start if planner is None else start.stance,
            env.goal.tolist(),
            cost,
            method=method,
            goal_tolerance=env.goal_tolerance,
            **given,
            **options,
        )
        if result.plan is None:
            return None
        index = graph.grasp_map.index
        return _actions(env, [(limb, index(point)) for limb, point in result.plan.actions])

    return PlanPolicy(find)


def baseline_policy(method: str, budget: int = 50, seed: int = 0) -> PlanPolicy:
    """Follows walks of `planners.baselines`."""

    def find(env: MlivrEnv) -> list[int] | None:
        where = env.moves, env.state, env.goal, env.goal_tolerance
        return _actions(
            env, find_walk(method, *where, budget=budget, seed=seed + env.steps).actions
        )

    return PlanPolicy(find)


def _actions(env: MlivrEnv, moves: Iterable[tuple[int, int]]) -> list[int]:
    """Actions of moves, each a limb and the index of a point."""
    return [limb * len(env.graph.grasp_map) + point for limb, point in moves]
