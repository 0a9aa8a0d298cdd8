"""The commands `build` and `cache`: what is kept, listed and removed."""

import json
import os
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


FILES = {
    f"pairs-{'a' * 20}.npz": (3_000, 400),
    f"nodes-{'b' * 20}-unpacked.npz": (49_000, 100),
    f"nodes-{'b' * 20}.npz": (900, 500),
    f"nodes-{'e' * 20}-5.npy": (1_000, 80),
    f"nodes-{'e' * 20}.xz": (100, 550),
    f"sets-{'c' * 20}-{'d' * 16}.npz": (2_000, 300),
    f".pairs-{'a' * 20}.npz.x_1y2z3w": (700, 50),
    f"parts-{'f' * 20}-{'0' * 16}/rows-0-0.npz": (600, 450),
    f"kernels/{'9' * 16}/compiled/one.nbc": (10_000, 350),
    f"kernels/{'8' * 16}/compiled/two.nbc": (20_000, 60),
}
"""Size, and when it was used last, of what is kept."""

OTHERS = (
    "notes.txt",
    "pairs.npz",
    "kernels/readme",
    "photos/one.npz",
    "pairs-a.npz.old",
    "nodes-backup/x",
)
"""Files of the user in the same folder."""


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """A folder with all kinds of what is kept, and other files."""
    for k, (name, (size, when)) in enumerate({**FILES, **dict.fromkeys(OTHERS, (9, 1))}.items()):
        path = tmp_path / "cache" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes(size))
        # To be read is a use, and so is to be written, where reading is not recorded.
        os.utime(path, (when, 1) if k % 2 else (1, when))
    monkeypatch.setenv("MLIVR_GYM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def left(folder):
    """Files that are there, those of the user aside, which must be."""
    found = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert found >= set(OTHERS)
    return found - set(OTHERS)


def test_what_is_kept_is_listed(run, folder):
    code, out, _ = run("cache")
    assert code == 0
    *lines, total = out.splitlines()
    assert len(lines) == len(FILES) - 1  # machine code in one line
    assert total == f"87.3 kB in {folder}"
    assert any("49 kB" in line and "nodes-bbb" in line and "1970-01-01" in line for line in lines)
    assert "30 kB" in lines[-1]
    assert lines[-1].endswith("kernels  machine code")
    told = json.loads(run("cache", "--json")[1])
    assert told["bytes"] == sum(size for size, _ in FILES.values())
    assert {one["used"] for one in told["tables"]} == {400, 100, 80, 500, 550, 300, 50, 450}
    assert left(folder) == set(FILES)


def test_all_of_it_is_removed_and_nothing_else(run, folder):
    code, out, _ = run("cache", "--clear")
    assert code == 0
    assert out.splitlines() == [f"removed: {len(FILES)} files, 87.3 kB", f"0 B in {folder}"]
    assert not left(folder)


@pytest.mark.parametrize(("limit", "most"), [("91.2kB", 91_200), ("20 KB", 20_000), ("0", 0)])
def test_what_was_not_used_for_longest_is_removed_until_it_fits(run, folder, limit, most):
    code, _, err = run("cache", "--limit", "5e-9 GB")
    assert code == 2
    assert "it must be a size such as 500MB or 2GB" in err
    code, _, _ = run("cache", "--limit", limit)
    by_use, stay, size = sorted(FILES.items(), key=lambda one: -one[1][1]), set(), 0
    for name, (more, _) in by_use:  # truth: the newest that fit together
        size += more
        if size > most:
            break
        stay.add(name)
    assert code == 0
    assert left(folder) == stay
