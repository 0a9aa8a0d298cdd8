"""The protocol of the benchmark: environments, tasks, budgets, and what a policy trains in."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from mlivr_gym.agents import ExpertPolicy, Policy, planner_policy
from mlivr_gym.agents.evaluation import Episode, run_episode
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs import MlivrEnv, Observation
from mlivr_gym.errors import SettingError
from mlivr_gym.planners import SearchOptions
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.planners.searches import GraphSearcher

ENVIRONMENT_IDS = (
    "MLIVR4-JEM-Anywhere-v0",
    "MLIVR-JEM-Unknown-v0",
    "MLIVR-Unseen-v0",
    "MLIVR-JEM-v0",
    "MLIVR-JEM-Far-v0",
    "MLIVR-Random-v0",
)
"""Ids of the environments: those in which learned policies fall short come first."""

TASKS = 200
"""Number of held-out tasks of each environment, the fixed tasks from 0."""

MAX_ACTIONS = 60
"""Number of actions after which an episode counts as failed."""

BUDGETS = {"planner": 0, "100k": 100_000, "5M": 5_000_000}
"""Environment steps that a policy may learn from on each environment; a planner learns nothing."""

EFFORT = 300_000
"""Effort of a search with more than two limbs, doubled until a plan is proved to a bound."""


class BestPlan(NamedTuple):
    """What the cost of a task is compared with."""

    cost: float
    """Cost of the best plan known."""
    bound: float
    """Proved: no actions cost less than `cost / bound`. It is 1 if none cost less."""


class HeldOutTasks:
    """The held-out tasks of an environment, and the reference of each."""

    def __init__(self, name: str) -> None:
        """Make the environment of an id."""
        made = gymnasium.make(f"mlivr_gym:{name}", disable_env_checker=True).unwrapped
        assert isinstance(made, MlivrEnv)
        self.env = made
        self._known: dict[int, BestPlan] = {}

    def run(self, policy: Policy, task: int) -> tuple[Episode, BestPlan]:
        """Return the episode of a policy in a task, and the reference."""
        episode = run_episode(self.env, policy, {"task": task}, None, MAX_ACTIONS)
        if task not in self._known:
            self._known[task] = self._reference(episode)
        return episode, self._known[task]

    def _reference(self, episode: Episode) -> BestPlan:
        """Return the fewest steps with the layout known, or the best plan that a search finds."""
        fewest = episode.start.get("fewest_steps")
        if fewest is not None:
            return BestPlan(float(fewest), 1.0)
        env, graph = self.env, self.env.graph
        goal = Goal(env.goal, env.goal_tolerance, env.reward.cost)
        effort, found = EFFORT, None
        while found is None or found.bound == np.inf:
            options = SearchOptions() if graph.lists_all else SearchOptions(effort=effort)
            search = SearchQuery.from_options(graph, goal, options)
            found, effort = GraphSearcher(graph).find(search, episode.states[0]), 2 * effort
        return BestPlan(found.cost, found.bound)


@cache
def held_out_tasks(name: str) -> HeldOutTasks:
    """Return the held-out tasks of an environment, the same in a process, with what they know."""
    return HeldOutTasks(name)


class TrainingEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment to learn in, which counts its steps and refuses more than the budget has.

    Episodes are truncated after `MAX_ACTIONS`, and held-out tasks are refused. `environment_steps`
    is the number of steps so far, labels of the expert included.
    """

    def __init__(self, env: MlivrEnv, budget: int) -> None:
        """Wrap an environment; `budget` is the number of its steps."""
        super().__init__(gymnasium.wrappers.TimeLimit(env, MAX_ACTIONS))
        self.budget, self.environment_steps, self._inner = budget, 0, env
        self._expert, self._planner = ExpertPolicy(), planner_policy(env.reward.cost)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; see `MlivrEnv.reset`.

        Raises a `SettingError` for a fixed task, since the fixed tasks are held out.
        """
        if options and options.get("task") is not None:
            raise SettingError("fixed tasks are held out; train with seeds below 2^62")
        self._seen, info = self.env.reset(seed=seed, options=options)
        return self._seen, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take an action, which counts as a step.

        Raises a `SettingError` when the budget is spent.
        """
        self._count()
        return self.env.step(action)

    def action_masks(self) -> BoolArray:
        """Return which actions are valid; see `MlivrEnv.action_masks`."""
        return self._inner.action_masks()

    def expert_action(self) -> int:
        """Return an optimal action in the present state, which counts as a step.

        If not all steps are known, it is the next one of a plan, of three and more limbs the first
        plan that is found. Raises a `SettingError` when the budget is spent.
        """
        self._count()
        env = self._inner
        if not (env.graph.lists_all and env.graph.is_complete):
            return self._planner.act(env, self._seen, env.action_masks())
        costs = self._expert.costs(env)
        return int(np.argmax(costs <= costs.min() + 1e-9))

    def _count(self) -> None:
        """Count a step."""
        if self.environment_steps >= self.budget:
            raise SettingError(f"the budget of {self.budget} environment steps is spent")
        self.environment_steps += 1
