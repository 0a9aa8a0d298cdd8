"""Minari data sets: what is refused, and that it is refused before any episode is collected."""

import importlib.util
import json
import sys

import numpy as np
import pytest

from mlivr_gym.agents import dataset
from mlivr_gym.agents.dataset import load_dataset, write_dataset
from mlivr_gym.errors import SettingError
from mlivr_gym.planners import Planner
from mlivr_gym.settings import GRAPH_RULES

minari = pytest.importorskip("minari", reason="needs the extra [data]")
pytest.importorskip("jax", reason="needs the extra [data]")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "sets"))
    return tmp_path / "sets"


@pytest.fixture
def arguments(ladder):
    return {"map": ladder, "collisions": False}


@pytest.fixture
def nothing_collected(monkeypatch):
    made = "an environment was made"
    monkeypatch.setattr(dataset.gymnasium, "make", lambda *_, **__: pytest.fail(made))


@pytest.mark.parametrize(
    "name", ["foo", "foo-v1.2", "mlivr jem-v0", "../foo-v0", "foo-v0\n", None, "n" * 300 + "-v0"]
)
def test_ids_that_minari_would_refuse_in_the_end_are_refused_first(folder, nothing_collected, name):
    with pytest.raises(SettingError, match="data set") as caught:
        write_dataset(name, 2)
    assert "'mlivr/jem/expert-v0'" in str(caught.value) or "too long" in str(caught.value)
    assert not folder.exists() or not any(folder.iterdir())


def test_an_id_that_is_taken_is_refused_first(folder, arguments, monkeypatch):
    write_dataset("foo-v0", 1, env_arguments=arguments)
    (folder / "half" / "bar-v0").mkdir(parents=True)  # no data set, but in its place
    (folder / "file").write_text("")
    monkeypatch.setattr(
        dataset.ExpertPolicy, "act", lambda *_: pytest.fail("an episode was collected")
    )
    for name, words in (
        ("foo-v0", "already"),
        ("half/bar-v0", "already"),
        ("file/foo-v0", "cannot be written"),
    ):
        with pytest.raises(SettingError, match=words):
            write_dataset(name, 1, env_arguments=arguments)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder / "file"))
    with pytest.raises(SettingError, match="cannot be written"):
        write_dataset("foo-v1", 1, env_arguments=arguments)


@pytest.mark.parametrize("package", ["minari", "h5py", "jax"])
def test_a_missing_extra_is_one_clear_error_before_collecting(
    folder, nothing_collected, monkeypatch, package
):
    find, told = importlib.util.find_spec, rf"the package '{package}': pip install '.*\[data\]'"

    def lacking(name, *rest):
        return None if name == package else find(name, *rest)

    monkeypatch.setattr(importlib.util, "find_spec", lacking)
    monkeypatch.setitem(sys.modules, package, None)
    for call in (lambda: write_dataset("foo-v0", 1), lambda: load_dataset("foo-v0")):
        with pytest.raises(SettingError, match=told):
            call()


def test_a_data_set_of_other_rules_is_refused(folder, arguments):
    write_dataset("foo-v0", 1, env_arguments=arguments)
    file = folder / "foo-v0" / "data" / "metadata.json"
    data = json.loads(file.read_text())
    assert data.pop("graph_rules") == GRAPH_RULES
    for number, said in ((None, "1"), (GRAPH_RULES + 1, str(GRAPH_RULES + 1))):
        file.write_text(json.dumps(data | ({} if number is None else {"graph_rules": number})))
        with pytest.raises(SettingError) as caught:
            load_dataset("foo-v0")
        assert str(caught.value) == (
            f"data set 'foo-v0' was made by rules {said} of the stance graph, and this version has "
            f"rules {GRAPH_RULES}: write it again with write_dataset"
        )
    with pytest.raises(SettingError, match="cannot load data set 'bar-v0'"):
        load_dataset("bar-v0")


def test_data_set_holds_optimal_masked_walks_and_rebuilds_its_environment(folder, arguments):
    """With a map object, which goes into the data set as plain data."""
    name = "a-b/c_d/test-v12"
    assert write_dataset(name, 2, seed=3, env_arguments=arguments).id == name
    dataset = minari.load_dataset(name)
    assert dataset.total_episodes == 2
    rebuilt = dataset.recover_environment()
    assert rebuilt.unwrapped.graph.grasp_map.fingerprint == arguments["map"].fingerprint
    planner = Planner(rebuilt.unwrapped.graph)
    for episode in dataset.iterate_episodes():
        observation, info = rebuilt.reset(seed=3 + int(episode.id))
        plan = planner.plan(info["stance"], rebuilt.unwrapped.goal, "steps").unwrap()
        assert len(episode.actions) == len(plan.steps) == -episode.rewards.sum()
        assert episode.terminations[-1]
        for k, action in enumerate(episode.actions):
            for name, rows in episode.observations.items():
                np.testing.assert_array_equal(rows[k], observation[name])
            assert episode.observations["action_mask"][k][action]
            observation, *_ = rebuilt.step(action)
