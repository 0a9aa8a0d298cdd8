"""Rewards by the formulas of the environment's docstring."""

import numpy as np
import pytest

from mlivr_gym.envs.rewards import BaseReward, StepOutcome, TotalReward


def test_the_edge_of_the_goal_region_belongs_to_it():
    """Exact numbers: at the tolerance the potential is 0, a little farther minus the distance."""
    reward = TotalReward(BaseReward(), 5.0, True, 0.9, 0.25)

    def paid(before, after, success):
        return reward(StepOutcome(0.5, before, after, success, True, 9.0))

    assert paid(1.0, 0.25, True) == -0.5 + 5.0 + 0.9 * 0.0 + 1.0
    assert paid(1.0, 0.75, False) == pytest.approx(-0.5 - 0.9 * 0.75 + 1.0)
    assert paid(0.25, 0.75, False) == pytest.approx(-0.5 - 0.9 * 0.75)
    both = paid(np.array([1.0, 0.25]), np.array([0.25, 0.75]), np.array([True, False]))
    np.testing.assert_allclose(both, [5.5, -1.175])
