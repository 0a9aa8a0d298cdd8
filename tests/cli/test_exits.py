import json

import pytest

from mlivr_gym.cli.exits import FAILED
from mlivr_gym.cli.main import main


@pytest.mark.parametrize("is_command", [True, False])
def test_nothing_is_printed_after_the_word_that_a_command_was_interrupted(monkeypatch, is_command):
    """By threads and libraries as Python ends; a program that calls `main` may print on."""

    def run(args):
        raise KeyboardInterrupt

    silenced = []
    monkeypatch.setattr("mlivr_gym.cli.plan.run", run)
    monkeypatch.setattr("mlivr_gym.cli.main.is_command", lambda: is_command)
    monkeypatch.setattr("mlivr_gym.cli.main.silence", lambda: silenced.append(True))
    assert main(["plan"]) == 130
    assert silenced == [True] * is_command


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        ImportError("x.so: failed to map segment from shared object"),
        RuntimeError("can't start new thread"),
    ],
)
def test_too_little_memory_is_said_in_one_line(capsys, monkeypatch, error):
    """Of processes that really have too little, libraries in C end some before this is said."""

    def run(args):
        raise error

    monkeypatch.setattr("mlivr_gym.cli.plan.run", run)
    assert main(["plan", "--json", "--start", "D2a:4", "D2b:4", "--goal", "6", "0", "0"]) == FAILED
    printed = capsys.readouterr()
    (line,) = printed.err.splitlines()
    assert line.startswith("mlivr-gym: the memory that this process may use is not enough")
    assert json.loads(printed.out)["exit_code"] == FAILED
