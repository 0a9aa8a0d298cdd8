"""Fixtures of the tests of environments."""

import gymnasium
import pytest

from mlivr_gym.envs.env import MlivrEnv


@pytest.fixture(scope="module", autouse=True)
def stances(solved_once):
    """A graph of the whole module for each environment would take a second each."""


@pytest.fixture(scope="module")
def single(small_map, cache):
    """The small map with collisions; every step is asked of the graph."""
    return MlivrEnv(map=small_map)


@pytest.fixture(scope="module")
def env():
    """The paper's world: where thousands of steps are taken, collisions would only cost time."""
    return gymnasium.make("MLIVR-JEM-v0", collisions=False).unwrapped
