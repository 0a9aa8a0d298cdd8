"""The vector environment against single ones, its tables, and what it refuses."""

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.errors import GoalError, SettingError, StanceError, UnknownPointError

pytestmark = pytest.mark.usefixtures("cache")


class UserTasks:
    """A user's generator, which draws what the default one does."""

    def draw(self, graph, rng, tolerance, start=None):
        return sample_task(graph, rng, tolerance, start)


def same(ours, theirs):
    return all(np.array_equal(ours[name], theirs[name]) for name in theirs)


def test_a_copy_whose_episode_has_ended_is_not_stepped(small_map):
    copies = MlivrVectorEnv(3, 1, AutoresetMode.DISABLED, map=small_map, collisions=False)
    _, infos = copies.reset(seed=0)
    *_, infos = copies.step(infos["action_mask"].argmax(axis=1))
    with pytest.raises(SettingError, match="the episode of sub-environment 0 has ended"):
        copies.step(infos["action_mask"].argmax(axis=1))


def test_what_copies_cannot_do_is_named(small_map):
    env = MlivrEnv(map=small_map, collisions=False)
    with pytest.raises(SettingError, match="env and reward, tasks are both given"):
        MlivrVectorEnv(2, env=env, reward="base", tasks="far")
    for words, change in (
        ("takes no render_mode", {"render_mode": "rgb_array"}),
        ("num_envs is 0; it must be a whole number from 1", {"num_envs": 0}),
        ("exact tables need two limbs", {"robot": "mlivr3", "collisions": False}),
        ("the vector environment needs dynamics='kinematic'", {"dynamics": "mujoco"}),
    ):
        with pytest.raises(SettingError, match=words):
            MlivrVectorEnv(**({"num_envs": 1, "map": small_map, "collisions": False} | change))


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


def test_faulty_options_are_named_and_change_nothing(small_map):
    copies = MlivrVectorEnv(2, map=small_map, collisions=False)
    observations, infos = copies.reset(seed=0)
    good, goal = infos["stance"].tolist(), copies.goals.tolist()
    far = [small_map.ids[0], small_map.ids[-1]]
    for error, words, options in (
        (SettingError, "options.start has 1 entries; it must have 2", {"start": good[:1]}),
        (SettingError, "options.goal has 3 entries; it must have 2", {"goal": goal[0]}),
        (UnknownPointError, "'Z'", {"start": [good[0], ["Z", good[1][0]]]}),
        (StanceError, "m apart", {"start": [good[0], far]}),
        (GoalError, "outside the cabin", {"start": good, "goal": [goal[0], [60, 0, 0]]}),
        (SettingError, "reset_mask has 1 entries", {"reset_mask": np.array([True])}),
    ):
        with pytest.raises(error, match=words):
            copies.reset(options=options)
        assert copies.stances.tolist() == [
            copies._stance_at[tuple(p)] for p in observations["stance"].tolist()
        ]
        assert copies.goals.tolist() == goal
        assert copies.steps.tolist() == [0, 0]


def test_a_start_from_which_nothing_is_reached_is_named(small_map):
    """With a tolerance as long as the module no goal is far enough."""
    copies = MlivrVectorEnv(2, map=small_map, collisions=False)
    _, infos = copies.reset(seed=0)
    copies.env.goal_tolerance = 20.0
    with pytest.raises(
        StanceError, match=f"no goal that can be reached from start .*{infos['stance'][0][0]}"
    ):
        copies.reset(options={"start": infos["stance"]})
    with pytest.raises(StanceError, match="no start with a goal that can be reached"):
        copies.reset()


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


def test_a_step_that_draws_no_task_changes_nothing(small_map):
    """A copy whose episode has ended is reset by the step; if that fails, the step can be taken."""
    worlds = [MlivrVectorEnv(3, 1, map=small_map, collisions=False) for _ in range(2)]
    for env in worlds:
        env.reset(seed=7)
        env.step(env.action_masks().argmax(axis=1))
    failing = worlds[0]
    failing.env.goal_tolerance, kept = 20.0, failing.env.goal_tolerance
    with pytest.raises(StanceError, match="found on map"):
        failing.step(np.zeros(3, dtype=int))
    failing.env.goal_tolerance = kept
    assert same(*(env.step(np.zeros(3, dtype=int))[0] for env in worlds))


def test_a_batch_holds_integers_of_the_action_space(small_map):
    copies = MlivrVectorEnv(2, map=small_map, collisions=False)
    copies.reset(seed=0)
    told = r"actions must be 2 numbers of Discrete\(76\), in integers"
    for actions in (
        [0.0, 1.0],
        np.array([0.7, 1.2]),
        [0],
        0,
        [0, -1],
        [0, 76],
        [True, False],
        [[0, 1]],
    ):
        with pytest.raises(SettingError, match=told):
            copies.step(actions)
    assert copies.steps.tolist() == [0, 0]
    for kind in (list, lambda pair: np.array(pair, np.uint8), torch.tensor):
        copies.step(kind([0, 1]))


def test_simulated_copies_do_what_single_robots_do_with_disturbances_of_each_episode(small_map):
    """Over the ends of episodes, after which others are drawn."""
    given = {"num_envs": 2, "max_episode_steps": 2, "map": small_map, "limits": "gentle"}
    given |= {"dynamics": "mujoco", "disturbances": "all"}
    copies = gymnasium.make_vec("MLIVR-JEM-v0", **given)
    alone = gymnasium.make_vec("MLIVR-JEM-v0", vectorization_mode="sync", **given)
    first, second = copies.reset()[0]["goal"]
    assert (first != second).any()
    assert data_equivalence(copies.reset(seed=4), alone.reset(seed=4))
    payloads, info = set(), alone.reset(seed=4)[1]
    for _ in range(5):
        actions = info["action_mask"].argmax(axis=1)
        done = alone.step(actions)
        assert data_equivalence(copies.step(actions), done)
        info = done[4]
        robots = [env.unwrapped._executor.simulation for env in alone.envs]
        payloads |= {robot.disturbance.payload for robot in robots}
    copies.close()
    assert len(payloads) == 4  # of two episodes each
