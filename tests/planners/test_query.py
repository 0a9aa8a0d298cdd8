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


def test_plans_of_more_limbs_cost_at_most_twice_the_least(three):
    """The default inflates the heuristic by 2; with 1 the same search is optimal."""
    rng, planner, dearer = np.random.default_rng(0), Planner(three), 0
    for _ in range(8):
        start, goal = sample_task(three, rng, 0.3)
        ours = planner.plan(start.stance, goal, "base").unwrap()
        least = planner.plan(start.stance, goal, "base", inflation=1.0).unwrap()
        double = planner.plan(start.stance, goal, "base", inflation=2.0).unwrap()
        assert ours.stances == double.stances
        assert ours.statistics.expanded == double.statistics.expanded
        assert least.cost - 1e-9 <= ours.cost <= 2.0 * least.cost + 1e-9
        dearer += ours.statistics.expanded < least.statistics.expanded
    assert dearer > 2
