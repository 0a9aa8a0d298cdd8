"""The policies of both networks in the hands of sb3-contrib."""

import numpy as np
import pytest

from mlivr_gym.agents.features import PointObservation


@pytest.mark.parametrize("network", ["pointer", "mlp"])
def test_policies_run_in_maskable_ppo_and_subprocesses(small_map, network, tmp_path):
    """As in stable-baselines3: single environments in processes, model saved and loaded by it."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import SubprocVecEnv

    from mlivr_gym.agents.networks import policy_class

    vector = make_vec_env(
        "mlivr_gym:MLIVR-JEM-v0", n_envs=2, seed=0, vec_env_cls=SubprocVecEnv,
        env_kwargs={"map": small_map, "collisions": False},
        wrapper_class=PointObservation if network == "pointer" else None,
    )  # fmt: skip
    try:
        model = MaskablePPO(policy_class(network), vector, n_steps=16, batch_size=16, seed=0)
        model.learn(32)
        model.save(tmp_path / "model")
        loaded = MaskablePPO.load(tmp_path / "model")
        observation, masks = vector.reset(), np.stack(vector.env_method("action_masks"))
        chosen = [
            one.predict(observation, action_masks=masks, deterministic=True)[0]
            for one in (model, loaded)
        ]
        np.testing.assert_array_equal(*chosen)
        assert masks[np.arange(2), chosen[0]].all()
    finally:
        vector.close()
