"""Files of tables: read as written, mapped into memory, and refused or built anew where damaged."""

import os
import pickle
import re
from collections import OrderedDict
from zipfile import ZIP_STORED

import numpy as np
import pytest
from fuzz import damaged, few
from hypothesis import given
from hypothesis import strategies as st
from numba import typeof
from small_tables import small_table

from mlivr_gym import Settings, stance_graph
from mlivr_gym.postures.postures import FIELDS
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.stances import build, table_files
from mlivr_gym.stances.graph_table import GraphTable
from mlivr_gym.stances.node_table import ROUNDED
from mlivr_gym.stances.table_build import find_table
from mlivr_gym.stances.table_file import MOST_BASE_POSES, TABLES
from mlivr_gym.stances.table_files import CHECKED, TableError
from mlivr_gym.world.boxes import Box


@pytest.fixture(scope="module")
def known():
    return small_table(3)


def found(graph):
    """The table that a new process finds."""
    table_files._memory.clear()
    answer = find_table(graph)
    return answer and answer[1].nodes


def unpacked(known):
    """A table in the cache folder that was checked, and in compressed form."""
    graph, table = known
    TABLES.write(
        graph, GraphTable(table, False), TABLES.cached(graph).with_name(TABLES.name(graph))
    )
    path = TABLES.cache(graph, GraphTable(table, False))
    assert all(np.array_equal(*pair) for pair in zip(found(graph), table, strict=True))
    return path


def altered(path, content):
    """Replace the content of a file in place, some time later."""
    state = path.stat()
    path.write_bytes(content)
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns + 1))


def is_refused(graph, path):
    try:
        TABLES.read(graph, path)
    except TableError:
        return True
    return False


def test_a_table_is_read_as_it_was_written(known, tmp_path):
    (graph, table), path = known, tmp_path / "nodes.npz"
    TABLES.write(graph, GraphTable(table, False), path)
    again = TABLES.read(graph, path).nodes
    for name in table._fields:
        mine, other = getattr(table, name), getattr(again, name)
        assert mine.dtype == other.dtype
        np.testing.assert_allclose(mine, other, atol=ROUNDED, rtol=0)
    other = stance_graph(graph.grasp_map, graph.robot, Settings(collisions=False))
    with pytest.raises(TableError, match=r"nodes\.npz' is for other settings \(collisions\)"):
        TABLES.read(other, path)


def test_a_mapped_table_is_found_again(known, empty_cache, caplog):
    graph, table = known
    assert find_table(graph) is None
    in_columns = table._replace(points=np.asfortranarray(table.points))
    path = TABLES.cache(graph, GraphTable(in_columns, False))
    assert path == TABLES.cached(graph)
    read = find_table(graph)[1]
    for one, other in zip(read.nodes, table, strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype
        assert one.ctypes.data % table_files.ALIGNED == 0
    assert find_table(graph)[1] is read
    read.nodes.points[:] = 0  # in memory alone
    table_files._memory.clear()
    np.testing.assert_array_equal(find_table(graph)[1].nodes.points, table.points)
    table_files._memory.clear()
    path.write_bytes(path.read_bytes()[:200])
    assert find_table(graph) is None
    assert "is damaged, or not of format" in caplog.text
    graph.graph_table = GraphTable(table, False)  # not what is mapped to the rest of the file


@pytest.mark.parametrize("limbs", [2, 3])
def test_the_same_machine_code_serves_a_table_however_it_was_read(limbs, empty_cache, tmp_path):
    """Otherwise the second command would compile anew what the first one did."""
    graph, path = small_table(limbs)[0], tmp_path / "nodes.npz"
    built = graph.graph_table
    TABLES.write(graph, built, path)

    def kinds(table):
        listed = table.listed
        more = () if listed is None else (*vars(listed.postures).values(), listed.releases)
        return [typeof(one) for one in (*table.nodes, *more)]

    for one in (path, TABLES.cache(graph, built)):
        assert kinds(TABLES.read(graph, one)) == kinds(built)


def test_a_copied_graph_has_the_table_that_is_stored(known, empty_cache):
    """It is found again and not copied, since it may take gigabytes."""
    graph, table = known
    TABLES.cache(graph, GraphTable(table, False))
    find_table(graph)
    sent = pickle.dumps(graph)
    assert len(sent) < table.points.nbytes + 100_000
    table_files._memory.clear()
    np.testing.assert_array_equal(pickle.loads(sent).table.points, table.points)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("point_increments", lambda a: a + np.int16(100)), ("point_increments", lambda a: a[:-1]),
        ("point_increments", lambda a: -a), ("base_offset_index", lambda a: a + np.uint32(1 << 20)),
        ("mask_index", lambda a: a[:-1]), ("tried", lambda a: np.full_like(a, MOST_BASE_POSES)),
        ("tried", lambda a: a[:-1]), ("pair_counts", lambda a: a + 1),
        ("pair_counts", lambda a: a - [1, 0]), ("pair_counts", lambda a: a - [0, 1]),
        ("joined", np.zeros_like), ("joined", lambda a: ~a), ("loses_branches", lambda a: ~a),
        ("lost_index", lambda a: a[:-1]), ("lost", lambda a: a[:0]),
    ],
)  # fmt: skip
def test_numbers_that_are_not_possible_are_refused(known, tmp_path, name, change):
    (graph, table), path = known, tmp_path / "nodes.npz"
    TABLES.write(graph, GraphTable(table, False), path)
    arrays = dict(TABLES.arrays(graph, path))
    path.write_bytes(TABLES.pack(graph, arrays | {name: change(arrays[name])}, ZIP_STORED))
    with pytest.raises(TableError, match="is damaged"):
        TABLES.read(graph, path)


