"""A faulty field of a file of hyperparameters is named before anything is trained."""

import json

import pytest

from mlivr_gym.agents.hyperparameters import METHODS, checked, hyperparameters
from mlivr_gym.agents.learned import CheckpointError, load_policy, made_for, save_policy
from mlivr_gym.agents.training import train
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import SettingError
from mlivr_gym.settings import GRAPH_RULES

SHIPPED = json.loads(asset_path("training.json").read_text())


@pytest.mark.parametrize("method", METHODS)
def test_the_shipped_ones_are_returned_as_they_are(method):
    plain = json.loads(json.dumps(hyperparameters(method)))
    assert plain == SHIPPED[method] | {"networks": SHIPPED["networks"]}
    assert hyperparameters(method, asset_path("training.json")) == hyperparameters(method)


@pytest.mark.parametrize(
    ("method", "path", "value", "words"),
    [
        ("bc", ("bc", "imitation", "round"), 3, "bc.imitation has an unknown field 'round'; .*mea"),
        ("bc", ("bc", "imitation", "rounds"), 0, "bc.imitation.rounds is 0"),
        ("bc", ("bc", "imitation", "dagger"), 1, "bc.imitation.dagger is 1; .*true or false"),
        ("bc", ("bc", "imitation", "noise"), 2.0, "bc.imitation.noise is 2"),
        ("bc", ("ppo", "ppo", "gamma"), 2.0, "ppo.ppo.gamma is 2"),
        ("ppo", ("ppo", "ppo", "n_steps"), 2**20 + 1, "n_steps is 1048577"),
        ("ppo", ("ppo", "ppo", "gama"), 0.9, "unknown field 'gama'; .*did you mean 'gamma'"),
        ("ppo", ("ppo", "copies"), "many", "ppo.copies is 'many'"),
        ("ppo", ("ppo", "timesteps"), None, "ppo.timesteps is None"),
        ("ppo", ("networks", "mlp", "net_arch"), [3, "x"], r"networks.mlp.net_arch\[1\] is 'x'"),
        ("ppo", ("networks", "cnn"), {}, "networks has an unknown field 'cnn'"),
        ("ppo", ("ppo",), 3, "ppo is 3; it must be an object"),
        ("ppo", ("ppo",), {}, "neither imitation nor ppo"),
        ("ppo", ("ppo",), {"ppo": {}}, "ppo.copies is missing; .*go together"),
    ],
)
def test_a_faulty_field_is_named(tmp_path, method, path, value, words):
    data = json.loads(json.dumps(SHIPPED))
    place = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    file = tmp_path / "hyper.json"
    file.write_text(json.dumps(data))
    with pytest.raises(SettingError, match=rf"^hyperparameters '.*hyper\.json': .*{words}"):
        hyperparameters(method, file)


def test_what_is_missing_is_named(tmp_path):
    file = tmp_path / "hyper.json"
    file.write_text(json.dumps({"networks": {}}))
    with pytest.raises(SettingError, match="bc is missing"):
        hyperparameters("bc", file)
    file.write_text(json.dumps({"bc": SHIPPED["bc"]}))
    with pytest.raises(SettingError, match="networks is missing"):
        hyperparameters("bc", file)


def test_settings_of_a_caller_are_checked_too(env):
    with pytest.raises(SettingError, match="settings has an unknown field 'imitatoin'"):
        train("bc", env=env, settings={"imitatoin": {}, "networks": {}})
    with pytest.raises(SettingError, match="networks is missing"):
        checked({"imitation": {}})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sizes": {"width": "x"}}, r"sizes\.pointer\.width is 'x'"),
        ({"sizes": {"wide": 3}}, r"sizes\.pointer has an unknown field 'wide'"),
        ({"sizes": 7}, r"sizes\.pointer is 7"),
        ({"network": "cnn"}, "network is 'cnn'; valid choices are 'pointer', 'mlp'"),
        ({"rules": GRAPH_RULES + 1}, "train it anew"),
    ],
)
def test_a_faulty_configuration_of_a_checkpoint_is_named(tmp_path, env, policy, change, words):
    config = {"network": "pointer", "sizes": {"width": 32, "summary": 16}}
    save_policy(tmp_path / "p", policy, config | made_for(env, "pointer"))
    file = tmp_path / "p.json"
    assert load_policy(tmp_path / "p", env).network == "pointer"
    file.write_text(json.dumps(json.loads(file.read_text()) | change))
    with pytest.raises(CheckpointError, match=rf"checkpoint .*{words}"):
        load_policy(tmp_path / "p", env)
