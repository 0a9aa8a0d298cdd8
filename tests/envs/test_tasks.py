"""Tasks: start and goal are drawn such that a walk joins them, alike in all environments."""

import numpy as np
import pytest
from scipy.stats import ks_2samp

from mlivr_gym.envs.tasks import random_state, sample_task
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.planners import Planner


def test_start_and_goal_are_drawn_such_that_a_plan_joins_them(env):
    planner = Planner(env.graph)
    starts = set()
    for seed in range(25):
        _, info = env.reset(seed=seed)
        starts.add(info["stance"])
        assert not info["is_success"]
        assert planner.plan(info["stance"], env.goal, "steps").plan is not None
    assert len(starts) > 20


def test_goal_alone_or_start_alone_may_be_given(env):
    _, info = env.reset(seed=0, options={"start": ("D1a:4", "D1b:4")})
    assert info["stance"] == ("D1a:4", "D1b:4")
    env.reset(seed=0, options={"goal": (6.0, 0.0, 0.42)})
    np.testing.assert_array_equal(env.goal, [6.0, 0.0, 0.42])


class SplitMix:
    """splitmix64 (Steele, Lea and Flood, 2014) in integers of Python, used like a generator."""

    def __init__(self, seed):
        self.state = int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0])

    def integers(self, bound):
        self.state = (self.state + 0x9E3779B97F4A7C15) % 2**64
        z = self.state
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 % 2**64
        z = (z ^ z >> 27) * 0x94D049BB133111EB % 2**64
        return (z ^ z >> 31) * bound // 2**64


@pytest.mark.usefixtures("cache")
@pytest.mark.parametrize("given", [False, True])
def test_tasks_are_drawn_as_the_single_environment_draws_them(small_map, given):
    """Number for number: `sample_task` over the graph, fed with the stream of each copy."""
    copies = MlivrVectorEnv(200, map=small_map, collisions=False)
    graph, m = copies.env.graph, len(small_map)
    starts = None
    if given:
        copies.reset(seed=1000)
        starts = copies.tables.points[copies.stances].tolist()
    observations, infos = copies.reset(seed=7, options={"start": starts} if given else None)
    for k in range(200):
        start = graph.state(starts[k]) if given else None
        state, goal = sample_task(graph, SplitMix(7 + k), copies.env.goal_tolerance, start)
        assert tuple(observations["stance"][k].tolist()) == state.stance
        assert tuple(copies.masks[k].tolist()) == state.masks
        np.testing.assert_allclose(copies.goals[k], goal, atol=1e-12)
        away = np.linalg.norm(infos["base_position"][k] - copies.goals[k])
        assert away > copies.env.goal_tolerance
        assert not infos["is_success"][k]
    assert len({tuple(row) for row in observations["stance"].tolist()}) > 100
    assert m > 30


def test_goals_can_be_reached_from_the_starts_that_are_given(single):
    """A plan of the planner joins each pair; without a start the goal alone may be given."""
    copies = MlivrVectorEnv(60, env=single)
    graph, rng = single.graph, np.random.default_rng(3)
    starts = [graph.ids(random_state(graph, rng).stance) for _ in range(60)]
    _, infos = copies.reset(seed=11, options={"start": starts})
    planner = Planner(graph)
    assert [tuple(row) for row in infos["stance"]] == starts
    for k in range(60):
        assert tuple(copies.masks[k].tolist()) == graph.state(starts[k]).masks
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


@pytest.mark.usefixtures("cache")
def test_tasks_are_as_far_as_those_of_the_single_environment(small_map):
    """Distances of 400 tasks each, by the two-sample Kolmogorov-Smirnov test."""
    copies = MlivrVectorEnv(400, map=small_map, collisions=False)
    _, infos = copies.reset(seed=0)
    ours = np.linalg.norm(infos["base_position"] - copies.goals, axis=1)
    single, theirs = copies.env, []
    for seed in range(400):
        _, info = single.reset(seed=seed)
        theirs.append(np.linalg.norm(info["base_position"] - single.goal))
    assert ks_2samp(ours, theirs).pvalue > 0.001
    assert ks_2samp(ours, np.array(theirs) * 1.3).pvalue < 0.001
