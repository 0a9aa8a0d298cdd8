"""Heuristics of costs: which are lower bounds."""

import numpy as np

from mlivr_gym.planners import Planner
from mlivr_gym.planners.costs import Cost


def test_heuristics_never_overestimate_and_the_papers_does(small_graph):
    graph = small_graph
    goal = np.array([2.5, 0.0, -0.3])
    distance = np.linalg.norm(graph.base_position - goal, axis=1)
    over = 0
    for name in ("base", "steps"):
        truth = Planner(graph).cost_to_go(goal, name).values
        ours = Cost.named(name).heuristic("consistent", distance, 0.2, graph.max_displacement)
        assert (ours <= truth + 1e-9).all()
        steps = np.random.default_rng(0).integers(0, len(graph), 10)
        for s in steps:
            for t in np.flatnonzero(graph.points[:, 0] == graph.points[s, 0]):
                moved = np.linalg.norm(graph.base_position[s] - graph.base_position[t])
                edge = moved if name == "base" else 1.0
                assert ours[s] <= edge + ours[t] + 1e-9
        over += (
            Cost.named(name).heuristic("paper", distance, 0.2, graph.max_displacement)
            > truth + 1e-9
        ).sum()
    assert over > 0
