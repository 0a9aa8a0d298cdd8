"""The command `build`: what is kept, and found by planners."""

import json
from collections import OrderedDict

import numpy as np
import pytest
from small_tables import small_map as few_points

from mlivr_gym import stance_graph
from mlivr_gym.stances import table_files
from mlivr_gym.stances.table_build import find_table
from mlivr_gym.stances.table_file import TABLES


@pytest.fixture
def part(tmp_path):
    """A map file of a few points."""
    path = tmp_path / "few.json"
    path.write_text(json.dumps(few_points().to_dict()), encoding="utf-8")
    return str(path)


@pytest.fixture(autouse=True)
def cache(monkeypatch, tmp_path):
    """An empty cache folder, and no table in memory."""
    monkeypatch.setenv("MLIVR_GYM_CACHE", str(tmp_path / "new"))
    monkeypatch.setattr(table_files, "_memory", OrderedDict())


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3"])
def test_what_is_worked_out_is_found_by_planners(run, part, robot):
    """With two limbs all steps."""
    code, out, _ = run("build", "--robot", robot, "--map", part)
    graph = stance_graph(part, robot)
    assert (code, out) == (0, f"stored: {TABLES.cached(graph)}\n")
    assert graph.is_complete == (robot == "mlivr2")
    table_files._memory.clear()
    assert len(find_table(graph)[1].nodes.points) > 10
    code, out, _ = run("build", "--robot", robot, "--map", part, "--json")
    told = json.loads(out)
    assert (code, told["file"], told["kept"]) == (0, *[str(TABLES.cached(graph))] * 2)


def test_a_file_of_two_limbs_is_found_under_the_name_that_is_told(run, part, tmp_path, monkeypatch):
    path = tmp_path / "mine.npz"
    monkeypatch.setenv("MLIVR_GYM_CACHE", "")
    code, out, _ = run("build", "--map", part, "--out", str(path))
    table_files._memory.clear()
    graph = stance_graph(part)
    assert code == 0
    assert not graph.is_complete
    assert f"table: {path} (name it {TABLES.name(graph)} in a cache folder)" in out
    assert np.array_equal(TABLES.read(graph, path).nodes.points, graph.points)
    monkeypatch.setenv("MLIVR_GYM_CACHE", str(tmp_path / "other"))
    (tmp_path / "other").mkdir()
    path.rename(tmp_path / "other" / TABLES.name(graph))
    assert stance_graph(part).is_complete


def test_a_table_that_is_not_kept_in_the_end_is_no_success(run, part, monkeypatch, caplog):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(table_files, "write_whole", full)
    code, out, _ = run("build", "--map", part)
    assert code == 1
    assert "stored: " not in out
    assert "the table is not stored: [Errno 28] No space left" in caplog.text
