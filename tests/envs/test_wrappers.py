"""Wrappers of the environment."""

import gymnasium
import numpy as np

from mlivr_gym.envs.wrappers import ActionMaskObservation


def test_mask_wrapper(env):
    wrapped = ActionMaskObservation(gymnasium.make("MLIVR-JEM-v0"))
    observation, info = wrapped.reset(seed=0)
    np.testing.assert_array_equal(observation["action_mask"], info["action_mask"])
    np.testing.assert_array_equal(wrapped.action_masks(), info["action_mask"].astype(bool))
    assert wrapped.observation_space.contains(observation)
