"""Searches of three and four limbs without a table, where no search is needed."""

import itertools

import numpy as np
import pytest
from map_data import few_of_a_wall
from paper import NO_COLLISIONS

from mlivr_gym import Settings, stance_graph
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.planners import Planner


@pytest.fixture(scope="module", params=[(3, 24), (4, 16)])
def graph_and_stances(request):
    """A graph of three or four limbs on a few points of a wall, and its stances."""
    limbs, count = request.param
    graph = stance_graph(few_of_a_wall(count), f"mlivr{limbs}", NO_COLLISIONS)
    rows = np.array(list(itertools.permutations(range(count), limbs)))
    return graph, rows[graph.is_node(graph.nodes(rows))]


def test_a_goal_to_which_no_moves_lead_is_told(graph_and_stances):
    """At once, with no state expanded."""
    graph, rows = graph_and_stances
    planner, base = Planner(graph), graph.postures(rows).base_position
    start = rows[0].tolist()
    goal = np.clip(base.min(axis=0) - 5.0, *graph.grasp_map.cabin)
    found = planner.plan(start, goal, "steps", goal_tolerance=0.01)
    assert found.reason == "goal outside the reachable set"
    assert found.expanded == 0
    assert planner.plan(start, np.clip(base[0], *graph.grasp_map.cabin), "steps").plan is not None


def test_a_start_in_a_given_pose_may_have_less_manipulability_than_a_node(graph_and_stances):
    """It is at its goal, though its stance is no node."""
    graph, rows = graph_and_stances
    strict = stance_graph(
        graph.grasp_map, graph.robot, Settings(collisions=False, limb_threshold=0.2)
    )
    (weak, *_) = np.flatnonzero(~strict.is_node(strict.nodes(rows)))
    posture = graph.postures(rows[weak : weak + 1])
    pose = [*posture.base_position[0], *quaternion(posture.base_rotation[0])]
    goal = np.clip(posture.base_position[0], *graph.grasp_map.cabin)
    stance, planner = rows[weak].tolist(), Planner(strict)
    assert planner.plan(stance, goal, "steps").reason == "start infeasible"
    found = planner.plan(stance, goal, "steps", start_pose=pose)
    assert found.plan is not None
    assert not found.plan.steps
