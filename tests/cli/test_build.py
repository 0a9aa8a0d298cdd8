"""The command `nodes`."""

import json

import pytest
from small_tables import small_map

from mlivr_gym import stance_graph
from mlivr_gym.stances import node_files
from mlivr_gym.stances.node_files import node_table, read_table


@pytest.fixture
def part(tmp_path):
    """A map file of a few points."""
    path = tmp_path / "few.json"
    path.write_text(json.dumps(small_map().to_dict()), encoding="utf-8")
    return str(path)


def test_nodes_are_worked_out_and_then_found_by_planners(run, part, tmp_path, monkeypatch):
    monkeypatch.setattr("mlivr_gym.cli.nodes.cache_folder", lambda: tmp_path / "new")
    monkeypatch.setattr(node_files, "cache_folder", lambda: tmp_path / "new")
    code, out, _ = run("nodes", "--robot", "mlivr3", "--map", part)
    assert code == 0
    found = node_table(stance_graph(part, "mlivr3"))
    assert f"{len(found.points)} nodes" in out


def test_a_small_file_is_written_where_it_is_wanted(run, part, tmp_path):
    path = tmp_path / "nodes.xz"
    code, *_ = run("nodes", "--robot", "mlivr3", "--map", part, "--out", str(path))
    assert code == 0
    graph = stance_graph(part, "mlivr3")
    assert len(read_table(path, graph).points)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--robot", "mlivr2"], "two limbs"),
        (["--robot", "mlivr3", "--no-transitions"], "where steps are checked"),
    ],
)
def test_what_needs_no_nodes_is_refused(run, part, arguments, words):
    code, _, err = run("nodes", "--map", part, *arguments)
    assert code == 2
    assert words in err


def test_without_a_cache_folder_a_file_must_be_named(run, part, monkeypatch):
    monkeypatch.setenv("MLIVR_GYM_CACHE", "")
    code, _, err = run("nodes", "--robot", "mlivr3", "--map", part)
    assert code == 2
    assert "--out" in err


def test_what_cannot_be_written_is_refused_before_anything_is_built(
    run, part, tmp_path, monkeypatch
):
    def begin(*_):
        raise AssertionError

    monkeypatch.setattr("mlivr_gym.cli.nodes.build", begin)
    for out in (tmp_path, tmp_path / "no" / "nodes.xz"):
        code, _, err = run("nodes", "--robot", "mlivr3", "--map", part, "--out", str(out))
        assert code == 2
        assert err.startswith("mlivr-gym: cannot write ")
