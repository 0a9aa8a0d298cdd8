"""Robots and places that are not seen in training, against the environments of each world."""

import numpy as np
import pytest

from mlivr_gym.agents import RandomPolicy, evaluate, planner_policy
from mlivr_gym.envs import MlivrEnv
from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.extensions.unseen import HELD_OUT, TRAINING, UnseenEnv
from mlivr_gym.robot.specification import ROBOTS
from mlivr_gym.world import PLACES

pytestmark = pytest.mark.usefixtures("cache")


@pytest.fixture(scope="module")
def worlds(small_map):
    """Two worlds to train in and two that are held out, on two maps."""
    part = small_map.subset(np.arange(len(small_map)) < 40, "part")
    return (
        (("mlivr2", small_map), ("mlivr2", part)),
        (("mlivr2-unequal", part), ("mlivr2-unequal", small_map)),
    )


@pytest.fixture(scope="module")
def env(worlds, cache):
    return UnseenEnv(*worlds, collisions=False)


def alone(world):
    """The environment of one world."""
    return MlivrEnv(*world, collisions=False, tasks="anywhere")


def test_fixed_tasks_are_those_of_held_out_worlds_and_others_are_not(env, worlds):
    training, held_out = worlds
    drawn = set()
    for seed in range(8):
        env.reset(seed=seed)
        drawn.add((env.graph.robot.name, env.graph.grasp_map.name))
    assert drawn == {(robot, place.name) for robot, place in training}
    for task in range(4):
        observation, info = env.reset(options={"task": task})
        one = alone(held_out[task % 2])
        seen, told = one.reset(options={"task": task})
        assert env.graph.robot.name == held_out[task % 2][0]
        count = len(one.graph.grasp_map)
        for name, values in seen.items():
            np.testing.assert_array_equal(observation[name], values)
        places = observation["points"].reshape(-1, 3)
        np.testing.assert_allclose(places[:count], one.graph.grasp_map.positions, atol=1e-6)
        assert not places[count:].any()
        assert observation["exists"].tolist() == [k < count for k in range(len(places))]
        assert observation["span"] == pytest.approx(env.graph.robot.span)
        assert env.observation_space.contains(observation)
        for mask in (info["action_mask"], env.action_masks()):
            np.testing.assert_array_equal(mask[: 2 * count], told["action_mask"])
            assert not mask[2 * count :].any()
            assert mask.shape == (env.action_space.n,)


def test_an_episode_goes_as_in_the_world_alone(env, worlds):
    one = alone(worlds[1][0])
    for each in (one, env):
        each.reset(options={"task": 2})
    policy = planner_policy("steps")
    ended = False
    while not ended:
        action = policy.act(env, {}, env.action_masks())
        observation, reward, ended, *_ = env.step(action)
        other = one.step(action)
        assert (reward, ended) == other[1:3]
        np.testing.assert_array_equal(observation["base_position"], other[0]["base_position"])
    assert evaluate(env, policy, 4).success_rate == 1.0
    evaluate(env, RandomPolicy(), 4, max_steps=5)


def test_actions_that_move_no_limb_are_invalid(env):
    _, info = env.reset(options={"task": 0})
    before = env.state
    _, reward, *_, info = env.step(env.action_space.n - 1)
    assert (info["invalid_action"], reward, env.state) == (True, -1.0, before)
    with pytest.raises(SettingError, match="not a whole number from 0 to"):
        env.step(env.action_space.n)
    with pytest.raises(SettingError, match=r"options.*task"):
        env.reset(options={"task": -1})


def test_no_held_out_world_is_trained_in_and_all_ship():
    assert not {*TRAINING} & {*HELD_OUT}
    robots, places = ({world[k] for world in TRAINING} for k in (0, 1))
    unseen = [(robot not in robots, place not in places) for robot, place in HELD_OUT]
    assert unseen == [(True, False), (False, True), (False, True), (True, True)]
    assert {robot for robot, _ in TRAINING + HELD_OUT} <= {*ROBOTS}
    assert {place for _, place in TRAINING + HELD_OUT} <= {*PLACES}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"robot": "mlivr2"}, "robot is given; this environment chooses it"),
        ({"tasks": "random"}, "has no layouts"),
        ({"training": [("mlivr3", "jem")]}, r"training\[0\] has robot 'mlivr3' with 3 limbs"),
        ({"held_out": []}, "held_out"),
        ({"held_out": [("mlivr2",)]}, r"held_out\[0\]"),
        ({"training": [("mlivr2", "moon")]}, "unknown map 'moon'"),
    ],
)
def test_what_cannot_be_used_is_named(given, words):
    with pytest.raises(MlivrError, match=words):
        UnseenEnv(**given)


def test_episodes_repeat_with_their_seed_whatever_came_before(env):
    found = []
    for _ in range(2):
        env.reset(options={"task": 1})
        episodes = [env.reset(seed=5)[0], env.reset()[0], env.reset()[0]]
        found.append(np.concatenate([np.r_[e["goal"], e["points"].ravel()] for e in episodes]))
    np.testing.assert_array_equal(*found)
