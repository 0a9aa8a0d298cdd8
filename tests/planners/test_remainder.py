"""What remains of a plan is possible in the present world, or there is none."""

import numpy as np
import pytest

from mlivr_gym import stance_graph
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.world.boxes import Box

QUERIES = {
    "mlivr2": (("D2a:4", "D2b:4"), (5.0, 0.0, 0.42)),
    "mlivr3": (("D3a:8", "D3a:1", "D3a:4"), (4.2, 0.0, 0.42)),
}


@pytest.mark.parametrize("robot", QUERIES)
def test_what_remains_is_a_plan_of_the_present_world(jem, robot):
    graph = stance_graph(jem, robot)
    planner, (start, goal) = Planner(graph), QUERIES[robot]
    plan = planner.plan(start, goal, "weighted", regrasp_price=0.1).unwrap()
    state = graph.state(start)
    assert len(plan.steps) > 3
    outcomes = set()
    for taken in range(len(plan.steps) + 1):
        stances = [graph.indices(stance) for stance in plan.stances[taken:]]
        state = graph.states_along(state, stances[:1])[-1] if taken else state
        base = plan.motion.base_positions[min(taken + 1, len(plan.steps))]
        for away in (1.2, 0.6, 0.3):
            centre = base + away * np.array([0.0, 0.6, -0.8])
            box = Box("box", "obstacle", tuple(centre.tolist()), (0.05,) * 3)
            graph.add_obstacles([box])
            try:
                found = planner.remainder(plan, taken, state)
                is_possible = len(graph.states_along(state, stances[1:])) == len(stances)
            finally:
                graph.remove_obstacles()
            assert (found is not None) == is_possible
            outcomes.add(is_possible)
            if found is not None:
                rest = found.unwrap()
                assert rest.stances == plan.stances[taken:]
                assert rest.world.obstacles == (box,)
                bases = plan.motion.base_positions[taken:]
                assert np.allclose(rest.motion.base_positions, bases, atol=1e-12)
                Plan.from_dict(rest.to_dict(), jem)  # everything is recomputed among the obstacles
    assert outcomes == {True, False}
