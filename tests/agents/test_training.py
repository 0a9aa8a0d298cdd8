"""Training: hyperparameters, checkpoints, interruptions, seeds, and the commands."""

import argparse
import json
from dataclasses import replace
from unittest.mock import Mock

import gymnasium
import numpy as np
import pytest
import torch

from mlivr_gym.agents import evaluate
from mlivr_gym.agents.evaluation import Evaluation
from mlivr_gym.agents.hyperparameters import (
    METHODS,
    check_hyperparameters,
    fill_dagger,
    load_hyperparameters,
)
from mlivr_gym.agents.imitation import Imitation
from mlivr_gym.agents.learned import load_policy, made_for, save_policy
from mlivr_gym.agents.networks import make_actor_critic
from mlivr_gym.agents.test_set import SPLITS, load_test_set
from mlivr_gym.agents.training import train
from mlivr_gym.cli.evaluate import _worlds, summary_of
from mlivr_gym.cli.main import main
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import SettingError
from mlivr_gym.world.grasp_map import GraspMap


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
    mask = env.action_masks()
    assert loaded.act(env, observation, mask) == trained.act(env, observation, mask)
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
    trained = policy.actor_critic.state_dict()
    assert any(not torch.equal(value, untrained[name]) for name, value in trained.items())


def test_a_training_interrupted_at_once_overwrites_nothing(env, tmp_path, monkeypatch, short):
    monkeypatch.setattr(Imitation, "gather", Mock(side_effect=KeyboardInterrupt))
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


SHIPPED = json.loads(asset_path("training.json").read_text())


@pytest.mark.parametrize("method", METHODS)
def test_the_shipped_ones_are_returned_as_they_are(method):
    plain = json.loads(json.dumps(load_hyperparameters(method)))
    assert plain == SHIPPED[method] | {"networks": SHIPPED["networks"]}
    assert load_hyperparameters(method, asset_path("training.json")) == load_hyperparameters(method)


def test_the_method_says_whether_the_policy_walks():
    part = check_hyperparameters({"imitation": {"rounds": 3}, "networks": {}})
    for method, dagger in (("bc", False), ("dagger", True)):
        assert fill_dagger(method, part)["imitation"] == {"rounds": 3, "dagger": dagger}
        wrong = {"imitation": {"dagger": not dagger}, "networks": {}}
        with pytest.raises(SettingError, match=f"dagger is {not dagger}; method '{method}'"):
            fill_dagger(method, wrong)
    assert fill_dagger("ppo", part) == part


@pytest.mark.parametrize(
    ("method", "path", "value", "words"),
    [
        ("bc", ("bc", "imitation", "round"), 3, "bc.imitation has an unknown field 'round'; .*mea"),
        ("ppo", ("networks", "mlp", "net_arch"), [3, "x"], r"networks.mlp.net_arch\[1\] is 'x'"),
        ("ppo", ("ppo",), {}, "neither imitation nor ppo"),
        ("ppo", ("ppo",), {"ppo": {}}, "ppo.n_envs is missing; .*go together"),
        ("bc", ("bc",), None, "bc is missing"),
        ("bc", ("networks",), None, "networks is missing"),
    ],
)
def test_a_field_that_is_faulty_or_missing_is_named(tmp_path, method, path, value, words):
    data = json.loads(json.dumps(SHIPPED))
    place = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    if value is None:
        del place[path[-1]]
    file = tmp_path / "hyper.json"
    file.write_text(json.dumps(data))
    with pytest.raises(SettingError, match=rf"^hyperparameters '.*hyper\.json': .*{words}"):
        load_hyperparameters(method, file)


def test_commands_train_and_evaluate(capsys, tmp_path, short, ladder_file):
    assert GraspMap.load(ladder_file)
    hyper = {"bc": {"imitation": short}, "networks": {"pointer": {"width": 16, "summary": 8}}}
    (tmp_path / "hyper.json").write_text(json.dumps(hyper))
    common = ["--map", str(ladder_file), "--no-collisions"]
    out = tmp_path / "policy"
    arguments = f"--method bc --hyperparameters {tmp_path / 'hyper.json'} --out {out}".split()
    torch.set_num_threads(2)
    assert main(["train", *common, *arguments]) == 0
    assert torch.get_num_threads() == 1  # these small networks lose time with more
    assert out.with_suffix(".pt").exists()
    assert out.with_suffix(".json").exists()
    for policy in (str(out), "expert", "mcts", "astar"):
        assert main(["evaluate", *common, "--policy", policy, "--episodes", "2"]) == 0
    assert "2 of 2 episodes" in capsys.readouterr().out
    assert main(["evaluate", *common, "--policy", "magic"]) == 2
    assert "policy is 'magic'" in capsys.readouterr().err


@pytest.mark.parametrize("split", SPLITS)
def test_a_split_is_evaluated_with_all_its_tasks(split):
    """Each world of the split with its own map; nothing of the other splits."""
    worlds = [world for world in load_test_set() if world.split == split]
    found = _worlds(argparse.Namespace(split=split, episodes=7))
    assert [(a["map"].fingerprint, tasks) for a, tasks in found] == [
        (world.map().fingerprint, world.tasks) for world in worlds
    ]
    assert _worlds(argparse.Namespace(split=None, episodes=7)) == [({}, 7)]


def test_what_is_told_are_means_over_what_reached_the_goal():
    """Steps and metres of the episodes that did, in all worlds; the first action of every one."""
    one = Evaluation(
        np.array([True, False, True]), np.array([2, 90, 5]), np.array([1.0, 9.0, 2.5]),
        np.array([0.01, 0.02, 0.03]), np.zeros(3), np.zeros(3, dtype=int), np.full(3, np.nan),
        np.full(3, np.nan), np.full(3, np.nan),
    )  # fmt: skip
    none = replace(one, success=np.zeros(3, dtype=bool))
    other = replace(one, success=np.array([False, True, False]))
    told = summary_of([one, other, none])
    assert (told["episodes"], told["successes"]) == (9, 3)
    means = told["mean_steps"], told["mean_base_translation"], told["mean_first_action_time"]
    assert means == pytest.approx((97.0 / 3.0, 12.5 / 3.0, 0.02))
    assert summary_of([none])["mean_steps"] is None
