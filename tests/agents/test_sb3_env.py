"""Copies for stable-baselines3 against single environments; what learns, used and then copied."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
import torch
from public_objects import play, same

from mlivr_gym.agents import ExpertPolicy
from mlivr_gym.agents.features import PointObservation, TableFeatures, env_features
from mlivr_gym.agents.hyperparameters import ImitationHyperparameters
from mlivr_gym.agents.imitation import Imitation
from mlivr_gym.agents.learned import LearnedPolicy
from mlivr_gym.agents.networks import make_actor_critic
from mlivr_gym.agents.sb3_env import TableVecEnv
from mlivr_gym.envs.env import MlivrEnv


def test_copies_for_stable_baselines3_go_like_single_environments(env, small_map):
    copies = TableVecEnv(env, 3, "points", max_episode_steps=6)
    copies.seed(0)
    observations = copies.reset()
    with pytest.raises(gymnasium.error.ResetNeeded):
        TableVecEnv(env, 3).action_masks()
    singles = [MlivrEnv(map=small_map, collisions=False) for _ in range(3)]

    def follow(k):
        stance = copies.vector_env.tables.points[copies.vector_env.stances[k]].tolist()
        singles[k].reset(options={"start": stance, "goal": copies.vector_env.goals[k].copy()})

    for k in range(3):
        follow(k)
    rng, expert = np.random.default_rng(0), ExpertPolicy()
    ended, arrived = 0, 0
    for _ in range(60):
        masks = np.stack(copies.env_method("action_masks"))
        np.testing.assert_array_equal(masks, observations["limbs"][..., 1].reshape(3, -1) > 0)
        actions = (rng.random(masks.shape) * masks).argmax(axis=1)
        actions[0] = expert.act(singles[0], {}, masks[0])
        observations, rewards, dones, infos = copies.step(actions)
        assert (rewards == -1.0).all()
        for k, single in enumerate(singles):
            _, _, success, _, info = single.step(int(actions[k]))
            assert dones[k] == (success or info["steps"] == 6)
            if not dones[k]:
                assert infos[k] == {}
                continue
            ended, arrived = ended + 1, arrived + success
            assert infos[k]["episode"]["l"] == -infos[k]["episode"]["r"] == info["steps"]
            assert infos[k]["is_success"] is success
            assert infos[k]["TimeLimit.truncated"] is not success
            for name, rows in env_features(single).items():
                np.testing.assert_array_equal(rows[0], infos[k]["terminal_observation"][name])
            follow(k)
        for k, single in enumerate(singles):
            assert single.state.branch_sets == tuple(copies.vector_env.branch_sets[k].tolist())
    assert ended >= 25
    assert 3 <= arrived < ended


def test_a_seed_holds_for_the_next_reset_alone(env):
    """It gives the tasks that the vector environment has with it; without one they are others."""
    copies = TableVecEnv(env, 3, "plain")

    def tasks():
        copies.reset()
        vector = copies.vector_env
        return vector.stances.tolist(), vector.goals.tolist()

    seen = []
    for seed in (3, 4, 3):
        copies.seed(seed)
        seen += [tasks(), tasks()]
        copies.vector_env.reset(seed=seed)
        vector = copies.vector_env
        assert seen[-2] == (vector.stances.tolist(), vector.goals.tolist())
    assert seen[0] == seen[4]
    assert seen[0] != seen[2]
    assert all(first != second for first, second in zip(seen[::2], seen[1::2], strict=True))


def test_a_goal_that_is_reached_with_the_last_step_is_no_truncation(env, small_map):
    """Both happen at once; a learner must not go on from the value of the last state."""
    copies = TableVecEnv(env, 1, "plain", max_episode_steps=1)
    single = MlivrEnv(map=small_map, collisions=False)
    expert, found = ExpertPolicy(), set()
    for seed in range(40):
        copies.seed(seed)
        copies.reset()
        stance = copies.vector_env.tables.points[copies.vector_env.stances[0]].tolist()
        single.reset(options={"start": stance, "goal": copies.vector_env.goals[0].copy()})
        _, _, dones, (info,) = copies.step([expert.act(single, {}, single.action_masks())])
        assert dones[0]
        assert info["TimeLimit.truncated"] is not info["is_success"]
        found.add(info["is_success"])
    assert found == {True, False}


WAYS = (lambda one: pickle.loads(pickle.dumps(one)), copy.copy)


@pytest.fixture(params=WAYS, ids=["pickled", "copied"])
def way(request):
    return request.param


def actions(policy, env, count=4):
    """What a pointer policy does next, which computes itself what it sees."""
    out = []
    for _ in range(count):
        out.append(policy.act(env, {}, env.action_masks()))
        env.step(out[-1])
    return out


def test_a_learned_policy(env, policy, way):
    """Copied in an episode, it goes on as the policy does, which has not been where it goes."""
    one = LearnedPolicy(policy, "pointer")
    env.reset(seed=3)
    actions(one, env, 2)
    other, there = way(one), copy.deepcopy(env)
    assert actions(other, there) == actions(one, env)


def test_features_and_an_environment_with_them(env, way):
    assert same(way(TableFeatures(env)), TableFeatures(env))
    found = []
    for copied in (lambda one: one, way):
        wrapped = PointObservation(copy.deepcopy(env))
        wrapped.reset(seed=3)
        found.append(play(copied(wrapped)))
    assert same(*found)


def test_many_environments(env, way):
    def run(envs):
        return [envs.step(envs.action_masks().argmax(axis=1)) for _ in range(5)]

    envs = TableVecEnv(env, 2, "plain")
    envs.seed(3)
    envs.reset()
    copied = way(envs)
    truth = run(envs)
    assert same(run(copied), truth)


def test_an_imitation(env, short, way):
    weights = []
    for copied in (lambda one: one, way):
        torch.manual_seed(0)
        policy = make_actor_critic(env, "pointer", {"width": 32, "summary": 16})
        one = copied(Imitation(env, policy, False, ImitationHyperparameters(**short), seed=1))
        one.run()
        weights.append([one.detach().numpy() for one in one.actor_critic.parameters()])
    assert same(*weights)
