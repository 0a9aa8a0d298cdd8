"""Late entries are interpreted at first, compiled later, and give the same numbers both times."""

import copy
import importlib
import math
import pkgutil
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from numba import config

import mlivr_gym
from mlivr_gym import jem_map, stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.compiled import interpreted, kernels
from mlivr_gym.compiled.interpreted import as_readable
from mlivr_gym.compiled.kernels import LateEntry
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.motion.straight_base import path_of, support_joints
from mlivr_gym.planners import Planner
from mlivr_gym.transitions.steps import line_clear

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="all is interpreted")

QUERY = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)


class Counted:
    """What `entry` returns, on a clock that each interpretation moves on by a second."""

    def __init__(self, function, clock):
        self.calls, self.stats = 0, SimpleNamespace(cache_path=None)

        def interpreted_function(*given):
            clock[0] += 1.0
            return function(*given)

        self.py_func, self.function = interpreted_function, function

    def __call__(self, *given):
        self.calls += 1
        return self.function(*given)


@pytest.fixture
def late(monkeypatch):
    """A late entry of a function, and what counts its compiled calls."""
    clock = [0.0]
    monkeypatch.setattr(kernels, "time", SimpleNamespace(thread_time=lambda: clock[0]))
    monkeypatch.setattr(LateEntry, "patience", 2.0)

    def made(function):
        compiled = Counted(function, clock)
        return LateEntry(compiled), compiled

    return made


def test_an_entry_is_compiled_once_its_calls_have_taken_long(late, tmp_path):
    entry, compiled = late(lambda x: 2 * x)
    assert [(entry(k), compiled.calls) for k in range(5)] == [
        (0, 0), (2, 0), (4, 1), (6, 2), (8, 3)
    ]  # fmt: skip


def test_the_time_of_earlier_processes_counts(late, tmp_path, monkeypatch):
    """It lies beside the machine code; a file that is damaged counts as none."""
    ended = []
    monkeypatch.setattr(kernels, "atexit", SimpleNamespace(register=ended.append))
    folder = tmp_path / "not made yet"

    def compiled_calls(*calls):
        entry, compiled = late(lambda x: x)
        compiled.stats.cache_path = str(folder)
        for k in calls:
            assert entry(k) == k
        ended.pop()()
        return compiled.calls

    assert [compiled_calls(1), compiled_calls(2), compiled_calls(3, 4)] == [0, 0, 2]
    (file,) = folder.iterdir()
    for damaged in ("x", "nan", "-3"):
        file.write_text(damaged)
        assert [compiled_calls(1), compiled_calls(2), compiled_calls(3)] == [0, 0, 1]


def test_an_entry_with_stored_machine_code_is_not_interpreted(late, tmp_path):
    entry, compiled = late(lambda x: 2 * x)
    compiled.stats.cache_path = str(tmp_path)
    (tmp_path / "steps.other-12.py311.nbi").touch()
    assert (entry(1), compiled.calls) == (2, 0)
    name = compiled.py_func.__qualname__
    (tmp_path / f"steps.{name}-12.py311.nbi").touch()
    assert (entry(1), compiled.calls) == (2, 1)


@pytest.mark.parametrize("refused", [lambda: 1 / 0, lambda: math.sqrt(-1), lambda: math.cos(1e999)])
def test_what_the_interpreter_refuses_is_left_to_machine_code(late, refused):
    """There it is an infinity or no number."""
    entry, compiled = late(lambda x: x)

    def refusing(x):
        refused()

    compiled.py_func = entry.py_func = refusing
    assert (entry(7), compiled.calls) == (7, 1)


def test_threads_that_interpret_at_once_call_no_compiled_kernel(monkeypatch):
    """All of them wait until a function and what it calls are made."""
    monkeypatch.setattr(interpreted, "_modules", {})
    monkeypatch.setattr(interpreted, "_functions", {})
    slow, copied, ready = interpreted._interpreted_names, [], threading.Barrier(4)

    def slowly(names):
        found = slow(names)
        time.sleep(0.002)
        return found

    monkeypatch.setattr(interpreted, "_interpreted_names", slowly)

    def make():
        ready.wait()
        function = interpreted.interpreted(line_clear.py_func)
        copied.append([hasattr(one, "py_func") for one in function.__globals__.values()])

    threads = [threading.Thread(target=make) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(copied) == 4
    assert not any(map(any, copied))


PACKAGES = "kinematics", "transitions", "collisions", "postures", "motion"
"""Those with late entries."""


def late_entries():
    """All late entries of the package."""
    for module in pkgutil.walk_packages(mlivr_gym.__path__, "mlivr_gym."):
        if module.name.split(".")[1] in PACKAGES:
            for one in vars(importlib.import_module(module.name)).values():
                if isinstance(one, LateEntry):
                    yield one


def test_warmup_leaves_nothing_to_be_interpreted(monkeypatch, capsys):
    """Where no machine code is stored yet: what plans call late is compiled before it ends."""
    asked, entries = [], list(late_entries())

    def told(function):
        asked.append(function)
        raise ArithmeticError  # so that machine code is called

    monkeypatch.setattr(LateEntry, "patience", 1e9)
    monkeypatch.setattr(kernels, "is_stored", lambda compiled: False)
    monkeypatch.setattr(kernels, "interpreted", told)
    for entry in entries:
        monkeypatch.setattr(entry, "_is_due", False)
        monkeypatch.setattr(entry, "_spent", 0.0)
    assert main(["warmup"]) == 0
    assert not asked
    assert any(entry._is_due for entry in entries)


def numbers(value):
    """The bits of all numbers of arguments, without what lies between the fields of records."""
    if isinstance(value, tuple):
        for one in value:
            yield from numbers(one)
    elif not isinstance(value, np.ndarray | np.void):
        return
    elif value.dtype.names is None:
        yield value.tobytes()
    else:
        for name in value.dtype.names:
            yield from numbers(value[name])


@pytest.fixture
def compared(monkeypatch):
    """The number of calls of each late entry, each made both ways with equal results to the bit."""
    calls = dict.fromkeys((entry.__name__ for entry in late_entries()), 0)

    def both(self, *given):
        again = copy.deepcopy(given)
        found = self._compiled(*given)
        function = interpreted.interpreted(self.py_func)
        with np.errstate(all="ignore"):
            assert function(*map(as_readable, again)) == found
        assert list(numbers(given)) == list(numbers(again)), self.__name__
        calls[self.__name__] += 1
        return found

    monkeypatch.setattr(LateEntry, "__call__", both)
    return calls


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr2-iiwa"])
def test_interpreted_and_compiled_entries_give_the_same_numbers(robot, compared):
    """To the bit, so that it does not show in a plan which of both made it."""
    points = jem_map()
    few = points.subset(abs(points.positions[:, 0] - 3.0) < 1.3)
    graph = stance_graph(points if robot == "mlivr2" else few, robot)
    planner, first, goal = Planner(graph), graph.ids(graph.points[0]), graph.base_position[-1]
    query = QUERY if robot == "mlivr2" else (first, goal.tolist())
    motion = planner.plan(*query, "steps").unwrap().motion
    pose = [*motion.base_positions[0], *motion.base_quaternions[0]]
    joints = motion.joint_positions[0]
    assert planner.plan(*query, start_pose=pose, start_joints=joints).plan is not None
    ends = StepEnds.of(graph, motion, 0)
    support_joints(graph, ends, path_of(ends), np.linspace(0.0, 1.0, 9), ends.joints[0])
    seldom = set() if robot == "mlivr2" else {"angles_above"}
    assert all(compared[name] for name in compared.keys() - seldom)
