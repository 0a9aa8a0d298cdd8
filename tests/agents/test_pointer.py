"""The pointer network: neither the order of points and limbs nor their number matters."""

import numpy as np
import torch

from mlivr_gym.agents.features import LIMB, env_features
from mlivr_gym.agents.networks import as_tensors, scores_and_value


def test_the_pointer_policy_does_not_depend_on_order_or_number_of_points(env, policy):
    """Scores are permuted with the points; points neither free nor held change nothing."""
    env.reset(seed=1)
    seen = env_features(env)
    order = np.random.default_rng(0).permutation(len(env.graph.grasp_map))
    turned = {
        "points": seen["points"][:, order],
        "limbs": seen["limbs"][:, :, order],
        "goal": seen["goal"],
    }
    taken = [[[9.0, 9, 9, 0, 0, 1, 0, 0]]]
    more = {
        "points": np.concatenate([seen["points"], np.tile(taken, (1, 7, 1))], axis=1),
        "limbs": np.concatenate([seen["limbs"], np.zeros((1, 2, 7, LIMB))], axis=2),
        "goal": seen["goal"],
    }
    more = {name: rows.astype(np.float32) for name, rows in more.items()}
    with torch.no_grad():
        scores, value = scores_and_value(policy, as_tensors(policy, seen))
        scores = scores.reshape(2, -1)
        other, other_value = scores_and_value(policy, as_tensors(policy, turned))
        longer, longer_value = scores_and_value(policy, as_tensors(policy, more))
    assert np.ptp(scores.numpy()[seen["limbs"][0, :, :, 1] > 0]) > 0.1
    np.testing.assert_allclose(other.reshape(2, -1), scores[:, order], atol=1e-4)
    np.testing.assert_allclose(longer.reshape(2, -1)[:, :-7], scores, atol=1e-4)
    np.testing.assert_allclose([other_value, longer_value], [value, value], atol=1e-4)


def test_the_pointer_policy_does_not_depend_on_the_order_of_limbs(env, policy):
    env.reset(seed=1)
    seen = env_features(env)
    with torch.no_grad():
        scores, value = scores_and_value(policy, as_tensors(policy, seen))
        swapped = {**seen, "limbs": seen["limbs"][:, ::-1]}
        other, other_value = scores_and_value(policy, as_tensors(policy, swapped))
    np.testing.assert_allclose(other.reshape(2, -1).flip(0), scores.reshape(2, -1), atol=1e-5)
    np.testing.assert_allclose(other_value, value, atol=1e-5)
