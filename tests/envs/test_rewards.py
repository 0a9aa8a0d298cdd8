"""Rewards, and what a failed grasp changes, by the formulas of the environment's docstring."""

import numpy as np
import pytest

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.rewards import BaseReward, StepOutcome, TaskReward
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.planners import Planner


class Copies:
    """The first of two copies, with the interface of one environment."""

    def __init__(self, **arguments):
        self.copies = MlivrVectorEnv(2, None, **arguments)
        self.graph = self.copies.env.graph

    def reset(self, seed=None, options=None):
        options = {name: [value] * 2 for name, value in (options or {}).items()}
        _, info = self.copies.reset(seed=seed, options=options)
        return {}, {name: rows[0] for name, rows in info.items()} | {
            "stance": tuple(info["stance"][0])
        }

    def step(self, action):
        observation, reward, terminated, truncated, info = self.copies.step([action, action])
        info = {name: rows[0] for name, rows in info.items()} | {"stance": tuple(info["stance"][0])}
        return (
            {name: rows[0] for name, rows in observation.items()},
            reward[0],
            terminated[0],
            truncated[0],
            info,
        )

    def masks(self):
        return tuple(self.copies.masks[0].tolist())


class Single(MlivrEnv):
    def masks(self):
        return self.state.masks


@pytest.fixture(params=[Single, Copies])
def make(request, small_map):
    return lambda **arguments: request.param(**{"map": small_map, "collisions": False} | arguments)


@pytest.fixture(scope="module")
def plan(small_map):
    """The longest of some plans."""
    env = MlivrEnv(map=small_map, collisions=False)
    plans = []
    for seed in range(30):
        env.reset(seed=seed)
        plans.append(Planner(env.graph).plan(env.state.stance, env.goal.tolist(), "steps").unwrap())
    return max(plans, key=lambda plan: len(plan.steps))


def actions(graph, plan):
    return [
        limb * len(graph.grasp_map) + graph.grasp_map.index(point) for limb, point in plan.actions
    ]


@pytest.mark.parametrize("discount", [0.9, 1.0])
def test_shaping_keeps_the_discounted_return_but_for_the_start(make, plan, discount):
    """The discounted sum of shaped rewards is the plain one plus the distance at the start."""
    returns = []
    for shaping in (False, True):
        env = make(shaping=shaping, discount=discount, success_bonus=2.0)
        _, info = env.reset(options={"start": plan.stances[0], "goal": plan.query.goal})
        away = np.linalg.norm(info["base_position"] - np.array(plan.query.goal))
        total = 0.0
        for t, action in enumerate(actions(env.graph, plan)):
            _, reward, terminated, _, info = env.step(action)
            total += discount**t * reward
        assert terminated
        assert info["is_success"]
        returns.append(total)
    assert len(plan.steps) > 2
    assert returns[1] - returns[0] == pytest.approx(away, abs=1e-9)


def test_a_failed_grasp_costs_both_displacements_and_keeps_the_branches_that_went(make, small_map):
    """The limb that moved is where it was; the holder has but the branches that the step allows."""
    risk = np.full(len(small_map), 0.95)
    env = make(reward="base", grasp_failure=risk, goal_tolerance=0.0)
    graph, rng, failures, narrowed = env.graph, np.random.default_rng(0), 0, 0
    for seed in range(25):
        _, info = env.reset(seed=seed)
        state = graph.state(info["stance"])
        steps = graph.successors(state)
        k = int(rng.integers(len(steps.limb)))
        limb, point = int(steps.limb[k]), int(steps.point[k])
        _, reward, terminated, _, after = env.step(limb * len(small_map) + point)
        if not after["grasp_failed"]:
            continue
        there = np.linalg.norm(
            steps.base_in_world[k] - graph.posture(state.stance).base_position[0]
        )
        assert reward == pytest.approx(-2.0 * there)
        assert after["base_translation"] == pytest.approx(2.0 * there)
        assert after["stance"] == info["stance"]
        assert not terminated
        np.testing.assert_array_equal(after["base_position"], info["base_position"])
        masks, holder = env.masks(), 1 - limb
        assert masks[holder] == steps.masks[k, holder]
        assert masks[limb] == graph.mask_after_grasp(state, limb)
        failures, narrowed = failures + 1, narrowed + (masks[holder] != state.masks[holder])
    assert failures >= 15
    assert narrowed > 0


def test_the_edge_of_the_goal_region_belongs_to_it():
    """Exact numbers: at the tolerance the potential is 0, a little farther minus the distance."""
    reward = TaskReward(BaseReward(), 5.0, True, 0.9, 0.25)

    def paid(before, after, success):
        return reward(StepOutcome(0.5, before, after, success, True, 9.0))

    assert paid(1.0, 0.25, True) == -0.5 + 5.0 + 0.9 * 0.0 + 1.0
    assert paid(1.0, 0.75, False) == pytest.approx(-0.5 - 0.9 * 0.75 + 1.0)
    assert paid(0.25, 0.75, False) == pytest.approx(-0.5 - 0.9 * 0.75)
    both = paid(np.array([1.0, 0.25]), np.array([0.25, 0.75]), np.array([True, False]))
    np.testing.assert_allclose(both, [5.5, -1.175])
