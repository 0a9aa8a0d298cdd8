"""The protocol of the benchmark: environments, tasks, budgets, and what a policy trains in."""

from __future__ import annotations

import json
from functools import cache
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from mlivr_gym.agents import ExpertPolicy, Policy, planner_policy
from mlivr_gym.agents.evaluation import Episode, run_episode
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs import MlivrEnv, Observation
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import SettingError
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
        self.name, self.env = name, made
        self._known: dict[int, BestPlan] = {}

    def run(self, policy: Policy, task: int) -> tuple[Episode, BestPlan]:
        """Return the episode of a policy in a task, and the reference."""
        episode = run_episode(self.env, policy, {"task": task}, None, MAX_ACTIONS)
        if task not in self._known:
            self._known[task] = self._reference(task, episode)
        return episode, self._known[task]

    def _reference(self, task: int, episode: Episode) -> BestPlan:
        """Return the fewest steps with the layout known, the optimum, or the best plan known."""
        fewest = episode.start.get("fewest_steps")
        if fewest is not None:
            return BestPlan(float(fewest), 1.0)
        if not self.env.graph.lists_all:
            return best_known(self.name)[task]
        goal = Goal(self.env.goal, self.env.goal_tolerance, self.env.reward.cost)
        search = SearchQuery.from_options(self.env.graph, goal)
        found = GraphSearcher(self.env.graph).find(search, episode.states[0])
        assert found is not None
        return BestPlan(found.cost, found.bound)


@cache
def best_known(name: str) -> list[BestPlan]:
    """Return the best plans known of an environment's tasks, found by `experiments/best_known.py`.

    They are stored, since what a search finds in some effort depends on what was checked before.
    """
    data = json.loads(asset_path("best_known.json").read_text(encoding="utf-8"))
    return [BestPlan(*plan) for plan in data[name]]


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
