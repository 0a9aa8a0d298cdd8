"""The exact cost-to-go table as an expert."""

import numpy as np
import pytest

from mlivr_gym import State
from mlivr_gym.planners import Planner


def test_the_table_is_an_expert(graph, weight):
    """Following the best action from the table costs exactly what the table says."""
    goal = np.array([6.0, 0.0, 0.42])
    for cost in ("base", "steps"):
        table = Planner(graph).cost_to_go(goal, cost)
        state, total = graph.state(("D1a:4", "D1b:4")), 0.0
        expected = table.value(state)
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
        assert Planner(graph).plan(
            ("D1a:4", "D1b:4"), goal, cost
        ).unwrap().statistics.cost == pytest.approx(expected, abs=1e-9)
