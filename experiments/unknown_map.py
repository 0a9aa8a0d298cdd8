"""Measure policies on the fixed tasks of `MLIVR-JEM-Unknown-v0`, whose layouts nobody has seen.

    python experiments/unknown_map.py [--tasks 500] [--workers 2] [--out results]

Each fixed task has a layout of its own. Writes `unknown_map.json` and `unknown_map.md`; takes half
an hour on two cores.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import gymnasium
import numpy as np
from reports import CORES, NOTHING, experiment, study_rows, table, with_interval

import mlivr_gym  # noqa: F401
from mlivr_gym.agents import Policy, RandomPolicy, policy_by_name
from mlivr_gym.agents.evaluation import bootstrap
from mlivr_gym.extensions.closed_loop import LookingPolicy, UnknownMapEnv

MOST_ACTIONS = 60
"""Actions after which an episode counts as failed."""

POLICIES = {
    "optimistic": "A* on the points not known to be occupied, again whenever more is known",
    "expected": "the first step of least expected cost, if grasps of unknown points fail with the \
prior probability, each time anew",
    "pretrained": "the pointer policy that ships, which was trained with known layouts",
    "greedy": "the step whose base is closest to the goal, to a stance not held before",
    "random": "any valid step",
}
"""What chooses the steps, by name."""

VARIANTS = {True: list(POLICIES), False: ["optimistic", "expected"]}
"""Those that are measured with and without looks."""


@cache
def made_env() -> UnknownMapEnv:
    """Return the environment, one for each process."""
    env = gymnasium.make("MLIVR-JEM-Unknown-v0", disable_env_checker=True).unwrapped
    assert isinstance(env, UnknownMapEnv)
    return env


@cache
def steps_by(name: str) -> Policy:
    """Return what chooses the steps, by name, one for each process."""
    names = {"optimistic": "astar", "expected": "expert", "greedy": "local"}
    return policy_by_name(names.get(name, name), made_env())


def episode(task: int, policy: str, look: bool) -> dict[str, Any]:
    """Return the results of a policy on a fixed task."""
    steps = RandomPolicy(task) if policy == "random" else steps_by(policy)
    env, chosen = made_env(), LookingPolicy(steps, look)
    observation, info = env.reset(options={"task": task})
    cost, failed, ended = 0.0, 0, False
    while not ended and info["steps"] < MOST_ACTIONS and not info["invalid_action"]:
        action = chosen.act(env, observation, env.action_masks())
        observation, reward, ended, _, info = env.step(action)
        cost, failed = cost - reward, failed + info["grasp_failed"]
    return {
        "success": bool(info["is_success"]), "cost": cost, "fewest": info["fewest_steps"],
        "attempts": info["steps"] - info["looks"], "failed": failed, "looks": info["looks"],
        "base_translation_m": info["base_translation"],
    }  # fmt: skip


def measured(tasks: int, workers: int) -> dict[str, Any]:
    """Return the results of each policy, and of those that plan also without looks."""
    rows, found = [], []
    for look, names in VARIANTS.items():
        some = study_rows("unknown_map:episode", tasks, workers, policy=names, look=[look])
        rows += some
        for name in names:
            of_policy = [row for row in some if row["policy"] == name]
            success = np.array([row["success"] for row in of_policy], dtype=float)
            # An episode that fails is charged as one of the most actions.
            cost = [row["cost"] if row["success"] else MOST_ACTIONS for row in of_policy]
            found.append({
                "policy": name, "look": look, "success": float(success.mean()),
                "success_interval": bootstrap(success), "cost": float(np.mean(cost)),
                "cost_interval": bootstrap(np.array(cost)),
                **means([row for row in of_policy if row["success"]]),
            })  # fmt: skip
    fewest = {row["fewest"] for row in rows}
    return {
        "tasks": tasks,
        "fewest": [min(fewest), max(fewest)],
        "fewest_mean": float(np.mean([row["fewest"] for row in rows])),
        "policies": found,
    }


def means(rows: list[dict[str, Any]]) -> dict[str, float | None]:
    """Return the means of some results, None without episodes."""
    names = "attempts", "failed", "looks", "base_translation_m"
    return {n: float(np.mean([row[n] for row in rows])) if rows else None for n in names}


def markdown(data: dict[str, Any]) -> str:
    """Return the report."""
    rows = []
    for row in data["policies"]:
        chosen = [row[name] for name in ("attempts", "failed", "looks", "base_translation_m")]
        rows.append((
            f"{row['policy']}, {'looks' if row['look'] else 'never looks'}",
            with_interval(row["success"], row["success_interval"]),
            with_interval(row["cost"], row["cost_interval"], 1, percent=False),
            *(NOTHING if value is None else f"{value:.1f}" for value in chosen),
        ))  # fmt: skip
    head = (
        "policy | success [95 % interval] | cost [95 % interval] | attempts | of them failed | "
        "looks | base translation [m]"
    )
    named = "\n".join(f"* **{name}**: {what}." for name, what in POLICIES.items())
    low, high = data["fewest"]
    return f"""# Baselines on `MLIVR-JEM-Unknown-v0`

Fixed tasks 0 to {data["tasks"] - 1}, each with a layout of its own. An attempt to grasp costs 1,
whether it fails or not, and a look 0.5. With the layout known, optimal plans have {low} to {high}
steps, {data["fewest_mean"]:.2f} on average: no policy costs less. An episode fails after
{MOST_ACTIONS} actions or with an invalid one, and is then charged {MOST_ACTIONS}. A policy that
looks does so before it grasps a point that it has not seen. The last four columns are means over
successful episodes. The steps are chosen thus:

{named}

{table(head, rows)}
`experiments/unknown_map.py` makes this page.
"""


if __name__ == "__main__":
    experiment("unknown_map", __doc__, measured, markdown, tasks=500, workers=CORES)
