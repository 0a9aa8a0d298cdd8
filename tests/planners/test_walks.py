"""Walks: the plans they make, and how much of them can be executed."""

import numpy as np
from walk_steps import count_steps

from mlivr_gym import Settings, stance_graph
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


def test_steps_that_thresholds_forbid_are_found(small_map):
    """Plans without manipulability, checked with the thresholds on the graph of the planner."""
    free = stance_graph(small_map, settings=Settings(manipulability=False, collisions=False))
    strict = stance_graph(small_map, settings=Settings(collisions=False))
    env, world = (
        MlivrEnv(map=small_map, collisions=False),
        MlivrEnv(map=small_map, collisions=False),
    )
    counted = 0
    for seed in range(30):
        env.reset(seed=seed)
        plan = Planner(free).plan(env.state.stance, env.goal, "steps").unwrap()
        done = count_steps(strict, plan.stances)
        assert count_steps(free, plan.stances) == len(plan.steps)
        taken = 0  # by the environment, until it calls a step invalid
        world.reset(options={"start": plan.stances[0], "goal": plan.query.goal})
        for limb, point in plan.actions:
            taken += not world.step(limb * len(small_map) + small_map.index(point))[4][
                "invalid_action"
            ]
            if taken < world.steps:
                break
        assert done == taken
        counted += done < len(plan.steps)
    assert counted > 0
