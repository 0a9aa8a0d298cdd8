"""Fewest moves of two limbs without boxes, against other searches and against plans."""

from dataclasses import replace

import networkx as nx
import numpy as np
import pytest

from mlivr_gym import Settings, robot_spec, stance_graph
from mlivr_gym.planners import Planner
from mlivr_gym.planners.fewest_moves import fewest_moves
from mlivr_gym.world.grasp_map import as_map


def _start_and_goal(graph, rng):
    start, end = rng.integers(len(graph), size=2)
    return graph.points[start].tolist(), graph.base_position[end]


@pytest.mark.parametrize(
    "robot", [robot_spec("mlivr2-unequal"), replace(robot_spec("mlivr2"), rolls=(0.5,))]
)
@pytest.mark.parametrize(("name", "low", "high"), [("hatch", 0.0, 4.0), ("uslab", -1.5, 1.5)])
def test_they_are_those_of_networkx_over_stances_without_boxes(name, low, high, robot):
    """Over all stances either way round that the graph has without collision checks."""
    world, rng = as_map(name), np.random.default_rng(0)
    along = world.positions[:, 1 if name == "hatch" else 0]
    part = world.subset((along > low) & (along < high) & (np.arange(len(world)) % 3 > 0), "part")
    graph = stance_graph(part, robot, Settings(collisions=False, transitions=False))
    held = {tuple(sorted(stance)) for stance in graph.points.tolist()}
    net = nx.line_graph(nx.Graph(held))
    highest = max(*graph.robot.heights, 0.45)
    for _ in range(8):
        start, goal = _start_and_goal(graph, rng)
        steps = nx.single_source_shortest_path_length(net, _edge(net, start))
        middle = {edge: part.positions[list(edge)].mean(axis=0) for edge in net}
        least = min(
            steps.get(edge, np.inf)
            for edge in net
            if np.linalg.norm(middle[edge] - goal) <= highest + 0.1
        )
        found = fewest_moves(part, graph.robot, Settings(), start, (goal, 0.1))
        assert found == max(1, least)


def _edge(net, stance):
    a, b = stance
    return (a, b) if (a, b) in net else (b, a)


def test_it_is_infinite_where_no_moves_lead_to_the_goal(jem):
    keep = (jem.positions[:, 0] < 2.9) | (jem.positions[:, 0] > 6.0)
    apart = jem.subset(keep, "apart")
    start, robot = [apart.index("D2a:4"), apart.index("D2b:4")], robot_spec("mlivr2")
    for goal, found in (([8.0, 0.0, 0.4], np.inf), ([1.8, 0.0, -0.3], 1.0)):
        assert fewest_moves(apart, robot, Settings(), start, (np.array(goal), 0.2)) == found


def test_no_plan_of_the_jem_has_fewer_steps(jem, checked_graph):
    planner, rng, close = Planner(checked_graph), np.random.default_rng(1), 0
    for _ in range(12):
        start, goal = _start_and_goal(checked_graph, rng)
        goal = np.clip(goal, *jem.cabin)
        plan = planner.plan(checked_graph.ids(start), goal, "steps").plan
        if plan is not None and plan.steps:
            least = fewest_moves(jem, robot_spec("mlivr2"), Settings(), start, (goal, 0.2))
            assert 1 <= least <= len(plan.steps)
            close += least >= len(plan.steps) - 2
    assert close > 5
