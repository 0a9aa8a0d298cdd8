"""Walks: the plans they make, and how much of them can be executed."""

import numpy as np

from mlivr_gym import stance_graph
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.planners import Planner
from mlivr_gym.planners.walks import plan_of


def test_a_walk_makes_a_plan(small_map):
    """The plan of a walk is that of the planner with the same stances."""
    graph = stance_graph(small_map)
    env = MlivrEnv(map=small_map)
    env.reset(seed=2)
    plan = Planner(graph).plan(env.state.stance, env.goal, "steps").unwrap()
    states = [env.state]
    for limb, point in plan.actions:
        env.step(limb * len(small_map) + small_map.index(point))
        states.append(env.state)
    ours = plan_of(env.graph, states, env.goal, 0.2, "astar")
    assert ours is not None
    assert ours.stances == plan.stances
    assert ours.cost == plan.statistics.cost
    np.testing.assert_allclose(ours.motion.joint_positions, plan.motion.joint_positions)
