"""A policy for unknown maps: the least expected cost, corrected by a network that has learned.

`unknown_map_policy.py` trains the network, and `unknown_map.py` compares the policy with others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from mlivr_gym.agents import ExpertPolicy
from mlivr_gym.agents.features import env_features
from mlivr_gym.agents.networks import as_tensors, logits_and_value
from mlivr_gym.arrays import Array, BoolArray
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


def scores(actor_critic: Any, features: dict[str, Tensor], planned: Tensor) -> Tensor:
    """Return the scores of actions, shape (k, N m).

    Parameters
    ----------
    actor_critic
        The actor-critic of sb3-contrib with the pointer network.
    features
        Features of k states, see `agents.features.point_features`.
    planned
        Expected costs of their actions above the least one, shape (k, N m).
    """
    return logits_and_value(actor_critic, features)[0] - SHARPNESS * planned


class CorrectedPolicy:
    """Policy that takes the valid action with the highest score.

    Attributes
    ----------
    actor_critic
        The actor-critic that has the network.
    expert
        The policy whose expected costs are corrected.
    """

    def __init__(self, actor_critic: Any) -> None:
        """Take the actor-critic."""
        self.actor_critic, self.expert = actor_critic, ExpertPolicy()

    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """Return the action to take; see `Policy.act`."""
        planned = torch.as_tensor(above_least(self.expert.costs(env))[None], dtype=torch.float32)
        with torch.no_grad():
            features = as_tensors(self.actor_critic, env_features(env))
            found = scores(self.actor_critic, features, planned)[0].numpy()
        return int(np.where(mask, found, -np.inf).argmax())
