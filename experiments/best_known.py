"""Search for the best plans of the benchmark's tasks whose optimum is not known, and store them.

    python experiments/best_known.py [--effort 1000000]

With four limbs no search proves every optimum. For each task the planner searches with an effort,
which is doubled until some bound is proved. Of what is stored and what is found the cheaper plan is
kept, with the better bound. Writes `envs_assets/best_known.json`, which the scores of the benchmark
depend on; takes ten minutes.
"""

from __future__ import annotations

import json

import gymnasium
import numpy as np
from reports import command_line

from mlivr_gym.envs import MlivrEnv
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.extensions.benchmark.protocol import TASKS
from mlivr_gym.files import write_whole
from mlivr_gym.planners import LIMIT_REACHED, Planner, SearchOptions
from mlivr_gym.settings import GRAPH_RULES

NAMES = ("MLIVR4-JEM-Anywhere-v0",)
"""Ids of the environments of the benchmark with more than two limbs."""


def best_plan(env: MlivrEnv, task: int, effort: int) -> tuple[float, float]:
    """Return the number of steps of the plan found for a fixed task, and its bound."""
    env.reset(options={"task": task})
    planner, bound = Planner(env.graph), np.inf
    while bound == np.inf:
        found = planner.plan(
            env.state, env.goal, env.reward.cost, goal_tolerance=env.goal_tolerance,
            options=SearchOptions(effort=effort),
        )  # fmt: skip
        assert found or found.reason == LIMIT_REACHED, found.message
        bound, effort = found.plan.statistics.bound if found.plan else np.inf, 2 * effort
    return float(len(found.unwrap().steps)), bound


def better(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Return the cheaper of two plans of a task, with what both prove."""
    cost = min(one[0], other[0])
    return cost, cost / max(one[0] / one[1], other[0] / other[1])


def main() -> None:
    """Search, and write the file."""
    effort = command_line(__doc__, None, effort=1_000_000).parse_args().effort
    file = asset_path("best_known.json")
    stored = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    if stored.get("rules") != GRAPH_RULES:
        stored = {"rules": GRAPH_RULES}
    for name in NAMES:
        env = gymnasium.make(f"mlivr_gym:{name}", disable_env_checker=True).unwrapped
        assert isinstance(env, MlivrEnv)
        known = stored.setdefault(name, [])
        for task in range(TASKS):
            found = best_plan(env, task, effort)
            known[task : task + 1] = [better(found, known[task]) if task < len(known) else found]
            print(name, task, *known[task], flush=True)
        proved = np.mean([bound == 1.0 for _, bound in known])
        print(f"{name}: {100 * proved:.1f} % proved optimal, bound {max(b for _, b in known):.3f}")
    write_whole(file, json.dumps(stored) + "\n")


if __name__ == "__main__":
    main()
