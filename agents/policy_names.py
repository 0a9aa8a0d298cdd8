"""Policies by name, as commands and studies choose them."""

from __future__ import annotations

import os
from pathlib import Path

from mlivr_gym.agents.policies import (
    ExpertPolicy,
    Policy,
    RandomPolicy,
    baseline_policy,
    planner_policy,
)
from mlivr_gym.arguments import SEED, checked
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import SettingError, shortened
from mlivr_gym.extras import require
from mlivr_gym.planners import SearchOptions
from mlivr_gym.schema import Integer, OrNone

PLANNERS = (
    "expert", "astar", "astar-base", "dijkstra", "greedy", "local", "two_level", "mcts", "random",
)  # fmt: skip
"""Planners and baselines that can be evaluated in addition to learned policies."""


@checked({"seed": SEED, "beam": OrNone(Integer(1, 10_000))})
def policy_by_name(name: str, env: MlivrEnv, seed: int = 0, beam: int | None = None) -> Policy:
    """Return the policy of a name: one of `PLANNERS`, `"pretrained"`, or the path of a checkpoint.

    `beam` is the width of a beam search that a learned policy guides; None for no search. Raises a
    `SettingError` if the name is unknown and no such checkpoint exists.
    """
    if name in ("local", "two_level", "mcts"):
        return baseline_policy(name, seed=seed)
    if name in ("astar", "dijkstra", "greedy"):
        return planner_policy("steps", options=SearchOptions(method=name))
    if name == "astar-base":
        return planner_policy("base")
    if name == "expert":
        return ExpertPolicy()
    if name == "random":
        return RandomPolicy(seed)
    checkpoint = Path(name).name and os.path.isfile(Path(name).with_suffix(".pt"))
    if name != "pretrained" and not checkpoint:
        raise SettingError(
            f"policy is {shortened(name)}; it must be pretrained, the path of a checkpoint "
            f"without suffix, or one of {', '.join(PLANNERS)}"
        )
    require("torch", "stable_baselines3", "sb3_contrib", extra="agents")
    from mlivr_gym.agents.learned import beam_policy, load_policy

    policy = load_policy(name, env)
    return policy if beam is None else beam_policy(policy, beam)
