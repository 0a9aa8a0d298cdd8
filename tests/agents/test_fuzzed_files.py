"""Whatever is done to files of training and test set, they are refused in one line or used."""

import json

import pytest
from fuzz import damaged, few, loaded, mutated
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym.agents.hyperparameters import METHODS, load_hyperparameters
from mlivr_gym.agents.learned import load_policy, made_for, save_policy
from mlivr_gym.agents.test_set import load_test_set
from mlivr_gym.envs_assets import asset_path

HYPERPARAMETERS = json.loads(asset_path("training.json").read_text())
TASKS = json.loads(asset_path("test_set.json").read_text())
TASKS["worlds"] = [world | {"tasks": world["tasks"][:2]} for world in TASKS["worlds"][:3]]


@given(st.data())
@few(0.06)
def test_mutated_hyperparameters_are_one_error_at_most(tmp_path, data):
    content = json.dumps(data.draw(mutated(HYPERPARAMETERS))).encode()
    method = data.draw(st.sampled_from(METHODS))
    loaded(lambda path: load_hyperparameters(method, path), tmp_path / "hyper.json", content)


@given(st.data())
@few(0.04)
def test_a_mutated_test_set_is_one_error_at_most(tmp_path, data):
    content = json.dumps(data.draw(mutated(TASKS))).encode()
    loaded(load_test_set, tmp_path / "tasks.json", content)


@pytest.fixture
def checkpoint(tmp_path, env, policy):
    config = {"network": "pointer", "sizes": {"width": 32, "summary": 16}, "seed": 3}
    save_policy(tmp_path / "p", policy, config | made_for(env, "pointer"))
    return tmp_path / "p"


@given(st.data())
@few(0.03)
def test_a_mutated_checkpoint_is_one_error_at_most(checkpoint, env, data):
    content = json.dumps(data.draw(mutated(CONFIGURATION))).encode()
    loaded(lambda path: load_policy(checkpoint, env), checkpoint.with_suffix(".json"), content)


CONFIGURATION = json.loads(asset_path("pointer.json").read_text()) | {
    "sizes": {"width": 32, "summary": 16}
}


@given(st.data())
@few(0.03)
def test_damaged_weights_are_one_error_at_most(checkpoint, env, data):
    weights = checkpoint.with_suffix(".pt")
    whole = weights.read_bytes()
    try:
        loaded(lambda path: load_policy(checkpoint, env), weights, data.draw(damaged(whole)))
    finally:
        weights.write_bytes(whole)
