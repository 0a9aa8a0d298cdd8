"""Fixtures of the tests of planners."""

import pytest

from mlivr_gym.envs.env import MlivrEnv


@pytest.fixture(scope="session")
def weight():
    """Cost of a step by the name of the cost, the price of a regrasp and the displacement."""

    def of(cost, price, displacement):
        return {"base": displacement, "steps": 1.0, "weighted": displacement + (price or 0.0)}[cost]

    return of


@pytest.fixture(scope="module")
def env(small_map):
    """The small map without collisions, its steps from tables."""
    return MlivrEnv(map=small_map, collisions=False, precompute=True)
