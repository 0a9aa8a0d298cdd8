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
