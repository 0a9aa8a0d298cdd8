"""Tests end in time, leave shared graphs as they were, and keep out of the user's cache."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from cache_of_tests import KEPT
from shared_graphs import SHARED, put_back
from time_limit import TestTooLongError, time_limit

from mlivr_gym import Box
from mlivr_gym.compiled import cache


def test_what_takes_too_long_is_ended():
    began = time.monotonic()
    with pytest.raises(TestTooLongError, match=r"longer than 0\.1 s"), time_limit(0.1):
        time.sleep(20.0)
    assert time.monotonic() - began < 5.0
    with time_limit(0.05):
        pass
    time.sleep(0.1)


def test_what_hangs_in_machine_code_ends_the_process():
    """A signal waits there until the call returns: it would for ever."""
    code = (
        "import ctypes\nfrom time_limit import time_limit\n"
        "with time_limit(0.1):\n    ctypes.PyDLL(None).sleep(60)\n"
    )
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent / "support")}
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert time.monotonic() - began < 30.0


def test_a_shared_graph_that_was_changed_is_put_back_and_told(small_checked_graph):
    assert any(graph is small_checked_graph for graph in SHARED)
    assert put_back() == []
    middle = small_checked_graph.base_in_world.mean(axis=0)
    small_checked_graph.occupy([3, 5])
    small_checked_graph.add_obstacles([Box.between("b", "obstacle", middle - 0.1, middle + 0.1)])
    (told,) = put_back()
    assert "1 obstacles, 2 occupied points" in told
    assert not small_checked_graph.obstacles
    assert not small_checked_graph.occupied


def test_caches_lie_outside_the_home_of_the_user():
    """The folder that would be the user's is a temporary one; that stays empty too."""
    folder, theirs = cache.cache_folder(), Path.home() / ".cache" / "mlivr-gym"
    assert folder is None or theirs.resolve() not in (folder.resolve(), *folder.resolve().parents)
    if sys.platform.startswith("linux"):
        assert cache._default_folder().is_relative_to(KEPT)
