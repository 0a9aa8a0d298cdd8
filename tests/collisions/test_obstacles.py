"""Graphs and plans among obstacles and occupied points, and with shapes given by the user."""

import json

import numpy as np
import pytest
from coal_ruler import sampled

from mlivr_gym import Box
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import StanceError
from mlivr_gym.planners import Plan, Planner

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)


def test_obstacles_take_away_and_give_back(checked_graph):
    graph, planner = checked_graph, Planner(checked_graph)
    free = planner.plan(START, GOAL, "steps").unwrap()
    before = graph.successors(graph.state(START))
    box = Box.between("crate", "obstacle", (3.4, -1.0, -1.0), (3.7, 1.0, 0.2))
    graph.add_obstacles([box])
    blocked = planner.plan(START, GOAL, "steps").unwrap()
    assert blocked.cost >= free.cost
    assert blocked.world.obstacles == (box,)
    for here, _ in sampled(graph, blocked, 10):
        assert not contacts(graph.robot, (box,), here, 0.02 - 1e-9)
    assert Plan.from_dict(
        json.loads(json.dumps(blocked.to_dict())), graph.grasp_map
    ).world.obstacles == (box,)
    graph.remove_obstacles(["crate"])
    after = graph.successors(graph.state(START))
    for ours, theirs in zip(before, after, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert planner.plan(START, GOAL, "steps").unwrap().stances == free.stances


def test_occupied_points_are_not_grasped(checked_graph):
    graph = checked_graph
    start, goal = sample_task(graph, np.random.default_rng(1), 0.2)
    cost = {"cost": "weighted", "regrasp_price": 0.2}
    plan = Planner(graph).plan(start.stance, goal, **cost).unwrap()
    held = set(plan.stances[0])
    taken = sorted({point for stance in plan.stances for point in stance} - held)[:2]
    graph.occupy(taken)
    result = Planner(graph).plan(start.stance, goal, **cost)
    assert not any(point in taken for stance in result.unwrap().stances for point in stance)
    graph.occupy([plan.stances[0][0]])
    assert Planner(graph).plan(plan.stances[0], goal).reason == "start infeasible"
    with pytest.raises(StanceError, match="occupied"):
        graph.state(plan.stances[0])
    graph.vacate()
    assert Planner(graph).plan(start.stance, goal, **cost).unwrap().stances == plan.stances
