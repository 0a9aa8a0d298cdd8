"""Policies that need no training: random actions, the optimal expert, and followers of plans."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np

from mlivr_gym.arguments import SEED, checked
from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation
from mlivr_gym.errors import SettingError
from mlivr_gym.planners import Planner
from mlivr_gym.planners.baselines import BASELINE, find_walk
from mlivr_gym.planners.cost_to_go import CostToGo
from mlivr_gym.planners.costs import Cost
from mlivr_gym.planners.query import QUERY, Goal
from mlivr_gym.planners.table_values import TableValues, in_goal_region
from mlivr_gym.sharing import Independent
from mlivr_gym.stances.moves import TableMoves
from mlivr_gym.stances.stance_graph import StanceGraph


class Policy(Protocol):
    """Interface of a policy, which chooses actions in a `MlivrEnv`.

    A policy may use the environment itself beside the observation: its state, and its steps as a
    model. One that keeps a memory of the episode clears it where `env.steps` is 0.

    What stable-baselines3 calls a policy is an actor-critic here, see `networks`; `LearnedPolicy`
    makes a policy of it.
    """

    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """Return the action `limb * m + point` to take in an environment, which is unwrapped.

        The mask, shape (N m,), says whether each action is valid. At least one is, unless points or
        obstacles of the world have changed, or a grasp has failed; any action may be returned if
        none is.
        """
        ...


class RandomPolicy(Independent):
    """Policy that draws uniformly from the valid actions."""

    @checked({"seed": SEED})
    def __init__(self, seed: int = 0) -> None:
        """Start the random numbers from a seed."""
        self._rng = np.random.default_rng(seed)

    @checked()
    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """Return a random valid action; see `Policy.act`."""
        return int(self._rng.choice(np.flatnonzero(mask))) if mask.any() else 0


class ExpertPolicy(Independent):
    """Policy that takes the first step of an optimal plan, by the exact cost-to-go.

    It is for two limbs, and for rewards by a cost. Where grasps may fail, the cost
    is the expected cost of plans that repeat a failed step until it succeeds, an upper bound of the
    least expected cost, see `planners.table_values.expected_prices`. The first action makes the
    environment compute all its steps, or read them from a table (`MlivrEnv.table_moves`).

    Examples
    --------
    >>> import gymnasium
    >>> env = gymnasium.make("mlivr_gym:MLIVR-JEM-v0").unwrapped
    >>> observation, info = env.reset(seed=0)
    >>> action = ExpertPolicy().act(env, observation, env.action_masks())
    >>> bool(env.action_masks()[action])
    True
    """

    @checked()
    def __init__(self, expect_failures: bool = True) -> None:
        """Start without costs; those to a goal are computed when it first occurs, as far as needed.

        Where grasps may fail, costs are expected costs; without `expect_failures`, every grasp is
        assumed to succeed.
        """
        self._expect = expect_failures
        self._moves: TableMoves | None = None
        self._key: tuple[Cost, bytes, float, bytes] | None = None
        self._most = 0.0

    @checked()
    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """Return an optimal action for the reward of the environment, the first one if several are.

        Raises a `SettingError` if the robot has more than two limbs, the reward is an object of the
        user, or the environment has an action beside the steps.
        """
        if mask.size != env.graph.limbs * len(env.graph.grasp_map):
            raise SettingError(
                f"the expert policy chooses among steps alone; {type(env).__name__} has another "
                "action"
            )
        if env.state.pose is not None:
            # The table lacks this state; failures of its first grasp are not considered.
            moves, points = env.table_moves(), len(env.graph.grasp_map)
            steps = moves.successors(env.state)
            exact = CostToGo(_two_limbs(env), Goal(env.goal, env.goal_tolerance, env.reward.cost))
            best = exact.best(env.state, steps)
            return int(steps.limb[best] * points + steps.point[best])
        costs = self._least_costs(env)
        # If no action leads to the goal, the first valid one is taken.
        return int(np.argmax(mask & (costs <= costs.min() + 1e-9)))

    @checked()
    def costs(self, env: MlivrEnv) -> Array:
        """Return the least expected cost of a plan that begins with each action, shape (2 m,).

        It is infinite where no plan leads to the goal. The present state must be one of the graph's
        own, without a pose; errors are those of `act`.
        """
        return self._costs_up_to(env, np.inf)

    def _least_costs(self, env: MlivrEnv) -> Array:
        """Return the costs of the best actions and, of others, these or infinities, shape (2 m,).

        They are sought among larger and larger costs, since most goals are a few steps away.
        """
        graph, cost = _two_limbs(env), env.reward.cost
        base = env.moves.stance_properties(env.state).base_position
        away = np.asarray(np.linalg.norm(base - env.goal))
        longest = graph.max_displacement
        least = float(cost.heuristic("consistent", away, env.goal_tolerance, longest))
        for steps in (0.0, 1.0, 2.0, 4.0, np.inf):
            most = least + steps * (cost.step_weight + cost.base_weight * longest)
            costs = self._costs_up_to(env, most)
            if costs.min() <= self._most:
                break
        return costs

    def _costs_up_to(self, env: MlivrEnv, most: float) -> Array:
        """Return what `costs` does, where some costs above `most` may be infinite.

        Known costs are taken if they go as far; how far they go is `_most`.
        """
        graph = _two_limbs(env)
        moves = env.table_moves()
        risk = env.failure_probability if self._expect else np.zeros(len(graph.grasp_map))
        cost = env.reward.cost
        key = (cost, env.goal.tobytes(), env.goal_tolerance, risk.tobytes())
        if self._moves is not moves or self._key != key or self._most < most:
            self._moves, self._key, self._most = moves, key, most
            goals = in_goal_region(moves.tables, env.goal[None], env.goal_tolerance)
            self._values = TableValues(moves.tables, goals, cost, risk, most)
        s = np.array([moves.stance_at[env.state.stance]], dtype=np.int64)
        branch_sets, none = np.array([env.state.branch_sets]), np.zeros(1, dtype=np.int64)
        found: Array = self._values.of_actions(s, branch_sets, none, 2 * len(graph.grasp_map))[0]
        return found


def _two_limbs(env: MlivrEnv) -> StanceGraph:
    """Return the graph of an environment of two limbs; refuse others."""
    if not env.graph.lists_all:
        raise SettingError(
            f"the expert policy needs two limbs; robot {env.graph.robot.name!r} has "
            f"{env.graph.limbs}"
        )
    return env.graph


class PlanPolicy(Independent):
    """Policy that follows plans, and plans again when the stance is not the one expected.

    It also plans again when an episode begins, or the goal or the world has changed. `plans` is the
    number of plans made so far.
    """

    @checked()
    def __init__(self, find: Callable[[MlivrEnv], list[int] | None]) -> None:
        """Take a function that returns the actions from the present state to the goal, or None."""
        self._find = find
        self._actions: list[int] = []
        self._expected: tuple[int, ...] | None = None
        self._goal, self._version = b"", -1
        self.plans = 0

    @checked()
    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """Return the next action of the plan, or an invalid action if no plan is found."""
        known = env.goal.tobytes() == self._goal and env.graph.version == self._version
        if env.state.stance != self._expected or not known or env.steps == 0:
            self._actions = (self._find(env) or [])[::-1]
            self._goal, self._version = env.goal.tobytes(), env.graph.version
            self.plans += 1
        if not self._actions:
            self._expected = None
            return int(np.argmin(mask)) if mask.size else 0
        action = self._actions.pop()
        self._expected = env.state.stance_after(*divmod(action, len(env.graph.grasp_map)))
        return action


@checked(QUERY)
def planner_policy(
    cost: str | Cost = "steps", planner: Planner | None = None, **options: Any
) -> PlanPolicy:
    """Return a policy that follows plans of a `Planner`.

    By default the planner plans on the stance graph of the environment, from the present state:
    after a failed grasp a limb may be on only some of its branches. A planner for another graph of
    the same map, for example without thresholds, plans from the present stance, and its plans are
    followed whether their actions are valid or not. Cost and options are arguments of
    `Planner.plan`.

    Examples
    --------
    >>> import gymnasium
    >>> from mlivr_gym.agents import evaluate
    >>> env = gymnasium.make("mlivr_gym:MLIVR-JEM-v0").unwrapped
    >>> evaluate(env, planner_policy("base"), episodes=1).success_rate
    1.0
    """
    return PlanPolicy(_Planned(planner, cost, options))


@checked(BASELINE)
def baseline_policy(method: str, budget: int = 50, seed: int = 0) -> PlanPolicy:
    """Return a policy that follows the action sequences of a method of `planners.baselines`.

    The arguments are those of `find_walk`.
    """
    return PlanPolicy(partial(_walk_actions, method, budget, seed))


@dataclass
class _Planned:
    """Function that returns the actions of a plan, see `planner_policy`, or None without one."""

    given: Planner | None
    """Planner of the user."""
    cost: str | Cost
    options: dict[str, Any]
    made: Planner | None = None
    """Planner on the graph of the environment, if none is given."""

    def __call__(self, env: MlivrEnv) -> list[int] | None:
        start: dict[str, Any] = {"start": env.state}
        if self.given is not None:
            start = {"start": env.state.stance, "start_pose": env.state.pose}
        elif self.made is None or self.made.graph is not env.graph:
            self.made = Planner(env.graph)
        planner = self.given or self.made
        assert planner is not None
        plan = planner.plan(
            goal=env.goal.tolist(), cost=self.cost, goal_tolerance=env.goal_tolerance,
            **start, **self.options,
        ).plan  # fmt: skip
        if plan is None:
            return None
        index = env.graph.grasp_map.index
        return _action_numbers(env, [(limb, index(point)) for limb, point in plan.actions])


def _walk_actions(method: str, budget: int, seed: int, env: MlivrEnv) -> list[int]:
    """Return the actions of the walk that a method of `planners.baselines` finds."""
    where = env.moves, env.state, env.goal, env.goal_tolerance
    walk = find_walk(method, *where, budget=budget, seed=seed + env.steps)
    return _action_numbers(env, walk.actions)


def _action_numbers(env: MlivrEnv, actions: Iterable[tuple[int, int]]) -> list[int]:
    """Return the numbers of actions, each given by a limb and the index of a point."""
    return [limb * len(env.graph.grasp_map) + point for limb, point in actions]
