import ctypes
import gc
import json
import os
import shlex
import sys
from contextlib import suppress
from dataclasses import replace

if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")  # before any test imports mujoco

with suppress(ImportError):
    import triton  # noqa: F401  its LLVM crashes once Mesa, which renders, has loaded another

import numpy as np
import pytest
from cache_of_tests import KEPT
from hypothesis import HealthCheck, settings
from machine import available_memory, missing_package, workers
from map_data import LADDER
from paper import NO_COLLISIONS
from remembered import stances_solved_once
from shared_graphs import put_back, shared
from time_limit import MOST, time_limit

from mlivr_gym import GraspMap, jem_map, stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.compiled.cache import CACHE_VARIABLE
from mlivr_gym.compiled.kernels import LateEntry
from mlivr_gym.planners import Planner, plan_of

# The same examples in every run; HYPOTHESIS_PROFILE=fresh draws others.
# No deadline, nor a complaint that drawing is slow: the first compiles machine code, and a machine
# may be busy.
ANY_TIME = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("reproducible", derandomize=True, **ANY_TIME)
settings.register_profile("fresh", print_blob=True, **ANY_TIME)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "reproducible"))

LateEntry.patience = 0.0  # tests are about compiled code


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    with time_limit(MOST):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    return skipped_if_a_package_is_missing((yield), collector.path)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    return skipped_if_a_package_is_missing((yield), item.path, call)


def skipped_if_a_package_is_missing(report, path, call=None):
    """The report of a file or a test, skipped where it imports an extra that is not installed."""
    error = (call or report.call).excinfo
    if name := error and missing_package(error.value):
        report.outcome = "skipped"
        report.longrepr = str(path), None, f"Skipped: {name} is not installed"
    return report


@pytest.hookimpl(wrapper=True, optionalhook=True)
def pytest_xdist_auto_num_workers():
    return workers((yield), available_memory())


@pytest.fixture(autouse=True)
def shared_graphs_are_left_as_they_were():
    yield
    assert not put_back()


@pytest.fixture(scope="module", autouse=True)
def memory_is_given_back():
    """What the tests of a file have freed goes back to the system, not to the next file alone."""
    yield
    gc.collect()
    if sys.platform.startswith("linux"):
        getattr(ctypes.CDLL(None), "malloc_trim", bool)(0)


@pytest.fixture(scope="session", autouse=True)
def the_cache_of_the_user_is_left_alone():
    yield
    assert not (KEPT / "user" / "mlivr-gym").exists()


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """An empty cache directory for the tests of a file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(CACHE_VARIABLE, str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def solved_once():
    """Postures of a whole map are solved once for all tests that take this, see `remembered`."""
    with stances_solved_once():
        yield


@pytest.fixture(scope="session")
def jem():
    return jem_map()


@pytest.fixture(scope="session")
def graph(jem):
    """Every stance of the module, collisions not looked at."""
    return shared(stance_graph(jem, settings=NO_COLLISIONS))


@pytest.fixture(scope="session")
def checked_graph(jem):
    """Every stance of the module that touches nothing."""
    return shared(stance_graph(jem))


def plan_along(graph, goal, *stances):
    """One of the plans of the fewest steps, by its stances: which is found is of no matter."""
    found = Planner(graph).plan(stances[0], goal, "steps").unwrap()
    assert len(found.stances) == len(stances)
    states = graph.states_along(graph.state(stances[0]), [graph.indices(s) for s in stances[1:]])
    along = plan_of(graph, states, np.array(goal), found.query.goal_tolerance, "astar")
    return replace(found, motion=along.motion)


@pytest.fixture(scope="session")
def walk(checked_graph):
    """The README's plan: four steps from deck to overhead."""
    return plan_along(
        checked_graph, (6.0, 0.0, 0.42), ("D2a:4", "D2b:4"), ("A3b:2", "D2b:4"),
        ("A3b:2", "A5a:7"), ("O5b:8", "A5a:7"), ("O5b:8", "O5b:0"),
    )  # fmt: skip


@pytest.fixture(scope="session")
def plan(checked_graph):
    """A plan of more steps."""
    return plan_along(
        checked_graph, (6.3, 0.5, 0.35), ("D2a:4", "D1b:3"), ("D2a:4", "F2b:3"),
        ("F4a:8", "F2b:3"), ("F4a:8", "O5a:3"), ("A6a:7", "O5a:3"), ("A6a:7", "A6a:5"),
    )  # fmt: skip


@pytest.fixture(scope="session")
def small_map(jem):
    """The points of the first two racks of deck and forward wall, every second one."""
    keep = (jem.positions[:, 0] < 3.0) & np.isin(jem.faces, ["deck", "forward"])
    keep &= np.arange(len(jem)) % 2 == 0
    return jem.subset(keep, "small")


@pytest.fixture(scope="session")
def small_graph(small_map):
    return shared(stance_graph(small_map, settings=NO_COLLISIONS))


@pytest.fixture(scope="session")
def small_checked_graph(small_map):
    return shared(stance_graph(small_map))


@pytest.fixture
def ladder():
    return GraspMap.from_dict({"name": "ladder", **LADDER})


@pytest.fixture
def ladder_file(tmp_path):
    path = tmp_path / "map.json"
    path.write_text(json.dumps(LADDER))
    return path


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
