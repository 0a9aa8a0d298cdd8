"""Rewards by the formulas of the environment's docstring."""

import numpy as np
import pytest

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.rewards import BaseReward, StepOutcome, TotalReward
from mlivr_gym.planners import Planner


@pytest.fixture(scope="module")
def plan(small_map):
    """The longest of some plans."""
    env = MlivrEnv(map=small_map, collisions=False)
    plans = []
    for seed in range(30):
        env.reset(seed=seed)
        plans.append(Planner(env.graph).plan(env.state.stance, env.goal.tolist(), "steps").unwrap())
    return max(plans, key=lambda plan: len(plan.steps))


@pytest.mark.parametrize("discount", [0.9, 1.0])
def test_shaping_keeps_the_discounted_return_but_for_the_start(small_map, plan, discount):
    """The discounted sum of shaped rewards is the plain one plus the distance at the start."""
    returns = []
    for shaping in (False, True):
        how = {"shaping": shaping, "discount": discount, "success_bonus": 2.0}
        env = MlivrEnv(map=small_map, collisions=False, **how)
        _, info = env.reset(options={"start": plan.stances[0], "goal": plan.query.goal})
        away = np.linalg.norm(info["base_position"] - np.array(plan.query.goal))
        total = 0.0
        for t, (limb, point) in enumerate(plan.actions):
            _, reward, terminated, _, info = env.step(
                limb * len(small_map) + small_map.index(point)
            )
            total += discount**t * reward
        assert terminated
        assert info["is_success"]
        returns.append(total)
    assert len(plan.steps) > 2
    assert returns[1] - returns[0] == pytest.approx(away, abs=1e-9)


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
