"""A search whose effort is spent tells no more than it has proved, on whatever machine."""

import time

import numpy as np
import pytest
from small_tables import small_table_with_box

from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.stances.random_states import random_state


@pytest.fixture(params=[2, 4])
def graph(request):
    """A graph on a few points with a box, which goes after the test."""
    with small_table_with_box(request.param, 0.1) as found:
        yield found


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_what_is_told_is_true_and_does_not_depend_on_the_clock(graph, cost, monkeypatch):
    rng, told, exact = np.random.default_rng(4), [], 0
    for _ in range(3):
        start, other = random_state(graph, rng), random_state(graph, rng)
        goal = graph.posture_of(other).base_position[0]
        how = {"goal_tolerance": 0.05}
        best = Planner(graph).plan(start, goal, cost, options=SearchOptions(inflation=1.0), **how)
        for effort in (1, 3000, 10**9):
            how["options"] = SearchOptions(inflation=1.0, effort=effort)
            found = Planner(graph).plan(start, goal, cost, **how)
            with monkeypatch.context() as patch:  # a machine that takes an hour for each look
                patch.setattr(time, "perf_counter", _hours())
                again = Planner(graph).plan(start, goal, cost, **how)
            assert (found.reason, found.expanded) == (again.reason, again.expanded)
            told.append(found.reason)
            if found.plan is None:
                assert found.reason in (best.reason, "limit reached")
                continue
            assert found.plan.actions == again.plan.actions
            assert best.plan.cost - 1e-9 <= found.plan.cost
            bound = found.plan.statistics.bound or np.inf
            assert found.plan.cost <= bound * best.plan.cost + 1e-9
            for one in found.improvements:
                assert one.cost <= one.bound * best.plan.cost + 1e-9
            exact += effort == 10**9 and bound == 1.0
    assert "limit reached" in told
    assert exact


def _hours():
    """A clock that shows an hour more whenever it is read."""
    now = [0.0]

    def read():
        now[0] += 3600.0
        return now[0]

    return read
