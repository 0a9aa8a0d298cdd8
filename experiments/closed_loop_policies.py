"""Measure policies on the fixed tasks of `MLIVR-JEM-ClosedLoop-v0`, whose things nobody has seen.

    python experiments/closed_loop_policies.py [--tasks 30] [--workers 2] [--out results]

Writes `closed_loop_policies.json` and `closed_loop_policies.md`. All steps are simulated, so that
an episode takes from some seconds to a minute.
"""

from __future__ import annotations

from collections import Counter
from functools import cache
from typing import Any

import gymnasium
import numpy as np
from reports import (
    CORES,
    NOTHING,
    counted,
    experiment,
    figures_of,
    study_rows,
    table,
    with_interval,
)
from scipy.stats import binomtest

import mlivr_gym  # noqa: F401
from mlivr_gym.agents import Policy, RandomPolicy, policy_by_name
from mlivr_gym.extensions.closed_loop import BOXES, PLATES, ClosedLoopEnv, ReplanningPolicy

MOST_ACTIONS = 20
"""Actions after which an episode counts as failed."""

POLICIES = {
    "replanning": "a plan of the fewest steps in what is believed, again before each action",
    "pretrained": "the pointer policy that ships, which was trained without obstacles",
    "greedy": "the step whose base is closest to the goal, to a stance not held since something "
    "new was seen",
    "random": "any valid step",
}
"""What chooses the steps, by name."""

OTHERS = "pretrained", "greedy", "random"
"""Policies that choose among steps alone."""

VARIANTS = (("replanning", True), ("replanning", False), *((name, True) for name in OTHERS))
"""Policies, and whether the robot has cameras, in the order of the table."""

MOST_TASKS = {"pretrained": 20, "greedy": 12, "random": 6}
"""Policies whose episodes take longest, and their largest numbers of tasks."""


@cache
def made_env(cameras: bool) -> ClosedLoopEnv:
    """Return the environment, one for each process, with cameras or blind."""
    options = {} if cameras else {"camera": None}
    made = gymnasium.make("MLIVR-JEM-ClosedLoop-v0", disable_env_checker=True, **options)
    env = made.unwrapped
    assert isinstance(env, ClosedLoopEnv)
    return env


@cache
def steps_by(name: str, cameras: bool) -> Policy:
    """Return what chooses the steps, by name, one for each process."""
    if name == "replanning":
        return ReplanningPolicy()
    return policy_by_name("local" if name == "greedy" else name, made_env(cameras))


def episode(task: int, policy: str, cameras: bool) -> dict[str, Any]:
    """Return the results of a policy on a fixed task.

    Where no step is valid, each policy relaxes, see `ClosedLoopEnv`.
    """
    chosen = RandomPolicy(task) if policy == "random" else steps_by(policy, cameras)
    env = made_env(cameras)
    observation, info = env.reset(seed=task, options={"task": task})
    ended = info["is_success"]
    while not ended and info["steps"] < MOST_ACTIONS and not info["invalid_action"]:
        mask = env.action_masks()
        if policy in OTHERS:
            mask = mask[:-1]
        action = chosen.act(env, observation, mask) if mask.any() else len(mask)
        observation, _, ended, _, info = env.step(action)
    record = env.record
    return {
        "success": bool(info["is_success"]), "steps": info["steps"], "fewest": info["fewest_steps"],
        "end": end_of(info), "duration": record.events[-1].time if record.events else 0.0,
        "peak_force": record.peak_force, "base_translation_m": info["base_translation"],
    }  # fmt: skip


def end_of(info: dict[str, Any]) -> str:
    """Return how an episode ended, from the last information."""
    if info["is_success"]:
        return "arrived"
    if info["is_stopped"]:
        return "stopped"
    if info["failure"]:
        return str(info["failure"]["kind"])
    return "invalid action" if info["invalid_action"] else f"{MOST_ACTIONS} actions"


def measured(tasks: int, workers: int) -> dict[str, Any]:
    """Return all episodes."""
    rows = []
    for name, cameras in VARIANTS:
        some = min(tasks, MOST_TASKS.get(name, tasks))
        rows += study_rows(
            "closed_loop_policies:episode", some, workers, policy=[name], cameras=[cameras]
        )
    return {"tasks": tasks, "episodes": [{"task": row["task"]} | figures_of(row) for row in rows]}


def row_of(name: str, episodes: list[dict[str, Any]]) -> list[str]:
    """Return the table row of a policy."""
    arrived = [one for one in episodes if one["success"]]
    ends = Counter(one["end"] for one in episodes if not one["success"])
    steps, fewest, time = (
        np.array([one[key] for one in arrived]) for key in ("steps", "fewest", "duration")
    )
    means = [f"{steps.mean():.1f}", f"{steps.sum() / fewest.sum():.2f}", f"{time.mean():.0f}"]
    return [
        name, *share_of(len(arrived), len(episodes)), *(means if arrived else 3 * [NOTHING]),
        f"{max(one['peak_force'] for one in episodes):.0f}", counted(ends) or "0",
    ]  # fmt: skip


def share_of(count: int, episodes: int) -> tuple[str, str]:
    """Return the number of episodes, and the share that arrived with its Wilson interval."""
    interval = binomtest(count, episodes).proportion_ci(method="wilson")
    return str(episodes), with_interval(count / episodes, interval)


def markdown(data: dict[str, Any]) -> str:
    """Return the report."""
    rows, found = [], data["episodes"]
    for name, cameras in VARIANTS:
        some = [one for one in found if (one["policy"], one["cameras"]) == (name, cameras)]
        rows.append(row_of(name if cameras else f"{name}, blind", some))
    fewest = {one["task"]: one["fewest"] for one in found}
    possible = [steps for steps in fewest.values() if steps >= 0]
    hindsight = ["in hindsight", *share_of(len(possible), len(fewest))]
    rows.insert(0, [*hindsight, f"{np.mean(possible):.1f}", "1.00", *(3 * [NOTHING])])
    head = (
        "policy | episodes | success [95 % interval] | steps | steps over those in hindsight | "
        "duration [s] | largest grasp force [N] | other ends"
    )
    named = "\n".join(f"* **{name}**: {what}." for name, what in POLICIES.items())
    sighted = [one for one in found if one["cameras"] and one["success"]]
    fewer = sum(one["steps"] < one["fewest"] for one in sighted)
    return f"""# Baselines on `MLIVR-JEM-ClosedLoop-v0`

Fixed tasks 0 to {data["tasks"] - 1}, of which policies with fewer episodes have the first, each
with {BOXES} unknown boxes and {PLATES} points under unknown plates of its own, in MuJoCo without
disturbances. An episode fails after {MOST_ACTIONS} actions, which failed attempts are, too. *In
hindsight* is an optimal plan of a robot that knows everything, from the same start; {fewer} of
{len(sighted)} episodes that arrived with cameras took fewer steps. A blind robot may, where it
passes things nearer than the clearance without touching them. Steps and duration are means over the
episodes that arrived; the force is the largest of all. The steps are chosen thus, and if none is
valid, each policy relaxes ([environment](../docs/environments/closed-loop.md)):

{named}

{table(head, rows)}
The episodes are older than the present belief: a robot without a plan was less cautious in four
stages in place of one.

`experiments/closed_loop_policies.py` makes this page.
"""


if __name__ == "__main__":
    experiment("closed_loop_policies", __doc__, measured, markdown, tasks=30, workers=CORES)
