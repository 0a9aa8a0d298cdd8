"""Training by each algorithm: checkpoints, interruptions and seeds."""

import json

import pytest
import torch

from mlivr_gym.agents import evaluate
from mlivr_gym.agents.hyperparameters import METHODS, hyperparameters
from mlivr_gym.agents.imitation import Imitation
from mlivr_gym.agents.learned import load_policy, made_for, save_policy
from mlivr_gym.agents.networks import make_policy
from mlivr_gym.agents.training import train
from mlivr_gym.errors import SettingError


@pytest.mark.parametrize("network", ["pointer", "mlp"])
@pytest.mark.parametrize("method", METHODS)
def test_each_algorithm_trains_and_its_checkpoint_acts_alike(env, tmp_path, method, network, short):
    settings = hyperparameters(method)
    sizes = {"pointer": {"width": 16, "summary": 8}, "mlp": {"net_arch": [16]}}
    settings["networks"] = sizes
    if "imitation" in settings:
        settings["imitation"] = settings["imitation"] | short
    if "ppo" in settings:
        ppo = settings["ppo"] | {"n_steps": 32, "batch_size": 64}
        settings |= {"copies": 4, "timesteps": 256, "ppo": ppo}
    phases, init = {}, None
    if method == "finetune":
        init = tmp_path / "first"
        config = {"network": network, "sizes": sizes[network]} | made_for(env, network)
        save_policy(init, make_policy(env, network, sizes[network]), config)
        with pytest.raises(SettingError, match="needs a checkpoint"):
            train(method, network, env=env, settings=settings)
    trained = train(
        method, network, 1, env=env, settings=settings, init=init, out=tmp_path / "policy",
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
    ppo = {"copies": 4, "timesteps": 10**6, "ppo": {"n_steps": 32, "batch_size": 64}}
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
            method, seed=1, env=env, settings=settings, out=tmp_path / "policy", progress=interrupt
        )
    policy = load_policy(tmp_path / "policy", env)
    assert policy.config["interrupted"] is True
    torch.manual_seed(1)
    untrained = make_policy(env, "pointer", sizes["pointer"]).state_dict()
    assert any(
        not torch.equal(value, untrained[name])
        for name, value in policy.policy.state_dict().items()
    )


def test_a_training_interrupted_at_once_overwrites_nothing(env, tmp_path, monkeypatch, short):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Imitation, "gather", interrupt)
    settings = {"imitation": short, "networks": {"pointer": {"width": 16, "summary": 8}}}
    with pytest.raises(KeyboardInterrupt, match="nothing was written"):
        train("bc", env=env, settings=settings, out=tmp_path / "policy")
    assert not list(tmp_path.iterdir())


def test_equal_seeds_train_equal_policies(env, short):
    settings = {"imitation": short, "networks": {"pointer": {"width": 16, "summary": 8}}}
    a, b, c = (
        train("bc", "pointer", seed, env=env, settings=settings).policy.state_dict()
        for seed in (5, 5, 6)
    )
    assert all(torch.equal(a[name], b[name]) for name in a)
    assert any(not torch.equal(a[name], c[name]) for name in a)
