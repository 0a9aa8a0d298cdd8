import json
import signal
import sys

import pytest

from mlivr_gym.cli.exits import FAILED, handle_interrupts
from mlivr_gym.cli.main import main
from mlivr_gym.errors import MlivrError


@pytest.fixture(autouse=True)
def interrupts_are_not_ignored():
    """A shell that starts the tests in the background makes them ignore Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def interrupted_then(error):
    """A library that makes another error of an interruption."""
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise error from None


def test_an_interruption_stays_one_whatever_a_library_makes_of_it():
    with pytest.raises(KeyboardInterrupt), handle_interrupts():
        signal.raise_signal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), handle_interrupts():
        interrupted_then(RuntimeError("no compiled object yet"))
    # What the package itself has to say, such as that a checkpoint cannot be written, is said.
    with pytest.raises(MlivrError, match="cannot write"), handle_interrupts():
        interrupted_then(MlivrError("cannot write"))
    with pytest.raises(RuntimeError), handle_interrupts():
        raise RuntimeError


def test_what_handles_interruptions_is_taken_away_at_the_end():
    """A program that calls the command, or another test, keeps its own hook and handler."""
    before = sys.unraisablehook, signal.getsignal(signal.SIGINT)
    with handle_interrupts():
        assert sys.unraisablehook is not before[0]
    assert (sys.unraisablehook, signal.getsignal(signal.SIGINT)) == before


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
