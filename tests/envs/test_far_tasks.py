"""Far tasks lead into the other half of a map; fixed tasks are the same everywhere."""

import numpy as np
import pytest

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.planners import Planner


@pytest.fixture(scope="module")
def env(small_map):
    return MlivrEnv(map=small_map, collisions=False, tasks="far")


def test_start_and_goal_lie_in_opposite_halves_and_are_joined(env):
    places, planner = env.graph.grasp_map.positions, Planner(env.graph)
    axis = int(np.ptp(places, axis=0).argmax())
    middle = 0.5 * (places[:, axis].min() + places[:, axis].max())
    for seed in range(20):
        _, info = env.reset(seed=seed)
        here = info["base_position"][axis]
        assert (here - middle) * (env.goal[axis] - middle) < 0.0
        assert planner.plan(env.state, env.goal, "steps")


def test_copies_draw_what_single_environments_draw(small_map, env):
    copies = MlivrVectorEnv(6, env=MlivrEnv(map=small_map, collisions=False, tasks="far"))
    for count in (1, 2):  # tasks of each stream
        _, info = copies.reset(seed=40 if count == 1 else None)
        for k in range(6):
            for number in range(count):
                _, alone = env.reset(seed=None if number else 40 + k)
            assert tuple(info["stance"][k]) == tuple(alone["stance"])
            np.testing.assert_array_equal(copies.goals[k], env.goal)


@pytest.mark.parametrize("tasks", ["walk", "far"])
def test_a_fixed_task_is_the_same_whatever_was_drawn_before(small_map, tasks):
    made = [MlivrEnv(map=small_map, collisions=False, tasks=tasks) for _ in range(2)]
    for k, one in enumerate(made):
        one.reset(seed=k)
    seen = []
    for number in (0, 7, 999_999):
        found = [one.reset(options={"task": number})[1]["stance"] for one in made]
        assert found[0] == found[1]
        np.testing.assert_array_equal(made[0].goal, made[1].goal)
        seen.append((found[0], made[0].goal.tolist()))
    assert len({str(one) for one in seen}) == 3
    copies = MlivrVectorEnv(3, env=made[0])
    _, info = copies.reset(seed=3, options={"task": [0, 7, 999_999]})
    for k, (stance, goal) in enumerate(seen):
        assert tuple(info["stance"][k]) == tuple(stance)
        np.testing.assert_array_equal(copies.goals[k], goal)


def test_a_fixed_task_takes_no_number_of_the_stream(small_map):
    first, second = (MlivrEnv(map=small_map, collisions=False) for _ in range(2))
    for one in (first, second):
        one.reset(seed=5)
    first.reset(options={"task": 3})
    assert first.reset()[1]["stance"] == second.reset()[1]["stance"]
    np.testing.assert_array_equal(first.goal, second.goal)
