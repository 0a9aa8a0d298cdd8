"""The networks: order and number of points do not matter; sb3-contrib takes both policies."""

import numpy as np
import pytest
import torch

from mlivr_gym.agents.features import LIMB_FEATURES, PointObservation, env_features
from mlivr_gym.agents.networks import as_tensors, logits_and_value


def test_the_pointer_policy_does_not_depend_on_order_or_number(env, policy):
    """Scores are permuted with points and limbs; points neither free nor held change nothing."""
    env.reset(seed=1)
    seen = env_features(env)
    points, limbs = seen["points"], seen["limbs"]
    order = np.random.default_rng(0).permutation(len(env.graph.grasp_map))
    taken = np.tile([[[9.0, 9, 9, 0, 0, 1, 0, 0]]], (1, 7, 1))
    more = np.concatenate([limbs, np.zeros((1, 2, 7, LIMB_FEATURES))], axis=2)
    changed = {
        "turned": {"points": points[:, order], "limbs": limbs[:, :, order]},
        "longer": {"points": np.concatenate([points, taken], axis=1), "limbs": more},
        "swapped": {"limbs": limbs[:, ::-1]},
    }
    found, values = {}, []
    for name, change in {"as it is": {}, **changed}.items():
        rows = {key: array.astype(np.float32) for key, array in (seen | change).items()}
        with torch.no_grad():
            scores, value = logits_and_value(policy, as_tensors(policy, rows))
        found[name] = scores.numpy().reshape(2, -1)
        values.append(float(value))
    scores = found["as it is"]
    assert np.ptp(scores[limbs[0, :, :, 1] > 0]) > 0.1
    np.testing.assert_allclose(found["turned"], scores[:, order], atol=1e-4)
    np.testing.assert_allclose(found["longer"][:, :-7], scores, atol=1e-4)
    np.testing.assert_allclose(found["swapped"], scores[::-1], atol=1e-5)
    np.testing.assert_allclose(values, values[0], atol=1e-4)


@pytest.mark.parametrize("network", ["pointer", "mlp"])
def test_policies_run_in_maskable_ppo(small_map, network, tmp_path):
    """As in stable-baselines3: environments in processes or in this one, and saved models."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    from mlivr_gym.agents.networks import actor_critic_class

    vector = make_vec_env(
        "mlivr_gym:MLIVR-JEM-v0", n_envs=1, seed=0,
        vec_env_cls=SubprocVecEnv if network == "pointer" else DummyVecEnv,
        env_kwargs={"map": small_map, "collisions": False},
        wrapper_class=PointObservation if network == "pointer" else None,
    )  # fmt: skip
    try:
        model = MaskablePPO(actor_critic_class(network), vector, n_steps=16, batch_size=16, seed=0)
        model.learn(32)
        model.save(tmp_path / "model")
        loaded = MaskablePPO.load(tmp_path / "model")
        observation, masks = vector.reset(), np.stack(vector.env_method("action_masks"))
        chosen = [
            one.predict(observation, action_masks=masks, deterministic=True)[0]
            for one in (model, loaded)
        ]
        np.testing.assert_array_equal(*chosen)
        assert masks[0, chosen[0]].all()
    finally:
        vector.close()
