"""The exact cost-to-go table as an expert."""

import numpy as np
import pytest

from mlivr_gym import State
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
        start, goal = graph.ids(graph.points[0].tolist()), graph.base_in_world[-1]
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
                        steps.base_in_world[k] - graph.posture(state.stance).base_position[0]
                    )
                ),
            )
            stance = list(state.stance)
            stance[steps.limb[k]] = int(steps.point[k])
            state = State(tuple(stance), tuple(steps.masks[k].tolist()))
        assert total == pytest.approx(expected, abs=1e-9)
        plan = Planner(graph).plan(start, goal, cost).unwrap()
        assert plan.statistics.cost == pytest.approx(expected, abs=1e-9)
