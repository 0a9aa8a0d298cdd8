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


def test_points_far_from_the_robot_and_from_its_way_do_not_count(env, policy):
    """In the means of the summary, which weigh points by their distance; near ones do."""
    env.reset(seed=1)
    seen = as_tensors(policy, env_features(env))
    away = seen["points"][0, :, :3].norm(dim=1)
    kinds, network = {"far": 40.0, "near": float(away.min())}, policy.mlp_extractor
    nearest = int(away.argmin())
    with torch.no_grad():
        for kind, distance in kinds.items():
            point = seen["points"][:, nearest : nearest + 1].clone()
            if kind == "far":
                point[..., :3] *= distance / point[..., :3].norm()
            limbs = torch.zeros_like(seen["limbs"][:, :, :1])
            more = {
                "points": torch.cat([seen["points"], point], dim=1),
                "limbs": torch.cat([seen["limbs"], limbs], dim=2),
                "goal": seen["goal"],
            }
            ours, theirs = (
                network.summarise(rows, network.codes(rows))[0] for rows in (seen, more)
            )
            size = ours.shape[1] // 4
            means = torch.cat([ours[:, :size], ours[:, 2 * size : 3 * size]], dim=1)
            others = torch.cat([theirs[:, :size], theirs[:, 2 * size : 3 * size]], dim=1)
            same = torch.allclose(means, others, atol=1e-5)
            assert same == (kind == "far")
