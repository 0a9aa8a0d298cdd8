"""A faulty field of a file of hyperparameters is named before anything is trained."""

import json

import pytest

from mlivr_gym.agents.hyperparameters import (
    METHODS,
    check_hyperparameters,
    fill_dagger,
    load_hyperparameters,
)
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import SettingError

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
