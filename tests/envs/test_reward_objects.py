"""Rewards of a user's own: one object serves the single and the vector environment."""

import numpy as np
import pytest

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.rewards import BaseReward, StepOutcome, TotalReward
from mlivr_gym.envs.vector_env import MlivrVectorEnv

pytestmark = pytest.mark.usefixtures("cache")


def test_the_edge_of_the_goal_region_belongs_to_it():
    """Exact numbers: at the tolerance the potential is 0, a little farther minus the distance."""
    reward = TotalReward(BaseReward(), 5.0, True, 0.9, 0.25)

    def paid(before, after, success):
        return reward(StepOutcome(0.5, before, after, success, True, 9.0))

    assert paid(1.0, 0.25, True) == -0.5 + 5.0 + 0.9 * 0.0 + 1.0
    assert paid(1.0, 0.75, False) == pytest.approx(-0.5 - 0.9 * 0.75 + 1.0)
    both = paid(np.array([1.0, 0.25]), np.array([0.25, 0.75]), np.array([True, False]))
    np.testing.assert_allclose(both, [5.5, -1.175])


class Toll:
    """Uses every figure of the outcome, with weights that tell them apart."""

    def __call__(self, outcome):
        progress = outcome.distance_before - outcome.distance_after
        toll = np.where(outcome.valid, 0.25, 4.0)
        return 3.0 * progress - outcome.displacement - toll + 7.0 * outcome.success


class Recorder:
    """Pays nothing and keeps the outcomes."""

    def __init__(self):
        self.outcomes = []

    def __call__(self, outcome):
        self.outcomes.append(outcome)
        return 0.0 * outcome.displacement


def worlds(small_map, reward, **arguments):
    arguments = {"map": small_map, "collisions": False} | arguments
    return MlivrEnv(reward=reward, **arguments), MlivrVectorEnv(6, None, reward=reward, **arguments)


def paired_steps(single, copies, count=8):
    """Rewards of steps that both environments take from the same states, allowed and masked out."""
    rng, ours, theirs = np.random.default_rng(0), [], []
    copies.reset(seed=5)
    for _ in range(count):
        masks = copies.action_masks()
        actions = [int(rng.choice(np.flatnonzero(mask ^ (rng.random() < 0.2)))) for mask in masks]
        starts = copies.tables.points[copies.stances].tolist()
        branches, goals = copies.branch_sets.copy(), copies.goals.copy()
        _, rewards, terminated, _, _ = copies.step(actions)
        for k, action in enumerate(actions):
            single.reset(options={"start": starts[k], "goal": goals[k]})
            single._enter_state(single.state._replace(branch_sets=tuple(branches[k].tolist())))
            theirs.append(single.step(action)[1])
        ours.extend(rewards)
        if terminated.any():
            copies._ended[:] = False  # every step of this test starts where the last one ended
    return np.array(ours), np.array(theirs)


@pytest.mark.parametrize("shaping", [False, True])
def test_both_environments_pay_what_the_object_says(small_map, shaping):
    single, copies = worlds(
        small_map, Toll(), shaping=shaping, success_bonus=2.0, goal_tolerance=0.4
    )
    ours, theirs = paired_steps(single, copies)
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=0.0)
    assert len(set(np.round(ours, 9))) > 30
    assert (ours < -4.0).any()  # masked out
    assert (ours > 7.0).any()  # at the goal


def test_rewards_are_asked_about_steps_only(small_map):
    """Copies that a step resets take no action; no entry of any outcome stands for them."""
    reward = Recorder()
    _, copies = worlds(small_map, reward)
    copies.max_episode_steps = 2
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
