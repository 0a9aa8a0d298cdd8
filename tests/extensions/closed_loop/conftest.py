"""Fixtures of the tests of the closed loop."""

import pytest


@pytest.fixture(scope="session")
def graph(checked_graph):
    """The graph of the whole module, in whose world every loop puts back what it believed."""
    return checked_graph
