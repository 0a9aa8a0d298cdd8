"""Fixtures of the tests of environments."""

import gymnasium
import pytest


@pytest.fixture(scope="module", autouse=True)
def stances(solved_once):
    """A graph of the whole module for each environment would take a second each."""


@pytest.fixture(scope="module")
def env():
    """The paper's world: where thousands of steps are taken, collisions would only cost time."""
    return gymnasium.make("MLIVR-JEM-v0", collisions=False).unwrapped
