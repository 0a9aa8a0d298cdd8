"""Running a policy through the benchmark, and checking an entry by running its actions again."""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from importlib import import_module, metadata
from itertools import product
from pathlib import Path
from typing import Any

from mlivr_gym import __version__
from mlivr_gym.agents import Policy
from mlivr_gym.agents.evaluation import run_episode
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs import MlivrEnv, Observation
from mlivr_gym.errors import SettingError, shortened
from mlivr_gym.extensions.benchmark.entry import (
    BY_SEED,
    BenchmarkEntry,
    BenchmarkError,
    EpisodeRow,
    results_of,
)
from mlivr_gym.extensions.benchmark.protocol import (
    BUDGETS,
    ENVIRONMENT_IDS,
    MAX_ACTIONS,
    TASKS,
    TrainingEnv,
    environment,
    reference,
)
from mlivr_gym.settings import GRAPH_RULES, check_rules

SEEDS = 3
"""Number of seeds with which a policy is trained."""


class FunctionPolicy:
    """Policy of a function of observation and mask."""

    def __init__(self, function: Callable[[Observation, BoolArray], Any]) -> None:
        """Take the function, which returns an action."""
        self._function = function

    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """Return the action of the function, which the environment checks."""
        action: int = self._function(observation, mask)
        return action


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


def run(
    place: str,
    budget: str,
    seeds: int | None = None,
    environments: Sequence[str] = ENVIRONMENT_IDS,
    tasks: int = TASKS,
    *,
    entry: BenchmarkEntry | None = None,
    save: Callable[[BenchmarkEntry], None] = lambda entry: None,
    progress: Callable[[int], None] = lambda done: None,
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
    if entry is None:
        uses = "environment" if isinstance(make, type) else "observation"
        counts = {"seeds": 0} | dict.fromkeys(BY_SEED, ())
        entry = BenchmarkEntry(told | {"uses": uses} | _machine() | counts, ())
    for name, value in told.items():
        if entry.summary[name] != value:
            raise SettingError(f"the entry has {name} {entry.summary[name]!r}, not {value!r}")
    for seed, name in product(range(seeds or (SEEDS if learns else 1)), environments):
        if (name, seed) in entry.parts:
            continue
        training = TrainingEnv(environment(name), BUDGETS[budget])
        began = time.process_time()
        policy: Any = make()
        if learns:
            policy.train(training, seed)
        steps = max(training.environment_steps, int(getattr(policy, "environment_steps", 0)))
        if steps > BUDGETS[budget]:
            raise SettingError(f"policy {place!r} learned from {steps} steps; {budget} is less")
        rows = list[EpisodeRow]()
        for task in range(tasks):
            rows.append(episode_row(name, seed, task, policy))
            progress(len(entry.rows) + len(rows))
        entry = entry.with_part(rows, steps, round(time.process_time() - began, 3))
        save(entry)
    return entry


def episode_row(name: str, seed: int, task: int, policy: Policy) -> EpisodeRow:
    """Return the episode of a policy, trained with a seed, in a task of an environment."""
    found = run_episode(environment(name), policy, {"task": task}, None, MAX_ACTIONS)
    times = tuple(round(1e3 * seconds, 3) for seconds in found.decisions)
    told = found.success, -float(found.total_reward), *reference(name, task)
    return EpisodeRow(name, seed, task, *told, found.actions, times)


def _machine() -> dict[str, Any]:
    """Return versions and machine, as a summary tells them."""
    packages = ("gymnasium", "numba", "numpy")
    return {
        "versions": {"mlivr-gym": __version__, "python": platform.python_version()}
        | {name: metadata.version(name) for name in packages},
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors",
    }


def check(
    folder: str | Path, tasks: int = TASKS, progress: Callable[[int], None] = lambda done: None
) -> BenchmarkEntry:
    """Return the entry in a folder if it adds up.

    Each environment must have the first `tasks` tasks for each seed. Their actions are replayed;
    success, cost, reference and what the summary tells must follow. Raises a `BenchmarkError` that
    names the first fault.
    """
    entry = BenchmarkEntry.read(folder)
    summary, rows = entry.summary, entry.rows
    check_rules("the entry", summary["graph_rules"], "run it again", BenchmarkError)
    if summary["tasks"] != tasks:
        raise BenchmarkError(f"the entry has {summary['tasks']} tasks; it must have {tasks}")
    seeds = {name: result["seeds"] for name, result in results_of(rows).items()}
    expected = [(name, *at) for name, n in seeds.items() for at in product(range(n), range(tasks))]
    if [row[:3] for row in rows] != expected or not rows:
        raise BenchmarkError(f"the episodes are not those of {tasks} tasks and each seed in turn")
    _same("seeds", summary["seeds"], max(seeds.values()))
    most = max(summary["environment_steps"], default=0)
    if most > BUDGETS[summary["budget"]]:
        raise BenchmarkError(f"it learned from {most} steps, more than {summary['budget']} has")
    for k, row in enumerate(rows):
        _check_row(row)
        progress(k + 1)
    _same("results", summary["results"], results_of(rows))
    return entry


def _check_row(row: EpisodeRow) -> None:
    """Replay an episode; the error names what does not follow."""
    place, actions = f"{row.environment}, seed {row.seed}, task {row.task}", iter(row.actions)
    replay = FunctionPolicy(lambda observation, mask: next(actions))
    try:
        found = episode_row(row.environment, row.seed, row.task, replay)
    except StopIteration:
        text = f"{place}: the episode goes on after its {len(row.actions)} actions"
        raise BenchmarkError(text) from None
    for name in ("success", "cost", "reference", "bound", "actions"):
        _same(f"{place}: {name}", getattr(row, name), getattr(found, name))
    _same(f"{place}: number of times", len(row.milliseconds), len(row.actions))


def _same(place: str, told: Any, found: Any) -> None:
    """Refuse what is told if it differs from what was found."""
    if told != found:
        raise BenchmarkError(f"{place} is told as {told!r}; the replay gives {found!r}")
