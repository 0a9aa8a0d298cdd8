"""What a query asks for where its options leave it open."""

import numpy as np
import pytest

from mlivr_gym import stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.planners import Planner


@pytest.fixture(scope="module")
def three(small_map):
    """Three limbs on a third of the points of the small map."""
    few = small_map.subset(np.arange(len(small_map)) % 2 == 0, "few")
    return stance_graph(few, "mlivr3")


@pytest.mark.parametrize("cost", ["base", "steps"])
def test_bounds_of_plans_of_more_limbs_hold(three, cost):
    """What a plan is said to cost at most is true of the least cost, and inflation is kept."""
    rng, planner, sooner = np.random.default_rng(0), Planner(three), 0
    for _ in range(4):
        start, goal = sample_task(three, rng, 0.6)
        least = planner.plan(start.stance, goal, cost, inflation=1.0).unwrap()
        first = planner.plan(start.stance, goal, cost).unwrap()
        double = planner.plan(start.stance, goal, cost, inflation=2.0).unwrap()
        assert least.statistics.bound == 1.0
        for plan in (first, double):
            assert least.cost - 1e-9 <= plan.cost
            bound = plan.statistics.bound or np.inf
            assert plan.cost <= bound * least.cost + 1e-9
        assert double.statistics.bound <= 2.0
        sooner += first.statistics.expanded < least.statistics.expanded
    assert sooner >= 2


def test_a_time_limit_gives_the_best_plan_so_far(three):
    """With time enough it is the least; each plan on the way is better than the last."""
    rng, planner = np.random.default_rng(1), Planner(three)
    start, goal = sample_task(three, rng, 0.8)
    least = planner.plan(start.stance, goal, "base", inflation=1.0).unwrap()
    found = planner.plan(start.stance, goal, "base", time_limit=60.0)
    plan = found.unwrap()
    assert plan.cost == pytest.approx(least.cost, abs=1e-9)
    assert plan.statistics.bound == 1.0
    costs = [one.cost for one in found.improvements]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] == plan.statistics.cost
    assert planner.plan(start.stance, goal, "base", time_limit=0.0).reason == "limit reached"
