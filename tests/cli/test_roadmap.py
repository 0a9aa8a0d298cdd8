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
    code, out, _ = run(f"roadmap --robot mlivr3 --map {part} --expansions 20")
    assert code == 0
    assert "stances" in out
    graph = stance_graph(part, "mlivr3")
    found = Roadmap.of(graph)
    assert found is not None
    assert found.key == key_of(graph)
    assert f"{len(found)} stances, {len(found.pairs.rows)} steps" in out


def test_a_roadmap_is_written_where_it_is_wanted(run, part, tmp_path):
    path = tmp_path / "roadmap.npz"
    assert run(f"roadmap --robot mlivr3 --map {part} --expansions 5 --out {path}")[0] == 0
    assert len(Roadmap.read(path))
