"""Action probabilities of the policy that ships with the package."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import softmax

from mlivr_gym.agents.features import env_features
from mlivr_gym.arrays import Array
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.extras import require
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

if TYPE_CHECKING:
    from mlivr_gym.agents.learned import LearnedPolicy

REQUIRED_PACKAGES = ("torch", "sb3_contrib", "stable_baselines3")
"""Packages of the extra `agents`."""


class PolicyView:
    """The pointer policy in an environment with the same obstacles and points as a stance graph."""

    def __init__(self, graph: StanceGraph) -> None:
        """Load the policy for the world of `graph`.

        Raises a `SettingError` if the extra `agents` is not installed.
        """
        require(*REQUIRED_PACKAGES, extra="agents")
        from mlivr_gym.agents.learned import load_policy

        self.graph, settings = graph, graph.settings
        self._env = MlivrEnv(
            graph.robot,
            graph.grasp_map,
            settings.manipulability,
            settings.transitions,
            settings.limb_threshold,
            settings.base_threshold,
            settings.collisions,
            settings.clearance,
        )
        self._policy: LearnedPolicy = load_policy("pretrained", self._env)

    def probabilities(self, state: State, goal: Array, tolerance: float) -> Array:
        """Compute the probability of each action, shape (N, m), 0 for invalid actions.

        The goal is given by its position [m] and the radius of the goal region [m]. Raises a
        `MlivrError` if the environment cannot start in that state.
        """
        import torch

        from mlivr_gym.agents.networks import as_tensors, logits_and_value

        env, graph = self._env, self.graph
        if (env.graph.obstacles, env.graph.occupied) != (graph.obstacles, graph.occupied):
            env.graph.remove_obstacles()
            env.graph.add_obstacles(graph.obstacles)
            env.graph.vacate()
            env.graph.occupy(sorted(graph.occupied))
        env.goal_tolerance = tolerance
        env.reset(options={"start": graph.ids(state.stance), "goal": tuple(goal.tolist())})
        mask = np.zeros((graph.limbs, len(graph.grasp_map)), dtype=np.bool_)
        steps = graph.successors(state)
        mask[steps.limb, steps.point] = True
        with torch.no_grad():
            tensors = as_tensors(self._policy.actor_critic, env_features(env, [state]))
            logits = logits_and_value(self._policy.actor_critic, tensors)[0][0].numpy()
        logits = np.where(mask, logits.reshape(mask.shape), -np.inf)
        return softmax(logits) if mask.any() else np.zeros(mask.shape)
