"""Training by each algorithm: checkpoints, interruptions and seeds."""

import json

import gymnasium
import pytest
import torch

from mlivr_gym.agents import evaluate
from mlivr_gym.agents.hyperparameters import METHODS, load_hyperparameters
from mlivr_gym.agents.imitation import Imitation
from mlivr_gym.agents.learned import load_policy, made_for, save_policy
from mlivr_gym.agents.networks import make_actor_critic
from mlivr_gym.agents.training import train
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import SettingError


@pytest.mark.parametrize(
    ("method", "network"), [*((method, "pointer") for method in METHODS), ("ppo", "mlp")]
)
def test_each_algorithm_trains_and_its_checkpoint_acts_alike(env, tmp_path, method, network, short):
    settings = load_hyperparameters(method)
    sizes = {"pointer": {"width": 16, "summary": 8}, "mlp": {"net_arch": [16]}}
    settings["networks"] = sizes
    if "imitation" in settings:
        settings["imitation"] = settings["imitation"] | short
    if "ppo" in settings:
        ppo = settings["ppo"] | {"n_steps": 32, "batch_size": 64}
        settings |= {"n_envs": 4, "timesteps": 256, "ppo": ppo}
    phases, init = {}, None
    if method == "finetune":
        init = tmp_path / "first"
        config = {"network": network, "sizes": sizes[network]} | made_for(env, network)
        save_policy(init, make_actor_critic(env, network, sizes[network]), config)
        with pytest.raises(SettingError, match="needs a checkpoint"):
            train(method, network, env=env, hyperparameters=settings)
        other = settings | {"networks": {"pointer": {"width": 8}, "mlp": {"net_arch": [8]}}}
        for wrong in (other, settings | {"networks": {}}):
            with pytest.raises(SettingError, match="network and sizes of the checkpoint"):
                train(method, network, env=env, hyperparameters=wrong, init=init)
    trained = train(
        method, network, 1, env=env, hyperparameters=settings, init=init, out=tmp_path / "policy",
        command="none",
        progress=lambda phase, done, total, figures: phases.update({phase: (done, total)}),
    )  # fmt: skip
    assert phases
    assert all(done == total for done, total in phases.values())
    config = json.loads((tmp_path / "policy.json").read_text())
    assert config["method"] == method
    assert config["seed"] == 1
    assert config["sizes"] == sizes[network]
    loaded = load_policy(tmp_path / "policy", env)
    observation, _ = env.reset(seed=0)
    assert loaded.act(env, observation, env.action_masks()) == trained.act(
        env, observation, env.action_masks()
    )
    assert evaluate(env, loaded, 2, max_steps=5).steps.max() <= 5


@pytest.mark.parametrize("method", ["bc", "ppo"])
def test_an_interrupted_training_leaves_what_was_learned(env, tmp_path, method, short):
    sizes = {"pointer": {"width": 16, "summary": 8}}
    ppo = {"n_envs": 4, "timesteps": 10**6, "ppo": {"n_steps": 32, "batch_size": 64}}
    settings = {"networks": sizes} | ({"imitation": short} if method == "bc" else ppo)
    told = []

    def interrupt(*_):
        told.append(0)
        if len(told) == 3:
            raise KeyboardInterrupt

    with pytest.raises(
        KeyboardInterrupt, match=r"interrupted after .*policy\.pt and \.json hold what was learned"
    ):
        train(
            method, seed=1, env=env, hyperparameters=settings, out=tmp_path / "policy",
            progress=interrupt,
        )  # fmt: skip
    policy = load_policy(tmp_path / "policy", env)
    assert policy.config["interrupted"] is True
    torch.manual_seed(1)
    untrained = make_actor_critic(env, "pointer", sizes["pointer"]).state_dict()
    assert any(
        not torch.equal(value, untrained[name])
        for name, value in policy.actor_critic.state_dict().items()
    )


def test_a_training_interrupted_at_once_overwrites_nothing(env, tmp_path, monkeypatch, short):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Imitation, "gather", interrupt)
    settings = {"imitation": short, "networks": {"pointer": {"width": 16, "summary": 8}}}
    with pytest.raises(KeyboardInterrupt, match="nothing was written"):
        train("bc", env=env, hyperparameters=settings, out=tmp_path / "policy")
    assert not list(tmp_path.iterdir())


def test_equal_seeds_train_equal_policies(env, short):
    settings = {"imitation": short, "networks": {"pointer": {"width": 16, "summary": 8}}}
    a, b, c = (
        train("bc", "pointer", seed, env=env, hyperparameters=settings).actor_critic.state_dict()
        for seed in (5, 5, 6)
    )
    assert all(torch.equal(a[name], b[name]) for name in a)
    assert any(not torch.equal(a[name], c[name]) for name in a)


def test_a_checkpoint_states_the_arguments_of_its_environment(small_map, short):
    """Of `gymnasium.make`; None if they are unknown, the type of what JSON cannot hold."""

    def reward(outcome):
        return -1.0

    given = {"imitation": short | {"rounds": 1}, "networks": {"mlp": {"net_arch": [4]}}}
    arguments = {"map": small_map, "collisions": False, "goal_tolerance": 0.25}
    made = gymnasium.make("MLIVR-JEM-Far-v0", **arguments).unwrapped
    stored = train("bc", "mlp", env=made, hyperparameters=given).config["env"]
    again = MlivrEnv(**stored)
    assert again.goal_tolerance == 0.25
    assert again.tasks.far
    assert again.graph.grasp_map.fingerprint == small_map.fingerprint
    assert train("bc", "mlp", env=again, hyperparameters=given).config["env"] is None
    with pytest.raises(SettingError, match="env and env_arguments are both given"):
        train("bc", "mlp", env=made, env_arguments=arguments)
    ppo = {"n_envs": 2, "timesteps": 8, "ppo": {"n_steps": 4, "batch_size": 8}}
    config = train(
        "ppo", "mlp", env_arguments=arguments | {"reward": reward},
        hyperparameters=ppo | {"networks": {"mlp": {"net_arch": [4]}}},
    ).config  # fmt: skip
    assert config["env"]["reward"] == "not stored: an object of type builtins.function"
    json.dumps(config)
