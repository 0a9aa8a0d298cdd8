"""What is worked out once, while queries with a time limit wait for it."""

import math
import threading
import time
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from small_tables import small_map
from time_limit import AGES

from mlivr_gym import stance_graph
from mlivr_gym.compiled.cache import CACHE_VARIABLE
from mlivr_gym.planners import Planner
from mlivr_gym.planners.building import result_by_deadline
from mlivr_gym.planners.clock import OutOfTime
from mlivr_gym.stances.random_states import random_state


def test_work_outlasts_those_who_wait_for_it():
    go, done = threading.Event(), []

    def work():
        go.wait()
        done.append(1)
        return len(done)

    for _ in range(2):
        with pytest.raises(OutOfTime):
            result_by_deadline("work", work, time.perf_counter() + 0.05)
    go.set()
    assert result_by_deadline("work", work, time.perf_counter() + AGES) == 1
    assert result_by_deadline("work", work, math.inf) == 2
    assert done == [1, 1]


@pytest.mark.parametrize("error", [None, OSError("torn")])
def test_all_threads_that_wait_for_one_work_get_what_came_of_it(monkeypatch, error):
    """As planners of equal graphs do, each with its own deadline."""
    go, waits, join = threading.Event(), [], threading.Thread.join

    def work():
        go.wait()
        if error is not None:
            raise error
        return "found"

    def joined(thread, timeout=None):
        waits.append(timeout)
        join(thread, timeout)

    deadlines = [time.perf_counter() + AGES, math.inf] * 3
    with pytest.raises(OutOfTime):  # it has begun
        result_by_deadline("one", work, time.perf_counter())
    with monkeypatch.context() as patch, ThreadPoolExecutor(len(deadlines)) as pool:
        patch.setattr(threading.Thread, "join", joined)
        jobs = [pool.submit(result_by_deadline, "one", work, one) for one in deadlines]
        while len(waits) < len(jobs):
            time.sleep(0.01)
        go.set()
        came = [job.exception() or job.result() for job in jobs]
    assert came == [error or "found"] * len(jobs)


def test_a_query_ends_in_time_whatever_is_worked_out(monkeypatch):
    """And the next one finds what was worked out meanwhile."""
    monkeypatch.setenv(CACHE_VARIABLE, "")
    monkeypatch.setattr("mlivr_gym.stances.table_files._memory", OrderedDict())
    graph = stance_graph(small_map(), "mlivr3")
    start = random_state(graph, np.random.default_rng(0))
    goal = graph.posture_of(start).base_position[0] + (0.3, 0.0, 0.0)
    calls, waits, go = [], [], threading.Event()
    join = threading.Thread.join

    def slowly(graph):
        calls.append(graph)
        go.wait()

    def joined(thread, timeout=None):
        waits.append(timeout)
        join(thread, timeout)

    monkeypatch.setattr("mlivr_gym.planners.searches.stored_table", slowly)
    planner = Planner(graph)
    goal = np.clip(goal, *graph.grasp_map.cabin)
    monkeypatch.setattr(threading.Thread, "join", joined)
    result = planner.plan(start, goal, "steps", goal_tolerance=0.05, time_limit=0.5)
    assert result.reason == "limit reached"
    assert "plan again" in result.message
    assert waits
    assert all(0.0 <= seconds <= 0.5 for seconds in waits)
    go.set()
    again = planner.plan(start, goal, "steps", goal_tolerance=0.05, time_limit=AGES)
    assert again.reason != "limit reached"
    assert len(calls) == 1


def test_a_query_with_time_waits_for_what_is_worked_out_for_it(monkeypatch):
    """By a thread that needs nothing that the query holds meanwhile."""
    monkeypatch.setenv(CACHE_VARIABLE, "")
    monkeypatch.setattr("mlivr_gym.stances.table_files._memory", OrderedDict())
    graph = stance_graph(small_map(), "mlivr3")
    start = random_state(graph, np.random.default_rng(0))
    goal = np.clip(graph.posture_of(start).base_position[0] + 0.3, *graph.grasp_map.cabin)
    found = Planner(graph).plan(start, goal, "steps", goal_tolerance=0.05, time_limit=15.0)
    assert found.reason != "limit reached"
