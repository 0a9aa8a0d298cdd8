import pytest


@pytest.fixture(scope="module", autouse=True)
def stances(solved_once):
    """A graph of the whole module for each command would take a second each."""


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """What takes long tells so on standard error, which on a busy machine could be any command."""
    monkeypatch.setattr("mlivr_gym.cli.progress.SHOW_AFTER", 1e9)
    monkeypatch.setattr("mlivr_gym.compiled.compiling.TOLD_AFTER", 1e9)
