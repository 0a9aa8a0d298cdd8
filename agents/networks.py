"""Actor-critic networks of sb3-contrib by name, and the calls of them that learning needs.

Stable-baselines3 calls these objects policies (`MaskableActorCriticPolicy`). Here a policy is what
chooses actions in a `MlivrEnv` (`agents.policies.Policy`), and they are called actor-critics.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from sb3_contrib.common.maskable.policies import MaskableMultiInputActorCriticPolicy
from torch import Tensor

from mlivr_gym.agents.features import point_space
from mlivr_gym.agents.pointer import PointerActorCritic
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import choice

NETWORKS = ("pointer", "mlp")
"""Names of the networks: `PointerActorCritic`, or a perceptron on the plain observation."""


def actor_critic_class(network: str) -> type[Any]:
    """Return the class of an actor-critic by the name of its network."""
    choice("network", network, NETWORKS)
    return PointerActorCritic if network == "pointer" else MaskableMultiInputActorCriticPolicy


def make_actor_critic(env: MlivrEnv, network: str, sizes: dict[str, Any]) -> Any:
    """Return a new actor-critic for an environment, with a network of `NETWORKS`.

    `sizes` are further arguments of its class, such as widths of layers; imitation has an optimiser
    of its own. Raises a `SettingError` if the network's name is unknown.
    """
    space = point_space(env) if network == "pointer" else env.observation_space
    return actor_critic_class(network)(space, env.action_space, lambda _: 3e-4, **sizes)


def as_tensors(actor_critic: Any, observation: Mapping[str, Any]) -> dict[str, Tensor]:
    """Return a batch of observations as tensors on the device of an actor-critic."""
    return {
        name: torch.as_tensor(np.ascontiguousarray(array)).to(actor_critic.device)
        for name, array in observation.items()
    }


def logits_and_value(actor_critic: Any, observation: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
    """Return the logits of all actions before masking, shape (k, a), and the values, shape (k,)."""
    features = actor_critic.extract_features(observation)
    actor, critic = actor_critic.mlp_extractor(features)
    return actor_critic.action_net(actor), actor_critic.value_net(critic)[:, 0]
