"""Actions in every form that policies return: what the action space contains is taken."""

import gymnasium
import numpy as np
import pytest
import torch
from sb3_contrib.common.maskable.utils import get_action_masks

from mlivr_gym.envs.wrappers import ActionMaskObservation
from mlivr_gym.errors import SettingError


def arguments(small_map):
    return {"map": small_map, "collisions": False, "max_episode_steps": 5}


@pytest.fixture(scope="module")
def env(small_map):
    return gymnasium.make("MLIVR-JEM-v0", **arguments(small_map))


@pytest.mark.parametrize(
    "form", [int, np.uint16, np.array, torch.tensor, lambda a: np.array(a, np.int16)]
)
def test_one_step_whatever_the_form_of_the_action(env, form):
    _, info = env.reset(seed=0)
    number = int(np.flatnonzero(info["action_mask"])[0])
    expected = env.step(number)
    env.reset(seed=0)
    action = form(number)
    assert torch.is_tensor(action) or env.action_space.contains(action)
    observation, *_, info = env.unwrapped.step(action)
    assert not info["invalid_action"]
    np.testing.assert_array_equal(observation["stance"], expected[0]["stance"])


def test_what_the_action_space_does_not_contain_is_refused(env):
    env.reset(seed=0)
    before = env.unwrapped.steps
    for action in (3.0, np.array([3]), torch.tensor(3.0), "3", -1, 76, np.uint64(2**63), np.True_):
        with pytest.raises(SettingError, match=r"action .* is not a whole number from 0 to"):
            env.unwrapped.step(action)
    assert env.unwrapped.steps == before


def test_the_mask_is_observed_where_it_is_asked_for(env):
    world = ActionMaskObservation(env)
    observation, info = world.reset(seed=0)
    for _ in range(3):
        assert world.observation_space.contains(observation)
        np.testing.assert_array_equal(observation["action_mask"], get_action_masks(world))
        np.testing.assert_array_equal(observation["action_mask"], info["action_mask"])
        observation, *_, info = world.step(int(np.flatnonzero(info["action_mask"])[0]))
