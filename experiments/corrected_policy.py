"""A policy for unknown maps: the least expected cost, corrected by a network that has learned.

`unknown_map_policy.py` trains the network, and `unknown_map.py` compares the policy with others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.agents import ExpertPolicy
from mlivr_gym.agents.learned import LearnedPolicy
from mlivr_gym.arrays import Array
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation

SHARPNESS = 4.0
"""Decrease of the score of an action for each unit of its expected cost."""

MOST_REGRET = 8.0
"""Largest difference of costs that counts, in the unit of the reward."""


def above_least(costs: Array) -> Array:
    """Return costs above the least one, at most `MOST_REGRET`; 0 if all are infinite."""
    least = costs.min()
    return np.minimum(costs - least, MOST_REGRET) if np.isfinite(least) else np.zeros(len(costs))


def scores(logits: Any, planned: Any) -> Any:
    """Return the scores of actions from logits and expected costs above the least, shape (N m,)."""
    return logits - SHARPNESS * planned


class CorrectedPolicy(LearnedPolicy):
    """Learned policy whose logits are scores.

    Attributes
    ----------
    expert
        The policy whose expected costs are corrected.
    """

    def __init__(self, actor_critic: Any) -> None:
        """Take the actor-critic that has the network."""
        super().__init__(actor_critic, "pointer")
        self.expert = ExpertPolicy()

    def logits(self, env: MlivrEnv, observation: Observation) -> NDArray[np.float32]:
        """Return the score of each action in the present state, shape (N m,)."""
        planned = above_least(self.expert.costs(env)).astype(np.float32)
        return scores(super().logits(env, observation), planned)
