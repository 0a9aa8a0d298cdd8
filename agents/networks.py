"""Policies of sb3-contrib by name, and the calls of them that learning needs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from sb3_contrib.common.maskable.policies import MaskableMultiInputActorCriticPolicy
from torch import Tensor

from mlivr_gym.agents.features import point_space
from mlivr_gym.agents.pointer import PointerPolicy
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import choice

NETWORKS = ("pointer", "mlp")
"""Names of the networks: `PointerPolicy`, or a multilayer perceptron on the plain observation."""


def policy_class(network: str) -> type[Any]:
    """Return the class of a policy by the name of its network."""
    choice("network", network, NETWORKS)
    return PointerPolicy if network == "pointer" else MaskableMultiInputActorCriticPolicy


def make_policy(
    env: MlivrEnv, network: str, sizes: dict[str, Any], learning_rate: float = 3e-4
) -> Any:
    """Return a new policy for an environment.

    Parameters
    ----------
    env
        The environment.
    network
        One of `NETWORKS`.
    sizes
        Further arguments of the policy's class.
    learning_rate
        Learning rate of the policy's optimiser.
    """
    space = point_space(env) if network == "pointer" else env.observation_space
    return policy_class(network)(space, env.action_space, lambda _: learning_rate, **sizes)


def as_tensors(policy: Any, observation: Mapping[str, Any]) -> dict[str, Tensor]:
    """Return a batch of observations as tensors on the policy's device."""
    return {
        name: torch.as_tensor(np.ascontiguousarray(array)).to(policy.device)
        for name, array in observation.items()
    }


def scores_and_value(policy: Any, observation: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
    """Return the scores of all actions before masking, shape (k, a), and the values, shape (k,)."""
    features = policy.extract_features(observation)
    actor, critic = policy.mlp_extractor(features)
    return policy.action_net(actor), policy.value_net(critic)[:, 0]