def test_a_number_just_outside_its_range_is_refused(tmp_path):
    """Compiled code uses these numbers as indices, and checksums are those of what was written."""
    graph, _ = small_table(2)
    path, arrays = tmp_path / "table.npz", TABLES.encode(graph, graph.graph_table)
    outside = {
        "tried": (-1, 1 << 12), "branch": (-1, 8), "mask_index": (len(arrays["mask"]),),
        "manipulability_index": (-1, len(arrays["manipulability"])),
        "lost_index": (len(arrays["lost"]),),
    }  # fmt: skip
    path.write_bytes(TABLES.pack(graph, arrays, 0))
    assert not is_refused(graph, path)
    for name, values in outside.items():
        for value in values:
            changed = arrays[name].astype(np.int64)
            changed.flat[changed.argmax()] = value
            path.write_bytes(TABLES.pack(graph, arrays | {name: changed}, 0))
            assert is_refused(graph, path), (name, value)


def is_close(table, other):
    """Whether two tables are equal, base positions up to the resolution of a compressed file."""
    return all(np.allclose(*pair, rtol=0, atol=1e-4) for pair in zip(table, other, strict=True))


@st.composite
def with_a_flipped_bit(draw, content):
    """The bytes but for one bit, in an array, a header, or head and directory of the archive."""
    heads = [one.start() for one in re.finditer(b"\x93NUMPY", content)]
    near = st.sampled_from(heads).flatmap(lambda i: st.integers(i - 60, i + 160))
    place = draw(st.one_of(st.integers(0, len(content) - 1), near))
    place, out = min(max(place, 0), len(content) - 1), bytearray(content)
    out[place] ^= 1 << draw(st.integers(0, 7))
    return bytes(out)


@pytest.mark.parametrize("change", [with_a_flipped_bit, damaged])
@few(0.07)
@given(data=st.data())
def test_an_altered_file_changes_no_answer(change, data, known, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLIVR_GYM_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(table_files, "_memory", OrderedDict())
        path, (graph, table) = unpacked(known), known
        altered(path, data.draw(change(path.read_bytes())))
        # What was noticed once is not taken for checked.
        assert is_refused(graph, path) == is_refused(graph, path)
        assert is_close(found(graph), table)


def test_a_mapped_table_is_checked_once_and_again_when_its_time_differs(
    known, empty_cache, monkeypatch
):
    counted = []
    whole = table_files.zipfile.ZipFile.testzip
    monkeypatch.setattr(
        table_files.zipfile.ZipFile, "testzip", lambda one: counted.append(1) or whole(one)
    )
    path, (graph, _) = unpacked(known), known
    assert len(counted) == 1
    for _ in range(2):
        found(graph)
    assert len(counted) == 1
    os.utime(path)
    found(graph)
    found(graph)
    assert len(counted) == 2
    path.with_name(path.name + CHECKED).unlink()
    found(graph)
    assert len(counted) == 3


@pytest.fixture
def solved(monkeypatch, empty_cache):
    """The numbers of stances that were computed, in a cache folder that is empty at first."""
    counted, solve = [], PostureSolver.solve

    def counting(self, stances, **options):
        counted.append(len(stances))
        return solve(self, stances, **options)

    monkeypatch.setattr(PostureSolver, "solve", counting)
    return counted


def same(first, second):
    assert np.array_equal(first.points, second.points)
    assert first.listed.counts == second.listed.counts
    for name in FIELDS:
        one, other = (getattr(graph.listed.postures, name) for graph in (first, second))
        assert typeof(one) == typeof(other)  # so that the same machine code serves both
        assert np.array_equal(one, other), name
    assert typeof(first.table) == typeof(second.table)


def test_a_second_graph_reads_what_the_first_one_computed(solved):
    first = stance_graph(robot="mlivr2-ur3e")
    assert solved == [len(first.pairs)]
    second = stance_graph(robot="mlivr2-ur3e")
    assert len(solved) == 1
    same(first, second)
    points = tuple(first.points[100])
    steps, expected = (graph.successors(graph.state(points)) for graph in (second, first))
    assert steps
    for field in ("limb", "point", "base_position", "branch_sets"):
        assert np.array_equal(getattr(steps, field), getattr(expected, field))
    second.add_obstacles([Box.between("bag", "obstacle", (3.0, -0.3, -0.3), (3.4, 0.3, 0.3))])
    same(first, stance_graph(robot="mlivr2-ur3e"))


def test_small_maps_leave_no_files(empty_cache, small_map):
    stance_graph(small_map)
    assert len(stance_graph(small_map).pairs) < build.LEAST_STORED
    assert not list(empty_cache.glob("parts-*"))
