"""Running a policy through the benchmark: it trains or loads, and is evaluated on all tasks."""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from importlib import import_module, metadata
from itertools import product
from typing import Any

from mlivr_gym import __version__
from mlivr_gym.agents import Policy
from mlivr_gym.agents.evaluation import Episode
from mlivr_gym.arguments import checked
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs import MlivrEnv, Observation
from mlivr_gym.errors import SettingError, shortened
from mlivr_gym.extensions.benchmark.entry import BenchmarkEntry, EpisodeRow, results_of
from mlivr_gym.extensions.benchmark.protocol import (
    BUDGETS,
    ENVIRONMENT_IDS,
    TASKS,
    BestPlan,
    TrainingEnv,
    held_out_tasks,
)
from mlivr_gym.schema import Choice, FieldPath, Integer, ListOf, OrNone
from mlivr_gym.settings import GRAPH_RULES

SEEDS = 3
"""Number of seeds with which a policy is trained."""


class FunctionPolicy:
    """Policy of a function of observation and mask."""

    def __init__(self, function: Callable[[Observation, BoolArray], Any]) -> None:
        """Take the function, which returns an action."""
        self._function = function

    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """Return the action of the function; a `SettingError` if it is none."""
        place = FieldPath("action of the policy", SettingError)
        return Integer(0, len(mask) - 1).read(self._function(observation, mask), place)


def policy_maker(place: str) -> Callable[[], Policy]:
    """Return a function that makes the policy of a place, `"MODULE:NAME"`.

    The name is that of a function of observation and mask, or of a class without arguments that has
    `act`, see `agents.Policy`, and may have `train(env, seed)`, whose `env` is a `TrainingEnv`. The
    module is sought in the present folder too. Raises a `SettingError` if there is none.
    """
    module, _, name = place.partition(":")
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())  # last, so that no file here hides an installed module
    try:
        policy = getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise SettingError(
            f"policy is {shortened(place)}; it must be MODULE:NAME: {error}"
        ) from None
    if isinstance(policy, type) and callable(getattr(policy, "act", None)):
        return policy
    if isinstance(policy, type) or not callable(policy):
        raise SettingError(f"policy {place!r} is neither a function nor a class with 'act'")
    return lambda: FunctionPolicy(policy)


@checked(
    {
        "budget": Choice(tuple(BUDGETS)),
        "seeds": OrNone(Integer(1, 100)),
        "environments": ListOf(Choice(ENVIRONMENT_IDS), 1, len(ENVIRONMENT_IDS)),
        "tasks": Integer(1, TASKS),
    }
)
def run(
    place: str,
    budget: str,
    seeds: int | None = None,
    environments: Sequence[str] = ENVIRONMENT_IDS,
    tasks: int = TASKS,
    *,
    entry: BenchmarkEntry | None = None,
    save: Callable[[BenchmarkEntry], None] | None = None,
    progress: Callable[[int], None] | None = None,
) -> BenchmarkEntry:
    """Train a policy, see `policy_maker`, within a budget, and return its episodes.

    A policy is made anew for each of `seeds` (by default 3, and 1 for one that is not trained) and
    each environment. One that loads what was learned before, or learns elsewhere, says in its
    attribute `environment_steps` from how many steps. What `entry` has is not run again. `save`
    gets the entry after each environment and seed, and `progress` the number of finished episodes.
    Raises a `SettingError` if an argument cannot be used, or the budget is exceeded.
    """
    make = policy_maker(place)
    learns = hasattr(make, "train")
    if learns and not BUDGETS[budget]:
        raise SettingError(f"policy {place!r} is trained; give it a budget other than {budget!r}")
    told = {"policy": place, "budget": budget, "tasks": tasks, "graph_rules": GRAPH_RULES}
    before = told if entry is None else entry.summary
    for name, value in told.items():
        if before[name] != value:
            raise SettingError(f"the entry has {name} {before[name]!r}, not {value!r}")
    told |= {"uses": "environment" if isinstance(make, type) else "observation", **_machine()}
    for seed, name in product(range(seeds or (SEEDS if learns else 1)), environments):
        if entry is not None and (name, seed) in entry.parts:
            continue
        held_out, rows = held_out_tasks(name), list[EpisodeRow]()
        training = TrainingEnv(held_out.env, BUDGETS[budget])
        began = time.process_time()
        policy: Any = make()
        if learns:
            policy.train(training, seed)
        steps = max(training.environment_steps, int(getattr(policy, "environment_steps", 0)))
        if steps > BUDGETS[budget]:
            raise SettingError(f"policy {place!r} learned from {steps} steps; {budget} is less")
        for task in range(tasks):
            rows.append(_row(name, seed, task, held_out.run(policy, task)))
            if progress is not None:
                progress(len(rows) + (0 if entry is None else len(entry.rows)))
        spent = round(time.process_time() - began, 3)
        counts = {"seeds": 1, "environment_steps": [steps], "processor_seconds": [spent]}
        part = BenchmarkEntry(told | counts | {"results": results_of(rows)}, tuple(rows))
        entry = part if entry is None else entry.joined(part)
        if save is not None:
            save(entry)
    assert entry is not None
    return entry


def _machine() -> dict[str, Any]:
    """Return versions and machine, as a summary tells them."""
    packages = ("gymnasium", "numba", "numpy")
    return {
        "versions": {"mlivr-gym": __version__, "python": platform.python_version()}
        | {name: metadata.version(name) for name in packages},
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors",
    }


def _row(name: str, seed: int, task: int, result: tuple[Episode, BestPlan]) -> EpisodeRow:
    """Return the row of an episode in a task with its reference."""
    found, reference = result
    times = tuple(round(1e3 * seconds, 3) for seconds in found.decisions)
    cost = -float(found.total_reward)
    return EpisodeRow(name, seed, task, found.success, cost, *reference, found.actions, times)
