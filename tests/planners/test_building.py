"""What is worked out once, while queries with a time limit wait for it."""

import math
import threading
import time
from collections import OrderedDict

import numpy as np
import pytest
from small_tables import small_map

from mlivr_gym import stance_graph
from mlivr_gym.compiled.cache import CACHE_VARIABLE
from mlivr_gym.planners import Planner
from mlivr_gym.planners.building import complete_by_deadline
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.stances.stance_sets import StanceSets


def test_work_outlasts_those_who_wait_for_it():
    go, done = threading.Event(), []

    def work():
        go.wait(30.0)
        done.append(1)

    assert not complete_by_deadline("work", work, time.perf_counter() + 0.05)
    assert not complete_by_deadline("work", work, time.perf_counter() + 0.05)
    go.set()
    assert complete_by_deadline("work", work, time.perf_counter() + 30.0)
    assert done == [1]
    assert complete_by_deadline("work", work, math.inf)
    assert done == [1, 1]


def test_its_error_is_raised_where_it_is_waited_for():
    def work():
        raise ValueError("torn")

    with pytest.raises(ValueError, match="torn"):
        complete_by_deadline("torn", work, time.perf_counter() + 30.0)


def test_a_query_ends_in_time_whatever_is_worked_out(monkeypatch):
    """And the next one finds what was worked out meanwhile."""
    monkeypatch.setenv(CACHE_VARIABLE, "")
    monkeypatch.setattr("mlivr_gym.stances.table_files._memory", OrderedDict())
    graph = stance_graph(small_map(), "mlivr3")
    start = random_state(graph, np.random.default_rng(0))
    goal = graph.posture_of(start).base_position[0] + (0.3, 0.0, 0.0)
    calls, slow = [], StanceSets.of.__func__

    def slowly(cls, *args, **options):
        if options.get("build", True):
            calls.append(1)
            time.sleep(1.5)
        return slow(cls, *args, **options)

    monkeypatch.setattr(StanceSets, "of", classmethod(slowly))
    monkeypatch.setattr("mlivr_gym.planners.searches.find_table", lambda graph: None)
    planner = Planner(graph)
    goal = np.clip(goal, *graph.grasp_map.cabin)
    began = time.perf_counter()
    result = planner.plan(start, goal, "steps", goal_tolerance=0.05, time_limit=0.5)
    assert 0.45 < time.perf_counter() - began < 0.5 + 0.2
    assert result.reason == "limit reached"
    assert "plan again" in result.message
    again = planner.plan(start, goal, "steps", goal_tolerance=0.05, time_limit=30.0)
    assert again.reason != "limit reached"
    assert calls == [1]


def test_a_query_with_time_waits_for_what_is_worked_out_for_it(monkeypatch):
    """By a thread that needs nothing that the query holds meanwhile."""
    monkeypatch.setenv(CACHE_VARIABLE, "")
    monkeypatch.setattr("mlivr_gym.stances.table_files._memory", OrderedDict())
    graph = stance_graph(small_map(), "mlivr3")
    start = random_state(graph, np.random.default_rng(0))
    goal = np.clip(graph.posture_of(start).base_position[0] + 0.3, *graph.grasp_map.cabin)
    found = Planner(graph).plan(start, goal, "steps", goal_tolerance=0.05, time_limit=15.0)
    assert found.reason != "limit reached"
    assert graph.sets(build=False) is not None
