"""What each path of `start_up.py` compiles: nothing twice, and no more than it is known to need."""

import os
import signal
import subprocess
import sys
import time

import pytest
import start_up

from mlivr_gym.compiled.cache import CACHE_VARIABLE, kernel_root

QUICK = ("plan", "environment", "simulate")
"""Paths that `make test` runs."""

MOST_FUNCTIONS = {"plan": 80, "environment": 60, "simulate": 90}
"""Most functions that a path compiles with an empty cache."""


@pytest.mark.parametrize(
    "path",
    [path if path in QUICK else pytest.param(path, marks=pytest.mark.slow)
     for path in start_up.PATHS if path not in start_up.WITHOUT_NUMBA],
)  # fmt: skip
def test_a_second_run_compiles_nothing(path):
    """With what this machine has stored; the first run compiles what it lacks."""
    cache = kernel_root().parent
    start_up.run(path, cache)
    assert start_up.run(path, cache)["functions"] == 0


@pytest.mark.parametrize(
    "path", ["plan", *(pytest.param(path, marks=pytest.mark.slow) for path in QUICK[1:])]
)
def test_a_first_run_compiles_no_more_than_it_needs(path, tmp_path):
    assert start_up.run(path, tmp_path)["functions"] <= MOST_FUNCTIONS[path]


def started(cache):
    """A first plan that is under way."""
    command = [sys.executable, "-m", "mlivr_gym", *start_up.PATHS["plan"].split()[1:]]
    environment = os.environ | {CACHE_VARIABLE: str(cache)}
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, env=environment, stdout=quiet, stderr=quiet)


@pytest.mark.slow
def test_what_a_run_compiled_until_it_was_killed_is_not_compiled_again(tmp_path):
    """Killed in the middle; the next run compiles the rest, and the one after it nothing."""
    whole = start_up.run("plan", tmp_path / "whole")["functions"]
    kept = tmp_path / "kept"
    first = started(kept)
    while len(list(kept.rglob("*.nbi"))) < 6 and first.poll() is None:
        time.sleep(0.05)
    first.send_signal(signal.SIGKILL)
    assert first.wait() == -signal.SIGKILL
    rest = start_up.run("plan", kept)["functions"]
    assert 0 < rest < whole
    assert start_up.run("plan", kept)["functions"] == 0


@pytest.mark.slow
def test_a_run_that_is_slowed_down_tenfold_leaves_nothing_to_compile(tmp_path):
    """It may run a tenth of the time."""
    first = started(tmp_path)
    while first.poll() is None:
        time.sleep(0.02)
        first.send_signal(signal.SIGSTOP)
        time.sleep(0.18)
        first.send_signal(signal.SIGCONT)
    assert first.returncode == 0
    assert start_up.run("plan", tmp_path)["functions"] == 0
