"""The corrected policy follows the least expected cost, and the correction as far as it goes."""

import numpy as np
import pytest
import torch
from unknown_map import MOST_REGRET, SHARPNESS, CorrectedPolicy, above_least

from mlivr_gym.agents import ExpertPolicy
from mlivr_gym.agents.learned import LearnedPolicy
from mlivr_gym.agents.networks import make_actor_critic
from mlivr_gym.envs.env import MlivrEnv


@pytest.fixture(scope="module")
def env(small_map):
    return MlivrEnv(map=small_map, collisions=False, precompute=True)


@pytest.fixture(scope="module")
def policy(env):
    """The policy with a network whose weights are zero, as its logits are."""
    actor_critic = make_actor_critic(env, "pointer", {"width": 32, "summary": 16})
    for weights in actor_critic.parameters():
        torch.nn.init.zeros_(weights)
    return CorrectedPolicy(actor_critic)


@pytest.mark.parametrize("seed", range(5))
def test_without_a_correction_it_takes_the_steps_of_least_expected_cost(env, policy, seed):
    observation, info = env.reset(seed=seed)
    taken, ended, least = 0, False, ExpertPolicy().costs(env).min()
    while not ended:
        mask, costs = env.action_masks(), ExpertPolicy().costs(env)
        action = policy.act(env, observation, mask)
        assert mask[action]
        assert costs[action] == pytest.approx(costs.min())
        observation, _, ended, _, info = env.step(action)
        taken += 1
    assert info["is_success"]
    assert taken == pytest.approx(least)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("excess", [-0.1, 0.1])
def test_a_correction_counts_as_much_as_it_exceeds_the_difference_of_costs(
    env, policy, monkeypatch, seed, excess
):
    """One against all best actions, a little smaller or larger than their advantage."""
    observation, _ = env.reset(seed=seed)
    mask, costs = env.action_masks(), ExpertPolicy().costs(env)
    is_best = mask & (costs <= costs.min() + 1e-6)
    rest = np.where(mask & ~is_best, costs, np.inf)
    advantage = rest.min() - costs.min()
    assert 0.0 < advantage < MOST_REGRET
    correction = np.where(is_best, -SHARPNESS * advantage - excess, 0.0).astype(np.float32)
    monkeypatch.setattr(LearnedPolicy, "logits", lambda *_: correction)
    action = policy.act(env, observation, mask)
    assert is_best[action] == (excess < 0.0)
    assert costs[action] == pytest.approx(costs.min() if excess < 0.0 else rest.min())


def test_costs_above_the_least_one_are_bounded_and_none_where_no_plan_is_left():
    assert above_least(np.array([3.0, 5.5, 40.0, np.inf])).tolist() == [0, 2.5, 8, 8]
    assert above_least(np.array([np.inf, np.inf])).tolist() == [0, 0]
