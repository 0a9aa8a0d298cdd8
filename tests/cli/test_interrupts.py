"""Ctrl-C ends a command with one line and 130 whenever it comes, and in whatever process."""

import json
import os
import signal
import subprocess
import sys
from importlib.metadata import EntryPoint
from unittest.mock import Mock

import pytest

import mlivr_gym
from mlivr_gym.cli.exits import FAILED
from mlivr_gym.errors import MlivrError


@pytest.mark.parametrize("told", ["", "two of three done"])
@pytest.mark.parametrize("is_command", [True, False])
def test_nothing_is_printed_after_the_word_that_a_command_was_interrupted(
    run, monkeypatch, is_command, told
):
    """By threads and libraries as Python ends; a program that calls `main` may print on."""
    silenced = []
    monkeypatch.setattr("mlivr_gym.cli.plan.run", Mock(side_effect=KeyboardInterrupt(told)))
    monkeypatch.setattr("mlivr_gym.cli.main.is_command", lambda: is_command)
    monkeypatch.setattr("mlivr_gym.cli.main.silence", lambda: silenced.append(True))
    assert run("plan") == (130, "", f"mlivr-gym: {told or 'interrupted'}\n")
    assert silenced == [True] * is_command


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        ImportError("x.so: failed to map segment from shared object"),
        RuntimeError("can't start new thread"),
    ],
)
def test_too_little_memory_is_said_in_one_line(run, monkeypatch, error):
    """Of processes that really have too little, libraries in C end some before this is said."""
    monkeypatch.setattr("mlivr_gym.cli.plan.run", Mock(side_effect=error))
    code, out, err = run("plan --json --start D2a:4 D2b:4 --goal 6 0 0")
    assert code == json.loads(out)["exit_code"] == FAILED
    (line,) = err.splitlines()
    assert line.startswith("mlivr-gym: the memory that this process may use is not enough")


SCRIPT = """\
import re, sys
from {module} import {function}
if __name__ == "__main__":
    sys.exit({function}())
"""
"""What pip writes as the command."""

AT_IMPORT = """\
import os, signal, sys

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        is_worker = "--multiprocessing-fork" in sys.orig_argv
        if name == os.environ["AT"] and is_worker == (os.environ["PROCESS"] == "worker"):
            os.killpg(0, signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
"""
"""A `sitecustomize` that sends the signal when a module is about to be imported."""

STUDY = """\
kind = "plan"
tasks = 2
[factors]
cost = ["steps", "base"]
"""


@pytest.fixture
def interrupted(tmp_path):
    """Runs a command that is interrupted, like all its processes, at an import in one of them."""
    (tmp_path / "sitecustomize.py").write_text(AT_IMPORT)
    entry = EntryPoint("mlivr-gym", "mlivr_gym.cli.main:main", "console_scripts")
    script = tmp_path / "mlivr-gym"
    script.write_text(SCRIPT.format(module=entry.module, function=entry.attr))
    starts = {"script": [str(script)], "module": ["-m", "mlivr_gym"]}

    def run(start, at, *arguments, process="first"):
        path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
        done = subprocess.run(
            [sys.executable, *starts[start], *arguments],
            env=os.environ | {"PYTHONPATH": path, "AT": at, "PROCESS": process},
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
            start_new_session=True,
            # A shell that starts the tests in the background makes them ignore Ctrl-C.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.mark.parametrize(
    ("start", "at"),
    [
        ("script", "gymnasium"),
        ("module", "mlivr_gym.planners.planner"),
    ],
)
def test_a_command_is_interrupted_while_it_starts(interrupted, start, at):
    code, _, err = interrupted(start, at, "plan")
    assert (code, err) == (130, "mlivr-gym: interrupted\n")


def test_the_processes_of_a_study_say_nothing(interrupted, tmp_path):
    pytest.importorskip("pyarrow")
    (tmp_path / "study.toml").write_text(STUDY)
    arguments = ["study", str(tmp_path / "study.toml"), "--workers", "2", "--quiet"]
    end = interrupted("module", "mlivr_gym.extensions.studies.rows", *arguments, process="worker")
    assert end == (130, "", "mlivr-gym: interrupted\n")


def alone(code):
    """Run code that imports the module as a command does, before all that has threads."""
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": os.path.dirname(mlivr_gym.__file__)},
    )  # fmt: skip


def test_an_interruption_in_a_callback_ends_the_command():
    """Python would print it there, and go on."""
    code = """
import signal, weakref
signal.signal(signal.SIGINT, signal.default_int_handler)
import _interrupts
_interrupts.watch()
class Thing: pass
thing = Thing()
watched = weakref.ref(thing, lambda _: signal.raise_signal(_interrupts.INTERRUPT))
del thing
print("went on")
"""
    done = alone(code)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "mlivr-gym: interrupted\n")


def test_an_interruption_stays_one_whatever_a_library_makes_of_it(run, monkeypatch):
    """What the package itself has to say, such as that a file cannot be written, is said."""
    failing = Mock(side_effect=RuntimeError("no compiled object yet"))
    monkeypatch.setattr("mlivr_gym.cli.plan.run", failing)
    with pytest.raises(RuntimeError):
        run("plan")
    monkeypatch.setattr("mlivr_gym.cli.main.was_interrupted", lambda: True)
    assert run("plan") == (130, "", "mlivr-gym: interrupted\n")
    failing.side_effect = MlivrError("cannot write")
    assert run("plan") == (2, "", "mlivr-gym: cannot write\n")


def test_an_interruption_ends_what_does_not_respond():
    """As compiled code."""
    code = """
import ctypes, os, signal, threading
signal.signal(signal.SIGINT, signal.default_int_handler)
import _interrupts
_interrupts.watch()
_interrupts.set_grace(0.1)
signal.pthread_sigmask(signal.SIG_BLOCK, [_interrupts.INTERRUPT])
threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
ctypes.CDLL(None).sleep(600)
print("went on")
"""
    done = alone(code)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "mlivr-gym: interrupted\n")


def test_a_program_that_imports_the_package_keeps_its_own_handler():
    code = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
import mlivr_gym, mlivr_gym.cli.main
assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
"""
    words = ["plan", "mlivr-gym", "-m", "mlivr_gym"]
    subprocess.run([sys.executable, "-c", code, *words], check=True)
