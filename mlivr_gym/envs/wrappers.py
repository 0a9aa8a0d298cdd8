"""Wrappers of the environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs.observations import Observation


class ActionMaskObservation(
    gymnasium.ObservationWrapper[Any, Any, Any],
    gymnasium.utils.RecordConstructorArgs,
):
    """Puts the action mask into the observation, under `"action_mask"`."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        """Wrap a `MlivrEnv`."""
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)
        inner = env.observation_space
        assert isinstance(inner, spaces.Dict)
        assert isinstance(env.action_space, spaces.Discrete)
        self.observation_space = spaces.Dict(
            {**inner.spaces, "action_mask": spaces.MultiBinary(int(env.action_space.n))}
        )

    def observation(self, observation: Observation) -> dict[str, Any]:
        """The observation with the mask."""
        mask: BoolArray = self.get_wrapper_attr("action_masks")()
        return {**observation, "action_mask": mask.astype(np.int8)}

    def action_masks(self) -> BoolArray:
        """Which actions are allowed, for sb3-contrib."""
        mask: BoolArray = self.env.get_wrapper_attr("action_masks")()
        return mask
