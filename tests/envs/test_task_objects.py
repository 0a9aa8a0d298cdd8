"""Task generators of a user's own: one object serves the single and the vector environment."""

from dataclasses import replace

import numpy as np
import pytest

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.task import Task
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.errors import GoalError, SettingError, StanceError
from mlivr_gym.stances.random_states import random_state

pytestmark = pytest.mark.usefixtures("cache")


class Shuttle:
    """A random start, and one fixed goal; keeps what it was asked and what it gave."""

    def __init__(self, goal):
        self.goal, self.given, self.drawn = goal, [], []

    def draw(self, graph, rng, tolerance, start=None):
        self.given.append((tolerance, start))
        state = random_state(graph, rng) if start is None else start
        self.drawn.append(state)
        return Task(state, np.array(self.goal))


class Fixed:
    """The same task for ever."""

    def __init__(self, task):
        self.task = task

    def draw(self, graph, rng, tolerance, start=None):
        return self.task


@pytest.fixture
def shuttle(small_map):
    return Shuttle(small_map.cabin.mean(axis=0).tolist())


def test_the_vector_environment_takes_start_and_goal_of_each_copy(small_map, shuttle):
    """Also of each that starts anew since its episode has ended."""
    given = {"collisions": False, "tasks": shuttle, "goal_tolerance": 0.15}
    copies = MlivrVectorEnv(5, 1, map=small_map, **given)

    def assert_taken(drawn):
        stances = copies.tables.points[copies.stances].tolist()
        assert [tuple(row) for row in stances] == [state.stance for state in drawn]
        sets = [tuple(row) for row in copies.branch_sets.tolist()]
        assert sets == [state.branch_sets for state in drawn]

    copies.reset(seed=1)
    assert shuttle.given == [(0.15, None)] * 5
    assert_taken(shuttle.drawn)
    np.testing.assert_array_equal(copies.goals, [shuttle.goal] * 5)
    assert len(set(shuttle.drawn)) > 2
    copies.reset(seed=1)
    assert shuttle.drawn[5:] == shuttle.drawn[:5]
    copies.reset()
    assert shuttle.drawn[10:] != shuttle.drawn[:5]
    copies.reset(options={"reset_mask": np.array([False, True, False, True, False])})
    assert len(shuttle.drawn) == 17
    actions = copies.action_masks().argmax(axis=1)
    assert copies.step(actions)[3].all()
    copies.step(actions)
    assert_taken(shuttle.drawn[17:])


def test_what_reset_is_given_is_not_drawn(small_map, shuttle):
    env = MlivrEnv(map=small_map, collisions=False, tasks=shuttle)
    copies = MlivrVectorEnv(2, env=env)
    env.reset(seed=0)
    start, goal = env.state, env.graph.posture(env.state.stance).base_position[0]
    env.reset(seed=1, options={"start": start.stance})
    assert shuttle.given[-1][1] == start
    assert env.state == start
    env.reset(seed=1, options={"goal": goal})
    np.testing.assert_array_equal(env.goal, goal)
    assert env.state == shuttle.drawn[-1]
    copies.reset(seed=1, options={"start": [start.stance] * 2})
    assert [given for _, given in shuttle.given[-2:]] == [start] * 2
    copies.reset(seed=1, options={"goal": [goal] * 2})
    np.testing.assert_array_equal(copies.goals, [goal] * 2)
    count = len(shuttle.drawn)
    env.reset(options={"start": start.stance, "goal": goal})
    copies.reset(options={"start": [start.stance] * 2, "goal": [goal] * 2})
    assert len(shuttle.drawn) == count


def test_faulty_tasks_are_refused(small_map, shuttle):
    """A goal outside the cabin, and a start that is no stance: no environment moves to them."""
    env = MlivrEnv(map=small_map, collisions=False, tasks=shuttle)
    copies = MlivrVectorEnv(2, env=env)
    copies.reset(seed=0)
    before = copies.stances.copy(), copies.goals.copy()
    good, shuttle.goal = shuttle.goal, [0.0, 0.0, 99.0]
    for reset in (env.reset, copies.reset):
        with pytest.raises(GoalError, match="outside the cabin"):
            reset(seed=3)
    shuttle.goal = good
    state = shuttle.drawn[-1]
    for start, error, words in (
        (state._replace(stance=(state.stance[0],) * 2), StanceError, "0.000 m apart"),
        (state._replace(stance=(0, len(small_map) - 1)), StanceError, "spans"),
        (state._replace(branch_sets=(2**70, 1)), StanceError, "whole numbers from 0 to 65535"),
        (state.stance, SettingError, "must be a State"),
    ):
        env.tasks = Fixed(Task(start, np.array(good)))
        for reset in (env.reset, copies.reset):
            with pytest.raises(error, match=words):
                reset(seed=3)
    np.testing.assert_array_equal(copies.stances, before[0])
    np.testing.assert_array_equal(copies.goals, before[1])


def tasks_of(grasp_map, kind):
    """Return an environment, and a function that draws a goal by a seed."""
    tasks = "random" if kind == "random" else "walk"
    env = MlivrEnv(map=grasp_map, collisions=False, tasks=tasks)
    if kind == "from tables":
        env.table_moves()

    def goal(seed):
        if kind == "one by one":
            return sample_task(env.graph, Stream.of_seed(seed), env.goal_tolerance).goal
        env.reset(seed=seed)
        return env.goal

    return env, goal


@pytest.mark.parametrize("kind", ["one by one", "from tables", "random"])
def test_goals_lie_in_the_cabin_though_stances_lie_outside(small_map, kind):
    """The same points with a cabin that ends in the middle of what the base reaches."""
    wide, goal = tasks_of(small_map, kind)
    cabin = small_map.cabin.copy()
    cabin[1, 0] = np.median(wide.graph.base_position[:, 0])
    assert np.mean([goal(seed)[0] > cabin[1, 0] for seed in range(12)]) > 0.2
    _, goal = tasks_of(replace(small_map, cabin=cabin), kind)
    goals = np.array([goal(seed) for seed in range(12)])
    assert ((cabin[0] <= goals) & (goals <= cabin[1])).all()
