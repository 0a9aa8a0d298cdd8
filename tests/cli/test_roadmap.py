"""The command `roadmap`."""

import json

import pytest

from mlivr_gym import stance_graph
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.planners.roadmap import Roadmap, key_of


@pytest.fixture
def part(tmp_path):
    """A map file of part of the JEM."""
    data = json.loads(asset_path("jem.json").read_text(encoding="utf-8"))
    data["segments"] = [one for one in data["segments"] if one["end"][0] < 2.8]
    path = tmp_path / "part.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    return str(path)


def test_a_roadmap_is_built_and_then_found_by_planners(run, part, tmp_path, monkeypatch):
    monkeypatch.setattr("mlivr_gym.cli.roadmap.cache_folder", lambda: tmp_path / "new")
    monkeypatch.setattr("mlivr_gym.planners.roadmap.cache_folder", lambda: tmp_path / "new")
    code, out, _ = run("roadmap", "--robot", "mlivr3", "--map", part, "--expansions", "20")
    assert code == 0
    assert "stances" in out
    graph = stance_graph(part, "mlivr3")
    found = Roadmap.of(graph)
    assert found is not None
    assert found.key == key_of(graph)
    assert f"{len(found)} stances, {len(found.pairs.rows)} steps" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--robot", "mlivr2"], "two limbs"),
        (["--robot", "mlivr3", "--expansions", "0"], "--expansions is 0; it must be between 1"),
        (["--robot", "mlivr3", "--stances", "-1"], "--stances is -1; it must be between 1"),
        (["--robot", "mlivr3", "--no-transitions"], "steps are not checked"),
    ],
)
def test_what_needs_no_roadmap_is_refused(run, part, arguments, words):
    code, _, err = run("roadmap", "--map", part, *arguments)
    assert code == 2
    assert words in err


def test_without_a_cache_folder_a_file_must_be_named(run, part, monkeypatch):
    monkeypatch.setenv("MLIVR_GYM_CACHE", "")
    code, _, err = run("roadmap", "--robot", "mlivr3", "--map", part)
    assert code == 2
    assert "--out" in err


def test_what_cannot_be_written_is_refused_before_anything_is_built(
    run, part, tmp_path, monkeypatch
):
    def begin(*_):
        raise AssertionError

    monkeypatch.setattr("mlivr_gym.cli.roadmap.build", begin)
    for out in (tmp_path, tmp_path / "no" / "roadmap.npz"):
        code, _, err = run("roadmap", "--robot", "mlivr3", "--map", part, "--out", str(out))
        assert code == 2
        assert err.startswith("mlivr-gym: cannot write ")


def test_a_roadmap_is_written_where_it_is_wanted(run, part, tmp_path):
    path = tmp_path / "roadmap.npz"
    code, *_ = run(
        "roadmap", "--robot", "mlivr3", "--map", part, "--expansions", "5", "--out", str(path)
    )
    assert code == 0
    assert len(Roadmap.read(path))
