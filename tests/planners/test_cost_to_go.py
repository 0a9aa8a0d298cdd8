"""The exact cost-to-go table among obstacles."""

import numpy as np
import pytest

from mlivr_gym import Box, State, stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.planners import Planner


@pytest.mark.parametrize("free_first", [False, True])
def test_plans_cost_what_it_says_where_every_step_among_obstacles_is_known(small_map, free_first):
    """It checks every step; those of the table without obstacles are no longer asked then."""
    graph, rng, none, dearer = stance_graph(small_map), np.random.default_rng(0), 0, 0
    for k in range(12):
        cost = ("steps", "base")[k % 2]
        start, goal = sample_task(graph, rng, 0.3)
        free = Planner(graph).cost_to_go(goal, cost).value(start) if free_first else 0.0
        middle = 0.5 * (graph.posture(start.stance).base_position[0] + goal)
        graph.add_obstacles([Box.between("crate", "obstacle", middle - 0.15, middle + 0.15)])
        state = State(start.stance, tuple(graph.branch_sets[graph.find(start.stance)].tolist()))
        if all(state.branch_sets):
            least = Planner(graph).cost_to_go(goal, cost).value(state)
            plan = Planner(graph).plan(state, goal, cost).plan
            assert (plan.statistics.cost if plan else np.inf) == pytest.approx(least, abs=1e-9)
            none, dearer = none + (plan is None), dearer + (least > free + 1e-9)
        graph.remove_obstacles()
    assert dearer > none > 0
