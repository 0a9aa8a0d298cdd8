"""What learns and what was learned, used and then copied, does what it would have done."""

import copy
import pickle

import pytest
import torch
from public_objects import play, same

from mlivr_gym.agents.features import PointObservation, TableFeatures
from mlivr_gym.agents.hyperparameters import ImitationHyperparameters
from mlivr_gym.agents.imitation import Imitation
from mlivr_gym.agents.learned import LearnedPolicy
from mlivr_gym.agents.networks import make_actor_critic
from mlivr_gym.agents.sb3_env import TableVecEnv

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
