"""Grasps that fail: how often, and how likely at each point."""

import numpy as np
import pytest

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.grasp_failure import failure_probabilities
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.errors import SettingError

pytestmark = pytest.mark.usefixtures("cache")


def test_failure_probabilities():
    drawn = failure_probabilities(20_000, 0.2, seed=1)
    assert drawn.mean() == pytest.approx(0.2, abs=0.005)
    assert drawn.min() >= 0.0
    assert drawn.max() <= 0.4
    np.testing.assert_array_equal(
        failure_probabilities(3, np.array([0.0, 0.5, 0.9])), [0.0, 0.5, 0.9]
    )
    with pytest.raises(SettingError, match="3 numbers"):
        failure_probabilities(3, np.array([0.0, 0.5]))
    with pytest.raises(SettingError, match=r"grasp_failure\[1\] is 1.0; .*0 to 0.95"):
        failure_probabilities(3, np.array([0.0, 1.0, 0.5]))


@pytest.mark.parametrize("vector", [False, True])
def test_grasps_fail_as_often_as_said(small_map, vector):
    """Failed attempts against their probabilities; they keep the stance and cost a step."""
    options = {
        "map": small_map,
        "collisions": False,
        "goal_tolerance": 0.0,
        "grasp_failure": 0.3,
        "grasp_failure_seed": 4,
    }
    rng = np.random.default_rng(0)
    expected, failed, attempts = 0.0, 0, 0
    if vector:
        copies = MlivrVectorEnv(64, None, **options)
        before, infos = copies.reset(seed=0)
        risk, m = copies.env.failure_probability, len(small_map)
        for _ in range(60):
            actions = (rng.random(infos["action_mask"].shape) * infos["action_mask"]).argmax(axis=1)
            after, _, _, _, infos = copies.step(actions)
            stayed = (after["stance"] == before["stance"]).all(axis=1)
            np.testing.assert_array_equal(stayed, infos["grasp_failed"])
            expected, failed = expected + risk[actions % m].sum(), failed + stayed.sum()
            attempts, before = attempts + 64, after
    else:
        env = MlivrEnv(**options)
        _, info = env.reset(seed=0)
        for _ in range(1500):
            before, moved = info["stance"], info["base_translation"]
            action = int(rng.choice(np.flatnonzero(info["action_mask"])))
            expected += env.failure_probability[action % len(small_map)]
            _, reward, _, _, info = env.step(action)
            assert info["grasp_failed"] == (info["stance"] == before)
            assert info["action_mask"].any()
            assert reward == -1.0
            assert info["action_mask"][action] or not info["grasp_failed"]
            assert info["base_translation"] >= moved
            failed, attempts = failed + info["grasp_failed"], attempts + 1
    assert abs(failed - expected) < 4.0 * np.sqrt(expected)
    assert attempts > 1000
