"""Actor-critic networks by name, and the calls of them that learning needs.

The pointer network is one network for every point and limb, whatever their number and order. A
DeepSets encoder (Zaheer et al., 2017) pools the points that may be grasped into a summary. A
pointer head (Vinyals et al., 2015) then computes the logit of each valid action from the point to
which it leads, the displacement of the base, the goal, the points held and that summary.

Stable-baselines3 calls these objects policies (`MaskableActorCriticPolicy`). Here a policy is what
chooses actions in a `MlivrEnv` (`agents.policies.Policy`), and they are called actor-critics.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from sb3_contrib.common.maskable.policies import (
    MaskableActorCriticPolicy,
    MaskableMultiInputActorCriticPolicy,
)
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, create_mlp
from torch import Tensor, nn

from mlivr_gym.agents.features import (
    ACTION_ARRIVALS,
    ACTION_DISTANCES,
    DEPTH,
    GOAL_FEATURES,
    POINT_ARRIVALS,
    POINT_DISTANCES,
    POINT_FEATURES,
    point_space,
)
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import choice

NETWORKS = ("pointer", "mlp")
"""Names of the networks: `PointerActorCritic`, or a perceptron on the plain observation."""

INVALID_LOGIT = -1e8
"""Logit of an invalid action."""

LENGTH = 3.0
"""Unit of lengths inside the network [m], so that all its inputs are of similar size."""

ARRIVAL = 8.0
"""Unit of the arrivals inside the network."""

SIGMOID_WIDTH = 0.005 / LENGTH
"""Width of the sigmoid that approximates whether a distance is within the goal tolerance."""

AHEAD = 0.8 / LENGTH
"""Distance of the second centre of the summary from the base, towards the goal."""

SPREAD = 1.4 / LENGTH
"""Standard deviation of the weights of points around each centre of the summary."""


def mlp(sizes: list[int]) -> nn.Sequential:
    """Return linear layers of the given sizes with ReLU between them."""
    return nn.Sequential(*create_mlp(sizes[0], sizes[-1], sizes[1:-1]))


class PointerNetwork(nn.Module):
    """Network that computes the logits of all actions, and summarises the state for the value."""

    def __init__(self, width: int = 96, summary: int = 32) -> None:
        """Build the layers of a pointer head of some width, and of a summary of all points.

        The summary is four times as wide as `summary`, the width of the embedding of one point.
        """
        super().__init__()
        self.latent_dim_vf = width
        self.encode = mlp([POINT_FEATURES + 1 + GOAL_FEATURES + 1 + 2 * DEPTH, summary, summary])
        self.of_limb = nn.Linear(
            GOAL_FEATURES + 2 * (POINT_FEATURES + 3 * DEPTH) + 4 * summary, width
        )
        self.of_action = nn.Linear(POINT_FEATURES + 9 + 3 * DEPTH, width)
        self.score = nn.Sequential(nn.ReLU(), *mlp([width, width, 1]))
        self.assess = mlp([4 * summary + GOAL_FEATURES + POINT_FEATURES + 3 * DEPTH, width, width])
        # Before training the logits are almost equal, so that an untrained policy explores evenly.
        last = self.score[-1]
        assert isinstance(last, nn.Linear)
        nn.init.normal_(last.weight, std=0.01)
        nn.init.zeros_(last.bias)

    @staticmethod
    def scaled(observation: dict[str, Tensor]) -> dict[str, Tensor]:
        """Return an observation in the units of the network."""
        points, limbs = observation["points"].clone(), observation["limbs"].clone()
        points[..., :3] /= LENGTH
        for lengths in (slice(2, 5), POINT_DISTANCES, ACTION_DISTANCES):
            limbs[..., lengths] /= LENGTH
        for arrivals in (POINT_ARRIVALS, ACTION_ARRIVALS):
            limbs[..., arrivals] /= ARRIVAL
        return {"points": points, "limbs": limbs, "goal": observation["goal"] / LENGTH}

    def embeddings(self, observation: dict[str, Tensor]) -> Tensor:
        """Return the embeddings of the points, shape (k, m, summary); 0 for those not free."""
        points, goal = observation["points"], observation["goal"]
        held = observation["limbs"][..., 0].sum(dim=1)[..., None]
        to_goal = (points[..., :3] - goal[:, None, :3]).norm(dim=-1, keepdim=True)
        expanded = goal[:, None].expand(-1, points.shape[1], -1)
        limbs = observation["limbs"]
        distances, arrivals = (
            limbs[..., POINT_DISTANCES].amin(dim=1),
            limbs[..., POINT_ARRIVALS].amax(dim=1),
        )
        embedding: Tensor = torch.relu(
            self.encode(torch.cat([points, held, expanded, to_goal, distances, arrivals], dim=-1))
        )
        return embedding * points[..., 6:7]

    def summarise(
        self, observation: dict[str, Tensor], embeddings: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return a summary of all points, and the features of the points that the limbs hold.

        The summary, shape (k, 4 summary), has the mean and the maximum of the embeddings about each
        of two centres. Points are weighted by their distance from the base, and again by their
        distance from a position `AHEAD` towards the goal. For each limb, shape (k, N, 8 + 3 DEPTH),
        there are the features of the point it holds, the lookahead distances and arrivals of this
        point, and whether the distances are within the tolerance.
        """
        points, goal = observation["points"], observation["goal"]
        ahead = goal[:, :3] * (AHEAD / goal[:, 3:4].clamp_min(AHEAD))
        parts = []
        for centre in (torch.zeros_like(ahead), ahead):
            away = (points[..., :3] - centre[:, None]).square().sum(dim=-1, keepdim=True)
            weights = torch.exp(-away / (2.0 * SPREAD**2))
            weighted = embeddings * weights
            count = (weights * points[..., 6:7]).sum(dim=1)
            parts += [weighted.sum(dim=1) / count.clamp_min(1e-6), weighted.amax(dim=1)]
        limbs = observation["limbs"]
        held = torch.einsum("knm,kmf->knf", limbs[..., 0], points)
        lookahead = torch.einsum(
            "knm,knmd->knd", limbs[..., 0], limbs[..., POINT_DISTANCES.start : POINT_ARRIVALS.stop]
        )
        arrives = self._arrives(goal[:, None].expand(-1, held.shape[1], -1), lookahead[..., :DEPTH])
        return torch.cat(parts, dim=-1), torch.cat([held, lookahead, arrives], dim=-1)

    @staticmethod
    def _arrives(goal: Tensor, distance: Tensor) -> Tensor:
        """Return about 1 where a distance to the goal is within the tolerance, else about 0."""
        return torch.sigmoid((goal[..., 4:5] - distance) / SIGMOID_WIDTH)

    def forward_actor(self, observation: dict[str, Tensor]) -> Tensor:
        """Return the logit of each action, shape (k, N m)."""
        return self.forward(observation)[0]

    def forward_critic(self, observation: dict[str, Tensor]) -> Tensor:
        """Return the input of the value layer, shape (k, width)."""
        return self.forward(observation)[1]

    def forward(self, observation: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Return the logits of all actions, (k, N m), and the value layer's input, (k, width)."""
        observation = self.scaled(observation)
        summary, held = self.summarise(observation, self.embeddings(observation))
        of_state = torch.cat([summary, observation["goal"], held.mean(dim=1)], dim=-1)
        return self._logits(observation, summary, held), torch.relu(self.assess(of_state))

    def _logits(self, observation: dict[str, Tensor], summary: Tensor, held: Tensor) -> Tensor:
        """Return the logits of all actions, shape (k, N m), from the results of `summarise`."""
        points, limbs, goal = observation["points"], observation["limbs"], observation["goal"]
        count = limbs.shape[1]
        others = (held.sum(dim=1, keepdim=True) - held) / (count - 1)
        whole = torch.cat([goal, summary], dim=-1)[:, None].expand(-1, count, -1)
        context = self.of_limb(torch.cat([held, others, whole], dim=-1))
        state, limb, point = torch.nonzero(limbs[..., 1] > 0.5, as_tuple=True)
        of_action = limbs[state, limb, point]
        action, lookahead = (
            of_action[:, 2:6],
            of_action[:, ACTION_DISTANCES.start : ACTION_ARRIVALS.stop],
        )
        remaining = (action[:, :3] - goal[state, :3]).norm(dim=-1, keepdim=True)
        distances = torch.cat([remaining, of_action[:, ACTION_DISTANCES]], dim=-1)
        arrives = self._arrives(goal[state], distances)
        seen = self.of_action(
            torch.cat([points[state, point], action, lookahead, remaining, arrives], dim=-1)
        )
        logits = points.new_full(limbs.shape[:3], INVALID_LOGIT)
        logits[state, limb, point] = self.score(seen + context[state, limb])[:, 0]
        return logits.flatten(1)


class _IdentityExtractor(BaseFeaturesExtractor):
    """Features extractor that returns the observation unchanged."""

    def __init__(self, observation_space: spaces.Space[Any]) -> None:
        """Take the observation space; the number of features is not used."""
        super().__init__(observation_space, features_dim=1)

    def forward(self, observation: dict[str, Tensor]) -> dict[str, Tensor]:
        """Return the observation unchanged."""
        return observation


class PointerActorCritic(MaskableActorCriticPolicy):
    """Actor-critic with a `PointerNetwork` for `MaskablePPO` of sb3-contrib."""

    def __init__(self, *args: Any, width: int = 96, summary: int = 32, **kwargs: Any) -> None:
        """Take the widths of the network and the arguments of `MaskableActorCriticPolicy`."""
        self.width, self.summary = width, summary
        super().__init__(
            *args,
            **(kwargs | {"features_extractor_class": _IdentityExtractor, "ortho_init": False}),
        )

    def _get_constructor_parameters(self) -> dict[str, Any]:
        """Return the arguments with which the actor-critic can be built again."""
        return super()._get_constructor_parameters() | {
            "width": self.width,
            "summary": self.summary,
        }

    def _build(self, lr_schedule: Any) -> None:
        """Build the network, the value layer and the optimiser."""
        self.mlp_extractor: Any = PointerNetwork(self.width, self.summary)
        self.action_net = nn.Identity()
        self.value_net = nn.Linear(self.width, 1)
        make: Any = self.optimizer_class
        self.optimizer = make(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)


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
