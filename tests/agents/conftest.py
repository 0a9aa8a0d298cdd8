"""Fixtures of the tests of agents."""

import json

import pytest
import torch

from mlivr_gym.agents.networks import make_policy
from mlivr_gym.envs.env import MlivrEnv

LADDER = {
    "segments": [
        {
            "id": f"R{k}",
            "face": "deck",
            "start": [x, -0.4, 0.0],
            "end": [x, 0.4, 0.0],
            "normal": [0, 0, 1],
        }
        for k, x in enumerate((0.0, 0.9, 1.8))
    ],
    "cabin": {"min": [-1, -1, 0], "max": [3, 1, 2]},
}
"""The map of a user: three short rails on a floor."""


@pytest.fixture
def ladder_file(tmp_path):
    path = tmp_path / "map.json"
    path.write_text(json.dumps(LADDER))
    return path


@pytest.fixture(scope="session")
def short():
    """Settings of an imitation that takes a moment."""
    return {"rounds": 2, "layouts": 2, "goals": 4, "walks": 3, "updates": 10, "batch": 32}


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def env(small_map):
    """The small map without collisions, its steps from tables."""
    return MlivrEnv(map=small_map, collisions=False, precompute=True)


@pytest.fixture
def policy(env):
    """A small pointer policy of random weights."""
    torch.manual_seed(0)
    policy = make_policy(env, "pointer", {"width": 32, "summary": 16})
    for parameter in policy.parameters():
        torch.nn.init.normal_(parameter, std=0.3)
    return policy
