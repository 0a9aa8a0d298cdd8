"""Measure expert, greedy and random policy on the fixed tasks of `MLIVR-Random-v0`.

    python experiments/random_layouts.py [--tasks 200] [--out results] [--workers 2]

Each fixed task has a layout of its own. The protocol is that of `docs/benchmark.md`. Writes
`random_layouts.json` and `random_layouts.md`; takes a minute.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import gymnasium
import numpy as np
from reports import CORES, experiment, study_rows, table, with_interval

import mlivr_gym  # noqa: F401
from mlivr_gym.agents import (
    EvaluationTask,
    ExpertPolicy,
    Policy,
    RandomPolicy,
    baseline_policy,
    evaluate,
)
from mlivr_gym.agents.evaluation import bootstrap
from mlivr_gym.envs import MlivrEnv

MOST_STEPS = 60
"""Steps after which an episode counts as failed."""

POLICIES: dict[str, Policy] = {
    "expert": ExpertPolicy(), "greedy": baseline_policy("local"), "random": RandomPolicy(),
}  # fmt: skip
"""The policies by name."""


def fixed_tasks(env: MlivrEnv, numbers: Iterable[int]) -> tuple[list[EvaluationTask], list[int]]:
    """Return fixed tasks and the fewest steps of each."""
    tasks, fewest = [], []
    for k in numbers:
        info = env.reset(options={"task": k})[1]
        occupied = env.graph.ids(sorted(env.graph.occupied))
        tasks.append(EvaluationTask(info["stance"], tuple(env.goal.tolist()), occupied))
        fewest.append(info["fewest_steps"])
    return tasks, fewest


def protocol(
    env: MlivrEnv, policy: Policy, tasks: list[EvaluationTask], fewest: list[int]
) -> dict[str, Any]:
    """Return success, steps, steps over the fewest, and base translation of a policy."""
    result = evaluate(env, policy, tasks, max_steps=MOST_STEPS)
    done = result.success
    means = {
        "steps": result.steps[done],
        "over_fewest": (result.steps / np.array(fewest))[done],
        "base_translation_m": result.base_translation[done],
    }
    return {
        "success": result.success_rate,
        "success_interval": bootstrap(done.astype(float)),
        **{name: float(one.mean()) if done.any() else None for name, one in means.items()},
    }


def of_policy(task: int, policy: str, count: int) -> dict[str, Any]:
    """Return the results of a policy, with the fewest steps and the occupied share of each task."""
    env = gymnasium.make("MLIVR-Random-v0", disable_env_checker=True).unwrapped
    assert isinstance(env, MlivrEnv)
    fixed, fewest = fixed_tasks(env, range(count))
    shares = [len(one.occupied) / len(env.graph.grasp_map) for one in fixed]
    found = protocol(env, POLICIES[policy], fixed, fewest)
    return {"results": found, "fewest": fewest, "shares": shares}


def measured(tasks: int, workers: int) -> dict[str, Any]:
    """Return the results of each policy."""
    kind, policies = "random_layouts:of_policy", list(POLICIES)
    rows = study_rows(kind, 1, workers, policy=policies, count=[tasks])
    fewest, shares = rows[0]["fewest"], rows[0]["shares"]
    return {
        "tasks": tasks,
        "occupied": [min(shares), max(shares)],
        "fewest_steps": dict(sorted(Counter(fewest).items())),
        "policies": {row["policy"]: row["results"] for row in rows},
    }


def markdown(data: dict[str, Any]) -> str:
    """Return the report."""
    counts = {int(steps): count for steps, count in data["fewest_steps"].items()}
    mean = sum(steps * count for steps, count in counts.items()) / data["tasks"]
    low, high = (round(100 * share) for share in data["occupied"])
    rows = [
        (
            name,
            with_interval(row["success"], row["success_interval"]),
            f"{row['over_fewest']:.2f}",
            f"{row['steps']:.1f}",
            f"{row['base_translation_m']:.2f}",
        )
        for name, row in data["policies"].items()
    ]
    head = "policy | success [95 % interval] | steps over fewest | steps | base translation [m]"
    return f"""# Baselines on `MLIVR-Random-v0`

Fixed tasks 0 to {data["tasks"] - 1}, each with a layout of its own, in which {low} to {high} % of \
the points are occupied. Optimal plans have {min(counts)} to {max(counts)} steps, {mean:.2f} on
average. An episode fails after {MOST_STEPS} steps or with an invalid action. Expert: the first step
of an optimal plan. Greedy: the step whose base is closest to the goal, to a stance that was not
held before. Random: any valid action. Steps and base translation are means over successful
episodes.

{table(head, rows)}
`experiments/random_layouts.py` makes this page.
"""


if __name__ == "__main__":
    experiment("random_layouts", __doc__, measured, markdown, tasks=200, workers=CORES)
