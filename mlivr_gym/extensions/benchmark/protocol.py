"""The protocol of the benchmark: environments, tasks, budgets, and what a policy trains in."""

from __future__ import annotations

from functools import cache
from typing import Any

import gymnasium

from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs import MlivrEnv, Observation
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import SettingError
from mlivr_gym.files import read_json
from mlivr_gym.planners import Planner

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


@cache
def environment(name: str) -> MlivrEnv:
    """Return the environment of an id, the same in a process."""
    made = gymnasium.make(f"mlivr_gym:{name}", disable_env_checker=True).unwrapped
    assert isinstance(made, MlivrEnv)
    return made


@cache
def reference(name: str, task: int) -> tuple[float, float]:
    """Return what the cost of a held-out task is compared with, and its bound.

    It is the fewest steps with the layout known, the optimum, or the cost of the best plan known.
    No actions cost less than it over its bound, which is 1 for an optimum. Best plans known are
    stored, since what a search finds in some effort depends on what was checked before.
    """
    known = read_json(asset_path("best_known.json"), "best plans", SettingError)
    if name in known:
        return tuple(known[name][task])
    env = environment(name)
    _, info = env.reset(options={"task": task})
    if "fewest_steps" in info:
        return float(info["fewest_steps"]), 1.0
    cost, within = env.reward.cost, env.goal_tolerance
    plan = Planner(env.graph).plan(env.state, env.goal, cost, goal_tolerance=within).unwrap()
    assert plan.statistics.bound is not None
    return plan.cost, plan.statistics.bound


class TrainingEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment to learn in, which counts its steps and refuses more than the budget has.

    Episodes are truncated after `MAX_ACTIONS`, and held-out tasks are refused. `environment_steps`
    is the number of steps so far.
    """

    def __init__(self, env: MlivrEnv, budget: int) -> None:
        """Wrap an environment; `budget` is the number of its steps."""
        super().__init__(gymnasium.wrappers.TimeLimit(env, MAX_ACTIONS))
        self.budget, self.environment_steps, self._inner = budget, 0, env

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; see `MlivrEnv.reset`.

        Raises a `SettingError` for a fixed task, since the fixed tasks are held out.
        """
        if options and options.get("task") is not None:
            raise SettingError("fixed tasks are held out; train with seeds below 2^62")
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take an action, which counts as a step.

        Raises a `SettingError` when the budget is spent.
        """
        if self.environment_steps >= self.budget:
            raise SettingError(f"the budget of {self.budget} environment steps is spent")
        self.environment_steps += 1
        return self.env.step(action)

    def action_masks(self) -> BoolArray:
        """Return which actions are valid; see `MlivrEnv.action_masks`."""
        return self._inner.action_masks()
