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


def test_the_rest_of_a_plan_is_proved_only_within_its_true_factor_of_the_minimum(small_map):
    """The truth is the cost-to-go with all steps checked; greedy plans cost more than that."""
    graph, rng, proved, refused = stance_graph(small_map), np.random.default_rng(1), 0, 0
    for k in range(10):
        cost = ("steps", "base")[k % 2]
        start, goal = sample_task(graph, rng, 0.3)
        planner = Planner(graph)
        plan = planner.plan(start, goal, cost, method="greedy").plan
        if plan is None:
            continue
        occupied = set(rng.choice(len(small_map), 4).tolist()) - set(
            map(small_map.index, sum(plan.stances, ()))
        )
        graph.occupy(occupied)
        costs = Planner(graph).cost_to_go(goal, cost)
        for index in range(len(plan.steps)):
            state = graph.state(plan.stances[index])
            rest = plan.query.cost_of(plan.motion.base_positions[index:])
            factor = rest / costs.value(state)
            for inflation in (1.0, 1.2, 2.0, 4.0):
                is_proved = planner.proves(plan, index, state, inflation)
                assert not is_proved or factor <= inflation * (1.0 + 1e-9)
                proved, refused = proved + is_proved, refused + (not is_proved)
        graph.vacate()
    assert min(proved, refused) > 20
