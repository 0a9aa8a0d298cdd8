"""The exact cost-to-go table as an expert."""

import numpy as np
import pytest

from mlivr_gym import Box, State, stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.planners import Planner


@pytest.mark.parametrize(
    ("name", "start", "goal"),
    [
        ("small_checked_graph", None, None),
        pytest.param("graph", ("D1a:4", "D1b:4"), (6.0, 0.0, 0.42), marks=pytest.mark.slow),
    ],
)
def test_the_table_is_an_expert(name, start, goal, weight, request):
    """Following the best action from the table costs exactly what the table says."""
    graph = request.getfixturevalue(name)
    if start is None:
        start, goal = graph.ids(graph.points[0].tolist()), graph.base_position[-1]
    for cost in ("base", "steps"):
        table = Planner(graph).cost_to_go(goal, cost)
        state, total = graph.state(start), 0.0
        expected = table.value(state)
        assert 0.0 < expected < np.inf
        while not table.is_goal[graph.find(state.stance)]:
            steps = graph.successors(state)
            k = table.best(state, steps)
            total += weight(
                cost,
                None,
                float(
                    np.linalg.norm(
                        steps.base_position[k] - graph.posture(state.stance).base_position[0]
                    )
                ),
            )
            stance = list(state.stance)
            stance[steps.limb[k]] = int(steps.point[k])
            state = State(tuple(stance), tuple(steps.branch_sets[k].tolist()))
        assert total == pytest.approx(expected, abs=1e-9)
        plan = Planner(graph).plan(start, goal, cost).unwrap()
        assert plan.statistics.cost == pytest.approx(expected, abs=1e-9)


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
