"""Policies that need no training: the expert, random actions, and followers of plans."""

import copy
from functools import partial

import numpy as np
import pytest

from mlivr_gym.agents import ExpertPolicy, RandomPolicy, baseline_policy, evaluate, planner_policy
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.rewards import REWARDS
from mlivr_gym.errors import SettingError
from mlivr_gym.extensions.closed_loop.env import ClosedLoopEnv, ReplanningPolicy
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


def test_what_an_expert_saw_before_is_of_no_matter(small_map):
    """It answers as a new one does, whatever changes between two questions."""
    env = MlivrEnv(map=small_map, collisions=False, grasp_failure=0.2)
    env.reset(seed=0)
    free = sorted(set(range(len(small_map))) - set(env.state.stance))
    kept, answers = {expects: ExpertPolicy(expects) for expects in (True, False)}, set()
    for change in (
        lambda: None,
        lambda: setattr(env, "goal", np.add(env.goal, (0.4, 0.0, 0.0))),
        lambda: setattr(env, "goal_tolerance", 0.4),
        lambda: setattr(env, "reward", env.reward._replace(step_reward=REWARDS["base"])),
        lambda: setattr(env, "failure_probability", np.full(len(small_map), 0.4)),
        lambda: env.graph.occupy(free[:3]),
        env.graph.vacate,
        lambda: env.reset(seed=1),
    ):
        change()
        for expects, policy in kept.items():
            told = policy.costs(env)
            np.testing.assert_array_equal(told, ExpertPolicy(expects).costs(env))
            answers.add((expects, told.tobytes()))
    assert len(answers) >= 10


@pytest.mark.parametrize("reward", ["steps", "base"])
def test_an_expert_acts_by_its_costs(small_map, reward):
    """Though it computes only those that it needs, and more of them after a grasp that failed."""
    env = MlivrEnv(map=small_map, collisions=False, reward=reward, grasp_failure=0.4)
    acting, counted = ExpertPolicy(), 0
    for seed in range(40):
        observation, _ = env.reset(seed=seed)
        ended = False
        while not ended:
            action = acting.act(env, observation, env.action_masks())
            costs = ExpertPolicy().costs(env)
            assert costs[action] == pytest.approx(costs.min(), abs=1e-7)
            observation, _, ended, _, info = env.step(action)
            counted += int(info["grasp_failed"])
    assert counted > 5


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


def learned(env):
    return pytest.importorskip("mlivr_gym.agents.learned").load_policy("pretrained", env)


def beam(env):
    return pytest.importorskip("mlivr_gym.agents.learned").beam_policy(learned(env), width=2)


POLICIES = {
    "expert": lambda env: ExpertPolicy(),
    "planner": lambda env: planner_policy("base"),
    "local": lambda env: baseline_policy("local"),
    "learned": learned,
    "beam": beam,
    "replanning": lambda env: ReplanningPolicy("base"),
}
"""Policies that draw no numbers in their episodes."""


@pytest.mark.parametrize("way", [copy.copy, lambda one: one])
@pytest.mark.parametrize("name", POLICIES)
def test_a_policy_that_acted_in_another_world_acts_as_a_new_one(small_map, ladder, name, way):
    """On another map, and on the same one before points were taken."""
    new, make = POLICIES[name], MlivrEnv
    if name == "replanning":
        make = partial(ClosedLoopEnv, camera=None, boxes=0, plates=0)

    def acted(policy, env):
        observation, _ = env.reset(seed=4)
        chosen = []
        for _ in range(3):
            chosen.append(policy.act(env, observation, env.action_masks()))
            observation, *_ = env.step(chosen[-1])
        return chosen

    env = make(map=small_map)
    policy, plain = new(env), acted(new(env), env)
    for other in (make(map=ladder), env):
        acted(policy, other)
    other = way(policy)
    env.graph.occupy([small_map.ids[plain[0] % len(small_map)]])
    truth = acted(new(env), env)
    assert truth != plain
    assert acted(other, env) == truth


def test_a_plan_is_followed_until_goal_or_world_change(env):
    policy, plans = planner_policy("steps"), []
    planner = Planner(env.graph)
    for seed in range(99):
        observation, _ = env.reset(seed=seed)
        if len(planner.plan(env.state, env.goal, "steps").unwrap().steps) > 3:
            break
    for change in (None, None, "goal", "world"):
        if change == "goal":
            env.goal = env.goal + 0.01
        if change == "world":
            free = set(range(len(env.graph.grasp_map))) - set(env.state.stance)
            env.graph.occupy([max(free)])
        observation, *_ = env.step(policy.act(env, observation, env.action_masks()))
        plans.append(policy.plans)
    env.graph.vacate()
    assert plans == [1, 1, 2, 3]
