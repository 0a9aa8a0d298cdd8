"""Policies that need no training: the expert, random actions, and followers of plans."""

import numpy as np
import pytest

from mlivr_gym.agents import ExpertPolicy, RandomPolicy, baseline_policy, evaluate, planner_policy
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import SettingError
from mlivr_gym.planners import Planner
from mlivr_gym.planners.baselines import find_walk


def test_expert_policy_is_optimal_and_random_is_not(small_map):
    env = MlivrEnv(map=small_map, collisions=False)
    expert, chance = (
        evaluate(env, ExpertPolicy(), 20, seed=1),
        evaluate(env, RandomPolicy(0), 20, seed=1, max_steps=30),
    )
    assert expert.success_rate == 1.0
    assert chance.steps.mean() > expert.steps.mean()
    for k in range(20):
        env.reset(seed=1 + k)
        plan = Planner(env.graph).plan(env.state.stance, env.goal, "steps").unwrap()
        assert expert.steps[k] == len(plan.steps)
    with pytest.raises(SettingError, match="episodes is 0"):
        evaluate(env, RandomPolicy(), 0)
    with pytest.raises(SettingError, match="two limbs"):
        evaluate(MlivrEnv(robot="mlivr3", collisions=False), ExpertPolicy(), 1)


def test_policies_follow_walks_to_their_end(env):
    for policy in (
        baseline_policy("two_level"),
        baseline_policy("mcts", budget=10),
        planner_policy("base"),
    ):
        assert evaluate(env, policy, 3, seed=1).success.all()
    with pytest.raises(SettingError, match="method is 'magic'"):
        find_walk("magic", env.moves, env.state, env.goal)


def test_planners_go_on_after_grasps_that_fail(small_map):
    """After a failed attempt the limb that held has fewer branches than a plan may count on."""
    env = MlivrEnv(map=small_map, grasp_failure=0.45)
    result = evaluate(env, planner_policy("steps"), 10, seed=26)
    assert result.success.all()
    assert result.failed_grasps.sum() > 5


def test_a_plan_is_made_once_an_episode_and_anew_where_it_no_longer_holds(env):
    """Anew at the start of an episode, for another goal and off the plan; otherwise followed."""
    policy = planner_policy("steps")
    env.reset(seed=0)

    def act(observation):
        return policy.act(env, observation, env.action_masks())

    fewest, planner = 0, Planner(env.graph)
    while fewest < 4:
        env.reset()
        start, goal = env.state.stance, env.goal
        fewest = len(planner.plan(start, goal, "steps").unwrap().steps)
    options = {"start": start, "goal": goal}
    for episode in (1, 2):
        observation, info = env.reset(options=options)
        while not info["is_success"]:
            observation, *_, info = env.step(act(observation))
            assert policy.plans == episode
        assert info["steps"] == fewest
    observation, _ = env.reset(options=options)
    for plans in (3, 3):
        observation, *_ = env.step(act(observation))
        assert policy.plans == plans
    env.goal = env.goal + 0.01
    observation, *_ = env.step(act(observation))
    assert policy.plans == 4
    env.reset(options=options)
    action = act(env._observation())
    others = np.flatnonzero(env.action_masks())
    observation, *_ = env.step(int(others[others != action][0]))
    act(observation)
    assert policy.plans == 6

    # An episode that begins where the last one was cut off, as its plan would have gone on.
    env.reset(options=options)
    act(env._observation())
    made = policy.plans
    env.reset(options={"start": policy._expected, "goal": goal})
    act(env._observation())
    assert policy.plans == made + 1
