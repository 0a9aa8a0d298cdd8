"""Costs and their heuristics: which are lower bounds, and what a price of a regrasp does."""

import itertools

import numpy as np

from mlivr_gym.planners import Planner
from mlivr_gym.planners.costs import Cost


def test_heuristics_never_overestimate_and_the_papers_does(small_graph, weight):
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
            for t in graph.row(0, s):
                edge = weight(
                    name,
                    None,
                    float(np.linalg.norm(graph.base_position[s] - graph.base_position[t])),
                )
                assert ours[s] <= edge + ours[t] + 1e-9
        over += (
            Cost.named(name).heuristic("paper", distance, 0.2, graph.max_displacement)
            > truth + 1e-9
        ).sum()
    assert over > 0


def test_moving_a_limb_pays_its_price(graph):
    planner, start, goal = Planner(graph), ("D1a:7", "D1b:0"), (5.9, -0.1, 0.35)
    plans = [
        planner.plan(start, goal, "weighted", regrasp_price=price).unwrap()
        for price in (0.0, 0.05, 0.5, 5.0)
    ]
    assert all(len(a.steps) >= len(b.steps) for a, b in itertools.pairwise(plans))
    assert all(
        a.base_translation <= b.base_translation + 1e-9 for a, b in itertools.pairwise(plans)
    )
    assert len(plans[-1].steps) == len(planner.plan(start, goal, "steps").unwrap().steps)
