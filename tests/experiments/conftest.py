"""The experiments are scripts beside the package; their folder is put where imports look."""

import sys
from pathlib import Path

import pytest

EXPERIMENTS = str(Path(__file__).parents[2] / "experiments")


@pytest.fixture(autouse=True, scope="session")
def experiments():
    sys.path.insert(0, EXPERIMENTS)
    yield
    sys.path.remove(EXPERIMENTS)
