"""A query that changes, without a page."""

import numpy as np

from mlivr_gym.extensions.viewer.live_plan import LivePlan, query_of
from mlivr_gym.planners import Planner


def test_a_plan_of_a_file_is_asked_for_again_alike(checked_graph, live, walk):
    """The query that is read from a plan gives the plan of the planner."""
    goal = walk.query.goal
    found = Planner(checked_graph).plan(walk.stances[0], goal, "steps").unwrap()
    live.replan()
    assert live.plan.stances == found.stances
    assert live.message == f"4 steps, {found.base_translation:.3f} m"


def test_a_given_start_pose_is_asked_for_again(checked_graph):
    planner = Planner(checked_graph)
    position, quaternion, _ = checked_graph.configuration(checked_graph.state(("D2a:4", "D2b:4")))
    pose = (*(position + np.array([0.02, 0.0, 0.0])), *quaternion)
    plan = planner.plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "steps", start_pose=pose).unwrap()
    again = LivePlan(checked_graph, query_of(checked_graph, plan), plan)
    again.replan()
    np.testing.assert_allclose(again.plan.motion.base_positions[0], pose[:3], atol=1e-9)
    assert again.plan.cost == plan.cost


def test_what_cannot_be_held_is_said(live):
    live.replan(start=("D2b:4", "D2b:4"))
    assert live.plan is None
    assert "D2b:4" in live.message
    assert live.summary().startswith("**No plan:** ")


def test_the_goal_is_kept_in_the_cabin(live):
    live.set_goal(np.array([5.0, 0.0, 0.0]))
    assert live.query["goal"] == (5.0, 0.0, 0.0)
    assert np.linalg.norm(live.plan.motion.base_positions[-1] - (5.0, 0.0, 0.0)) <= 0.2
    live.set_goal(np.array([99.0, 0.0, 0.0]))
    assert live.goal[0] == live.graph.grasp_map.cabin[1, 0]
