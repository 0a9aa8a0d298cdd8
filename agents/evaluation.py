"""One way to measure every policy: success, steps and base translation over seeded episodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.agents.policies import Policy
from mlivr_gym.env import MlivrEnv
from mlivr_gym.errors import SettingError


@dataclass(frozen=True)
class Evaluation:
    """What happened in k episodes.

    Attributes:
        success: Whether the goal was reached, shape (k,).
        steps: Steps taken, shape (k,).
        base_translation: Sum of base displacements [m], shape (k,).
    """

    success: NDArray[np.bool_]
    steps: NDArray[np.int64]
    base_translation: NDArray[np.float64]

    @property
    def success_rate(self) -> float:
        """Share of episodes that reached the goal."""
        return float(self.success.mean())


def evaluate(
    env: MlivrEnv,
    policy: Policy,
    episodes: int,
    seed: int = 0,
    max_steps: int = 100,
    progress: Callable[[int], None] | None = None,
) -> Evaluation:
    """Run a policy; episode k starts from `reset(seed=seed + k)`.

    Args:
        env: The environment, unwrapped.
        policy: The policy.
        episodes: Number of episodes.
        seed: Seed of the first episode.
        max_steps: Steps after which an episode counts as failed.
        progress: Called with the number of episodes done.

    Raises:
        SettingError: If `episodes` is below 1.
    """
    if episodes < 1:
        raise SettingError(f"episodes is {episodes!r}; it must be at least 1")
    rows = []
    for k in range(episodes):
        observation, info = env.reset(seed=seed + k)
        done = bool(info["is_success"])
        while not done and info["steps"] < max_steps:
            action = policy.act(env, observation, env.action_masks())
            observation, _, done, _, info = env.step(action)
        rows.append((done, info["steps"], info["base_translation"]))
        if progress is not None:
            progress(k + 1)
    success, steps, translation = zip(*rows, strict=True)
    return Evaluation(np.array(success), np.array(steps), np.array(translation))
