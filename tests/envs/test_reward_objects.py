"""Rewards of a user's own: one object serves the single and the vector environment."""

import numpy as np
import pytest

from mlivr_gym.envs.rewards import REWARDS, StepOutcome, TotalReward
from mlivr_gym.envs.vector_env import MlivrVectorEnv

pytestmark = pytest.mark.usefixtures("cache")


def test_the_edge_of_the_goal_region_belongs_to_it():
    """Exact numbers: at the tolerance the potential is 0, a little farther minus the distance."""
    reward = TotalReward(REWARDS["base"], 5.0, True, 0.9, 0.25)

    def paid(before, after, success):
        return reward(StepOutcome(0.5, before, after, success, True, 9.0, (0, 1), 1))

    assert paid(1.0, 0.25, True) == -0.5 + 5.0 + 0.9 * 0.0 + 1.0
    assert paid(1.0, 0.75, False) == pytest.approx(-0.5 - 0.9 * 0.75 + 1.0)
    both = paid(np.array([1.0, 0.25]), np.array([0.25, 0.75]), np.array([True, False]))
    np.testing.assert_allclose(both, [5.5, -1.175])


class Recorder:
    """Pays nothing and keeps the outcomes."""

    def __init__(self):
        self.outcomes = []

    def __call__(self, outcome):
        self.outcomes.append(outcome)
        return 0.0 * outcome.displacement


def test_rewards_are_asked_about_steps_only(small_map):
    """Copies that a step resets take no action; no entry of any outcome stands for them."""
    reward = Recorder()
    copies = MlivrVectorEnv(6, 2, reward=reward, map=small_map, collisions=False)
    copies.reset(seed=0)
    for k in range(5):
        _, rewards, _, _, _ = copies.step(copies.action_masks().argmax(axis=1))
        assert rewards.shape == (6,)
        if k == 0:  # from now on copy 0 is a step behind the others
            copies.reset(options={"reset_mask": np.arange(6) == 0})
    assert [len(outcome.displacement) for outcome in reward.outcomes] == [6, 6, 1, 5, 6]
    assert all((outcome.displacement > 0.0).all() for outcome in reward.outcomes)
    # A step that only resets asks nothing.
    copies.max_episode_steps = 1
    copies.reset()
    copies.step(copies.action_masks().argmax(axis=1))
    asked = len(reward.outcomes)
    assert copies.step(np.zeros(6, dtype=int))[1].tolist() == [0.0] * 6
    assert len(reward.outcomes) == asked
