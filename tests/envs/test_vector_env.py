"""The vector environment against single ones, its tables, and what it refuses."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.errors import SettingError, StanceError

pytestmark = pytest.mark.usefixtures("cache")


class UserTasks:
    """A user's generator, which draws what the default one does."""

    def draw(self, graph, rng, tolerance, start=None):
        return sample_task(graph, rng, tolerance, start)


def same(ours, theirs):
    return all(np.array_equal(ours[name], theirs[name]) for name in theirs)


def test_nothing_goes_before_the_first_reset(small_map):
    """Not even where one task is all there is."""
    for mode in ("NextStep", "Disabled"):
        copies = MlivrVectorEnv(2, autoreset_mode=mode, map=small_map, collisions=False)
        for call in (copies.action_masks, lambda c=copies: c.step(np.zeros(2, dtype=int))):
            with pytest.raises(
                gymnasium.error.ResetNeeded, match="sub-environment 0 was never reset"
            ):
                call()
        copies.reset(seed=0, options={"reset_mask": np.array([True, False])})
        with pytest.raises(gymnasium.error.ResetNeeded, match="sub-environment 1 was never reset"):
            copies.step(np.zeros(2, dtype=int))
        copies.reset(options={"reset_mask": np.array([False, True])})
        copies.step(copies.action_masks().argmax(axis=1))


def test_a_list_of_seeds_seeds_each_copy_that_starts_anew(small_map):
    """None goes on with the stream; without seeds two draws of eight tasks are not alike."""
    copies = MlivrVectorEnv(3, map=small_map, collisions=False)

    def drawn(seed, options=None):
        copies.reset(seed=seed, options=options)
        stances = copies.tables.points[copies.stances].tolist()
        return [(*s, *g) for s, g in zip(stances, copies.goals, strict=True)]

    assert drawn([7, np.int32(6), 5]) == drawn(np.int64(5))[::-1]
    later = drawn(None)
    drawn(5)
    assert drawn([None, 9, None])[::2] == later[::2]
    drawn(5)
    drawn([1, 2, 3], {"reset_mask": np.array([True, False, False])})
    assert drawn(None)[1:] == later[1:]
    for words, seed in (
        ("seed has 4 entries; it must have 3", [1] * 4),
        ("1. is 2.0", [1, 2.0, 3]),
    ):
        with pytest.raises(SettingError, match=words):
            copies.reset(seed=seed)
    fresh = [MlivrVectorEnv(8, map=small_map, collisions=False) for _ in range(2)]
    for env in fresh:
        env.reset()
    assert (fresh[0].goals != fresh[1].goals).any()


@pytest.mark.parametrize("tasks", ["walk", "of a user"])
def test_a_reset_that_fails_leaves_the_streams(small_map, tasks):
    """Tasks after a refused reset are those without it, drawn by tables or by a user's object."""
    if tasks != "walk":
        tasks = UserTasks()
    worlds = [MlivrVectorEnv(3, 2, map=small_map, collisions=False, tasks=tasks) for _ in range(2)]
    for seed in (7, None):
        for env in worlds:
            env.reset(seed=seed)
        failing = worlds[0]
        failing.env.goal_tolerance, kept = 20.0, failing.env.goal_tolerance
        for options in ({"seed": 11}, {}, {"seed": [None, 5, None]}):
            with pytest.raises(StanceError, match="found on map"):
                failing.reset(**options)
        failing.env.goal_tolerance = kept
        for _ in range(5):
            ours, theirs = (env.step(env.action_masks().argmax(axis=1))[0] for env in worlds)
            assert same(ours, theirs)
        assert same(*(env.reset()[0] for env in worlds))


def test_simulated_copies_do_what_single_robots_do_with_disturbances_of_each_episode(small_map):
    """Over the ends of episodes, after which others are drawn."""
    given = {"num_envs": 2, "max_episode_steps": 2, "map": small_map, "limits": "gentle"}
    given |= {"dynamics": "mujoco", "disturbances": "all"}
    copies = gymnasium.make_vec("MLIVR-JEM-v0", **given)
    alone = gymnasium.make_vec("MLIVR-JEM-v0", vectorization_mode="sync", **given)
    drawn = copies.reset(seed=4)
    assert (drawn[0]["goal"][0] != drawn[0]["goal"][1]).any()
    assert data_equivalence(drawn, alone.reset(seed=4))
    payloads, info = set(), alone.reset(seed=4)[1]
    for _ in range(4):
        actions = info["action_mask"].argmax(axis=1)
        done = alone.step(actions)
        assert data_equivalence(copies.step(actions), done)
        info = done[4]
        robots = [env.unwrapped._executor.simulation for env in alone.envs]
        payloads |= {robot.disturbance.payload for robot in robots}
    copies.close()
    assert len(payloads) == 4  # of two episodes each
