"""Probabilities of the policy that ships with the package."""

import numpy as np
import pytest

pytest.importorskip("sb3_contrib", reason="the extra 'agents' is not installed")

import torch

from mlivr_gym.agents.features import env_features
from mlivr_gym.agents.learned import load_policy
from mlivr_gym.agents.networks import as_tensors, logits_and_value
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.viewer.policy_view import PolicyView


def test_chances_are_those_of_the_policy_in_its_environment(small_checked_graph):
    graph = small_checked_graph
    state, goal = sample_task(graph, np.random.default_rng(1), 0.2)
    view = PolicyView(graph)
    chance = view.probabilities(state, goal, 0.2)
    steps = graph.successors(state)
    assert chance.sum() == pytest.approx(1.0, abs=1e-5)
    allowed = np.zeros(chance.shape, dtype=bool)
    allowed[steps.limb, steps.point] = True
    assert (chance[~allowed] == 0.0).all()
    env = MlivrEnv(map=graph.grasp_map)
    observation, _ = env.reset(options={"start": graph.ids(state.stance), "goal": goal})
    action = load_policy("pretrained", env).act(env, observation, env.action_masks())
    assert int(chance.argmax()) == action
    # It follows the world of the graph: the best point is taken away.
    graph.occupy([action % len(graph.grasp_map)])
    after = view.probabilities(graph.state(state.stance), goal, 0.2)
    graph.vacate()
    assert after[:, action % len(graph.grasp_map)].sum() == 0.0
    env.graph.occupy([action % len(graph.grasp_map)])
    env.reset(options={"start": graph.ids(state.stance), "goal": goal})
    network = load_policy("pretrained", env).actor_critic
    with torch.no_grad():
        scores = logits_and_value(network, as_tensors(network, env_features(env)))[0][0].numpy()
    likely = np.where(env.action_masks(), np.exp(scores), 0.0)
    np.testing.assert_allclose(after.ravel(), likely / likely.sum(), atol=1e-5)
