"""Fixtures of the tests of agents."""

import sys

import pytest

from mlivr_gym.envs.env import MlivrEnv


@pytest.fixture(scope="session")
def short():
    """Settings of an imitation that takes a moment."""
    return {"rounds": 2, "layouts": 2, "goals": 4, "rollouts": 3, "updates": 10, "batch": 32}


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """Whatever imports PyTorch uses one thread; some files do without it."""
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def env(small_map):
    """The small map without collisions, its steps from tables."""
    return MlivrEnv(map=small_map, collisions=False)


@pytest.fixture
def policy(env):
    """A small pointer policy of random weights."""
    import torch

    from mlivr_gym.agents.networks import make_actor_critic

    torch.manual_seed(0)
    policy = make_actor_critic(env, "pointer", {"width": 32, "summary": 16})
    for parameter in policy.parameters():
        torch.nn.init.normal_(parameter, std=0.3)
    return policy
