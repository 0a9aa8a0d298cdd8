"""The vector environment against single ones, its numbers, rewards, and what it refuses."""

import gymnasium
import numpy as np
import pytest
from env_model import SplitMix
from gymnasium.utils.env_checker import data_equivalence
from scipy.stats import chisquare

from mlivr_gym.envs.batch import random_below
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.rewards import REWARDS, StepOutcome, TotalReward
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.errors import SettingError, StanceError

pytestmark = pytest.mark.usefixtures("cache")


class UserTasks:
    """A user's generator, which draws what the default one does."""

    def draw(self, graph, rng, tolerance, start=None):
        return sample_task(graph, rng, tolerance, start)


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
    """None goes on with the stream."""
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
    with pytest.raises(SettingError, match="seed has 4 entries; it must have 3"):
        copies.reset(seed=[1] * 4)


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
            steps = [env.step(env.action_masks().argmax(axis=1))[0] for env in worlds]
            assert data_equivalence(*steps)
        assert data_equivalence(*(env.reset()[0] for env in worlds))


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


def test_the_edge_of_the_goal_region_belongs_to_it():
    """Exact numbers: at the tolerance the potential is 0, a little farther minus the distance."""
    reward = TotalReward(REWARDS["base"], 5.0, True, 0.9, 0.25)

    def paid(before, after, success):
        return reward(StepOutcome(0.5, before, after, success, True, 9.0, (0, 1), 1))

    assert paid(1.0, 0.25, True) == -0.5 + 5.0 + 0.9 * 0.0 + 1.0
    assert paid(1.0, 0.75, False) == pytest.approx(-0.5 - 0.9 * 0.75 + 1.0)
    both = paid(np.array([1.0, 0.25]), np.array([0.25, 0.75]), np.array([True, False]))
    np.testing.assert_allclose(both, [5.5, -1.175])


class Recorder:
    """Pays nothing and keeps the outcomes."""

    def __init__(self):
        self.outcomes = []

    def __call__(self, outcome):
        self.outcomes.append(outcome)
        return 0.0 * outcome.displacement


def test_rewards_are_asked_about_steps_only(small_map):
    """Copies that a step resets take no action; no entry of any outcome stands for them."""
    reward = Recorder()
    copies = MlivrVectorEnv(6, 2, reward=reward, map=small_map, collisions=False)
    copies.reset(seed=0)
    for k in range(5):
        _, rewards, _, _, _ = copies.step(copies.action_masks().argmax(axis=1))
        assert rewards.shape == (6,)
        if k == 0:  # from now on copy 0 is a step behind the others
            copies.reset(options={"reset_mask": np.arange(6) == 0})
    assert [len(outcome.displacement) for outcome in reward.outcomes] == [6, 6, 1, 5, 6]
    assert all((outcome.displacement > 0.0).all() for outcome in reward.outcomes)
    # A step that only resets asks nothing.
    copies.max_episode_steps = 1
    copies.reset()
    copies.step(copies.action_masks().argmax(axis=1))
    asked = len(reward.outcomes)
    assert copies.step(np.zeros(6, dtype=int))[1].tolist() == [0.0] * 6
    assert len(reward.outcomes) == asked


PUBLISHED = (
    6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431,
    16408922859458223821,
)  # fmt: skip
"""What splitmix64 gives from 1234567 on, as many implementations state for a test."""


def plain(state):
    """The stream of the model of the environments from a state on."""
    stream = SplitMix(0)
    stream.state = state
    return stream


@pytest.mark.parametrize("bound", [1, 331, 10**6])
def test_numbers_below_a_bound(bound):
    """The upper 53 bits as a share of the bound; other streams stay as they are."""
    stream = plain(1234567)  # the model gives the published numbers
    assert [stream.bits() for _ in PUBLISHED] == [number >> 11 for number in PUBLISHED]
    ours, other = Stream.of_seed(3), SplitMix(3)
    assert [ours.integers(bound) for _ in range(200)] == [other.below(bound) for _ in range(200)]
    streams, stream = np.array([5, 1234567, 2**64 - 1], dtype=np.uint64), plain(1234567)
    with np.errstate(over="ignore"):
        for _ in range(200):
            assert random_below(streams, 1, bound) == stream.below(bound)
    assert streams.tolist() == [5, stream.state, 2**64 - 1]


def test_a_choice_has_no_value_twice_and_every_order():
    stream = Stream.of_seed(1)
    drawn = [tuple(stream.choice([4, 5, 6], 2, replace=False)) for _ in range(3000)]
    assert all(a != b for a, b in drawn)
    pairs, counts = np.unique(drawn, axis=0, return_counts=True)
    assert len(pairs) == 6
    assert chisquare(counts).pvalue > 1e-3


def test_without_a_seed_every_copy_has_a_stream_of_its_own(small_map, cache):
    copies = MlivrVectorEnv(80, map=small_map, collisions=False)
    copies.reset()
    assert len(set(copies._streams.tolist())) == 80
    single, states = MlivrEnv(map=small_map, collisions=False), set()
    for _ in range(80):
        single._seeded, single._np_random = False, None
        single.reset()
        states.add(single._stream.state)
    assert len(states) == 80
