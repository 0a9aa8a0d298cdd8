"""Tasks: start and goal are drawn such that a walk joins them, alike in all environments."""

import numpy as np

from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.planners import Planner
from mlivr_gym.stances.random_states import random_state


def test_start_and_goal_are_drawn_such_that_a_plan_joins_them(env):
    planner = Planner(env.graph)
    starts = set()
    for seed in range(25):
        _, info = env.reset(seed=seed)
        starts.add(info["stance"])
        assert not info["is_success"]
        assert planner.plan(info["stance"], env.goal, "steps").plan is not None
    assert len(starts) > 20


def test_goals_can_be_reached_from_the_starts_that_are_given(single):
    """A plan of the planner joins each pair; without a start the goal alone may be given."""
    copies = MlivrVectorEnv(60, env=single)
    graph, rng = single.graph, np.random.default_rng(3)
    starts = [graph.ids(random_state(graph, rng).stance) for _ in range(60)]
    _, infos = copies.reset(seed=11, options={"start": starts})
    planner = Planner(graph)
    assert [tuple(row) for row in infos["stance"]] == starts
    for k in range(60):
        assert tuple(copies.branch_sets[k].tolist()) == graph.state(starts[k]).branch_sets
        assert planner.plan(starts[k], copies.goals[k].tolist(), "steps").plan is not None
    goals = copies.goals[::-1].copy()
    _, infos = copies.reset(options={"goal": goals})
    np.testing.assert_array_equal(copies.goals, goals)
    assert infos["action_mask"].any(axis=1).all()
    assert not (infos["stance"] == np.array(starts)).all()
    both = {"start": np.array(starts), "goal": goals.tolist()}
    _, infos = copies.reset(options=both)
    assert [tuple(row) for row in infos["stance"]] == starts
    assert (copies.goals == goals).all()
