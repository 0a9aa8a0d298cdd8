"""Fixtures of the tests of planners."""

import pytest

from mlivr_gym.envs.env import MlivrEnv


@pytest.fixture(scope="module")
def env(small_map):
    """The small map without collisions, its steps from tables."""
    return MlivrEnv(map=small_map, collisions=False)
