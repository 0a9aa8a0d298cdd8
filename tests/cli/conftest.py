import shlex

import pytest

from mlivr_gym.cli.main import main


@pytest.fixture(scope="module", autouse=True)
def stances(solved_once):
    """A graph of the whole module for each command would take a second each."""


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """What takes long tells so on standard error, which on a busy machine could be any command."""
    monkeypatch.setattr("mlivr_gym.cli.progress.SHOW_AFTER", 1e9)


@pytest.fixture
def run(capsys):
    """Runs a command, a line or its words; returns its exit code and what both streams got."""

    def run_command(*arguments):
        arguments = shlex.split(arguments[0]) if len(arguments) == 1 else arguments
        code = main(list(arguments))
        out, err = capsys.readouterr()
        return code, out, err

    return run_command


@pytest.fixture(scope="module")
def plan_file(walk, tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "plan.json"
    walk.save(path)
    return path
