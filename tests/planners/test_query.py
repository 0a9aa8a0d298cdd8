"""What a query gives within a time limit."""

import numpy as np
import pytest
from time_limit import AGES

from mlivr_gym import stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.planners import Planner, SearchOptions


@pytest.fixture(scope="module")
def three(small_map):
    """Three limbs on a third of the points of the small map."""
    few = small_map.subset(np.arange(len(small_map)) % 2 == 0, "few")
    return stance_graph(few, "mlivr3")


def test_a_time_limit_gives_the_best_plan_so_far(three):
    """With time enough it is the least; each plan on the way is better than the last."""
    rng, planner = np.random.default_rng(1), Planner(three)
    start, goal = sample_task(three, rng, 0.8)
    least = planner.plan(start.stance, goal, "base", options=SearchOptions(inflation=1.0)).unwrap()
    found = planner.plan(start.stance, goal, "base", time_limit=AGES)
    plan = found.unwrap()
    assert plan.cost == pytest.approx(least.cost, abs=1e-9)
    assert plan.statistics.bound == 1.0
    costs = [one.cost for one in found.improvements]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] == plan.statistics.cost
    assert planner.plan(start.stance, goal, "base", time_limit=0.0).reason == "limit reached"


@pytest.mark.parametrize("cost", ["steps", "base"])
@pytest.mark.parametrize(
    "how",
    [{"method": "dijkstra"}, {"method": "greedy"}, {"heuristic": "paper"}, {"heuristic": "zero"}],
)
def test_a_limit_that_is_not_reached_changes_nothing_in_the_order_that_was_chosen(three, how, cost):
    """Without an order of the user's, it makes the search improve its plan."""
    start, goal = sample_task(three, np.random.default_rng(9), 0.8)
    exact = {"inflation": 1.0} if "zero" in how.values() else {}
    free, limited = (
        Planner(three).plan(
            start.stance, goal, cost, options=SearchOptions(**how, **exact, effort=effort)
        )
        for effort in (None, 10**9)
    )
    assert free.expanded == limited.expanded
    assert free.unwrap().actions == limited.unwrap().actions
