"""Tables: parts of a build, stopped and gone on with, by several at once, on a full disk."""

import json
import logging
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import numpy as np
import pytest
from processes import printed
from small_tables import small_table, stop_at

from mlivr_gym import Box, stance_graph
from mlivr_gym.compiled.cache import CACHE_VARIABLE, kernel_root
from mlivr_gym.errors import SettingError
from mlivr_gym.files import FileError
from mlivr_gym.stances import node_table_build, parts, table_files
from mlivr_gym.stances.parts import Parts
from mlivr_gym.stances.table_build import build_table
from mlivr_gym.stances.table_file import TABLES
from mlivr_gym.stances.table_files import CHECKED

pytestmark = pytest.mark.usefixtures("empty_cache")
KERNELS = kernel_root()


@pytest.fixture(scope="module")
def fewer(small_map):
    some = (small_map.positions[:, 0] < 2.0) & (np.arange(len(small_map)) % 3 > 0)
    return small_map.subset(some, "smaller")


@pytest.fixture(scope="module")
def whole(fewer):
    """The graph with every step checked at once."""
    graph = stance_graph(fewer)
    graph.graph_table = node_table_build.build(graph)
    return graph


@pytest.fixture
def written(monkeypatch):
    """Names of the parts that were written, each after it was worked out."""
    names, write = [], parts.Parts._write

    def noted(self, name, arrays):
        if self.folder is not None:
            names.append(name)
        write(self, name, arrays)

    monkeypatch.setattr(parts.Parts, "_write", noted)
    return names


def assert_same(graph, whole):
    assert graph.is_complete
    for ours, theirs in zip(graph.table, whole.table, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    for name in whole.listed.releases.dtype.names:
        ours, theirs = (one.listed.releases[name] for one in (graph, whole))
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(("limbs", "share"), [(2, 0.8), (3, 0.3)])
def test_a_build_that_was_stopped_goes_on_where_it_was(
    fewer, whole, empty_cache, written, monkeypatch, limbs, share
):
    """Each part is worked out once."""
    monkeypatch.setattr(node_table_build, "STANCES_AT_ONCE", 60)
    monkeypatch.setattr(node_table_build, "PAIRS_AT_ONCE", 200)

    def graph():
        return (
            stance_graph(fewer)
            if limbs == 2
            else stance_graph(small_table(3)[0].grasp_map, "mlivr3")
        )

    with pytest.raises(KeyboardInterrupt):
        build_table(graph(), stop_at(share))
    before = len(written)
    assert before == len(list(empty_cache.glob("parts-*/*.npz"))) > 1
    again = graph()
    path = build_table(again)
    assert path == TABLES.cached(again)
    assert before < len(written) == len(set(written))
    assert path.is_file()
    assert not list(empty_cache.glob("parts-*"))
    if limbs == 2:
        assert_same(again, whole)
        assert_same(graph(), whole)
    else:
        for one, other in zip(again.table, small_table(3)[1], strict=True):
            np.testing.assert_array_equal(one, other)
    every = set(written)
    build_table(graph(), stop_at(0.0))  # nothing is left to do
    assert set(written) == every
    path.unlink()
    written.clear()
    table_files._memory.clear()
    build_table(graph())
    assert set(written) == every


def test_a_part_that_was_cut_off_or_altered_is_worked_out_anew(
    fewer, whole, empty_cache, monkeypatch
):
    """Nothing, something else, or one byte that differs is left of each."""
    monkeypatch.setattr(node_table_build, "PAIRS_AT_ONCE", 300)
    with pytest.raises(KeyboardInterrupt):
        build_table(stance_graph(fewer), stop_at(0.8))
    for k, path in enumerate(sorted(empty_cache.glob("parts-*/joined-*"))):
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 0xFF
        path.write_bytes((b"", b"no archive", content)[k % 3])
    assert k > 5
    graph = stance_graph(fewer)
    build_table(graph)
    assert_same(graph, whole)


BUILD = """
import json, sys
from mlivr_gym import GraspMap, stance_graph
from mlivr_gym.stances.table_build import build_table
graph = stance_graph(GraspMap.from_dict(json.loads(sys.stdin.read())))
assert graph.is_complete is False
print(build_table(graph), graph.is_complete)
"""


def test_two_processes_build_at_once(fewer, whole, empty_cache):
    (empty_cache / "kernels").symlink_to(KERNELS)  # to compile takes minutes
    text = json.dumps(fewer.to_dict())
    with ThreadPoolExecutor(2) as pool:
        told = list(pool.map(lambda _: printed("-c", BUILD, given=text), range(2)))
    graph = stance_graph(fewer)
    assert told == [[f"{TABLES.cached(graph)} True"]] * 2
    assert_same(graph, whole)
    name = TABLES.cached(graph).name
    assert {path.name for path in empty_cache.iterdir()} - {f"{name}{CHECKED}"} == {"kernels", name}


@pytest.mark.parametrize("is_full", [False, True])
def test_a_table_that_cannot_be_written_is_told_and_all_goes_on(
    fewer, whole, monkeypatch, tmp_path, caplog, is_full
):
    """On a full disk, or where the folder cannot be made."""

    def full(path, _):
        raise FileError(f"cannot write {str(path)!r}: No space left on device")

    if is_full:
        for module in ("parts", "table_files"):
            monkeypatch.setattr(f"mlivr_gym.stances.{module}.write_whole", full)
    else:
        (tmp_path / "file").write_text("")
        monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "file" / "cache"))
    graph = stance_graph(fewer)
    with caplog.at_level(logging.WARNING):
        assert build_table(graph) is None
    assert_same(graph, whole)
    lines = [record.getMessage() for record in caplog.records]
    assert any("the table is not stored" in line for line in lines)
    if is_full:
        assert len(lines) == 2  # not one for each part
        assert all(line.endswith("No space left on device") for line in lines)


def test_parts_of_another_source_are_not_used(fewer, empty_cache, monkeypatch, written):
    monkeypatch.setattr(node_table_build, "PAIRS_AT_ONCE", 300)
    with pytest.raises(KeyboardInterrupt):
        build_table(stance_graph(fewer), stop_at(0.8))
    first = set(written)
    monkeypatch.setattr(parts, "source_digest", lambda _: "0" * 16)
    build_table(stance_graph(fewer))
    assert written.count(max(first)) == 2
    assert len(written) == len(first) + len(set(written))


@pytest.mark.parametrize("change", ["obstacles", "occupied"])
def test_no_table_is_built_of_a_world_that_was_changed(ladder, change):
    graph = stance_graph(ladder)
    if change == "obstacles":
        graph.add_obstacles([Box.between("b", "obstacle", (0.1, 0.1, 0.5), (0.2, 0.2, 0.6))])
    else:
        graph.occupy([ladder.ids[0]])
    with pytest.raises(SettingError, match="without obstacles and occupied points; clear them"):
        build_table(graph)


BLOCKS = [(k, 10 * k) for k in range(40)]


def test_threads_that_are_not_wanted_any_more_stop(monkeypatch):
    """All but the first wait until the pool is left."""
    left, shutdown = Event(), ThreadPoolExecutor.shutdown

    def work(number, _):
        done.append(number)
        if number > 0:
            left.wait()
        return []

    def leave(pool, *args, **options):
        left.set()
        shutdown(pool, *args, **options)

    def stop(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(ThreadPoolExecutor, "shutdown", leave)
    done = []
    with pytest.raises(KeyboardInterrupt):
        Parts(None).of_blocks(work, BLOCKS, (), 2, stop)
    assert len(done) <= 3
