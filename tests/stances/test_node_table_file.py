"""Files of node tables: read as written, mapped into memory, and refused where damaged."""

import pickle
from collections import OrderedDict
from functools import partial
from zipfile import ZIP_STORED

import numpy as np
import pytest
from fuzz import damaged, few, loaded
from hypothesis import given
from hypothesis import strategies as st
from small_tables import small_table

from mlivr_gym import Settings, stance_graph
from mlivr_gym.stances import table_files
from mlivr_gym.stances.node_table import ROUNDED
from mlivr_gym.stances.node_table_file import NODE_TABLES
from mlivr_gym.stances.table_build import find_table
from mlivr_gym.stances.table_files import TableError
from mlivr_gym.stances.two_limb_table_file import MOST_BASE_POSES


@pytest.fixture(scope="module", params=[3, 4])
def known(request):
    return small_table(request.param)


@pytest.fixture(scope="module")
def graph(known):
    return known[0]


@pytest.fixture(scope="module")
def table(known):
    return known[1]


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """A cache folder without tables, and none in memory."""
    monkeypatch.setattr(table_files, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(table_files, "_memory", OrderedDict())
    return tmp_path


def test_a_table_is_read_as_it_was_written(graph, table, tmp_path):
    path = tmp_path / "nodes.npz"
    NODE_TABLES.write(graph, table, path)
    again = NODE_TABLES.read(graph, path)
    for name in table._fields:
        mine, other = getattr(table, name), getattr(again, name)
        assert mine.dtype == other.dtype
        np.testing.assert_allclose(mine, other, atol=ROUNDED, rtol=0)
    other = stance_graph(graph.grasp_map, graph.robot, Settings(collisions=False))
    with pytest.raises(TableError, match=r"nodes\.npz' is for other settings \(collisions\)"):
        NODE_TABLES.read(other, path)


def test_a_mapped_table_is_found_again(graph, table, empty_cache, caplog):
    assert find_table(graph) is None
    in_columns = table._replace(points=np.asfortranarray(table.points))
    path = NODE_TABLES.cache(graph, in_columns)
    assert path == NODE_TABLES.cached(graph)
    found = find_table(graph)[1]
    for one, other in zip(found, table, strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype
        assert one.ctypes.data % table_files.ALIGNED == 0
    assert find_table(graph)[1] is found
    found.points[:] = 0  # in memory alone
    table_files._memory.clear()
    np.testing.assert_array_equal(find_table(graph)[1].points, table.points)
    table_files._memory.clear()
    path.write_bytes(path.read_bytes()[:200])
    assert find_table(graph) is None
    assert "is damaged, or not of format" in caplog.text


def test_a_copied_graph_has_the_table_that_is_stored(graph, table, empty_cache):
    """It is found again and not copied, since it may take gigabytes."""
    NODE_TABLES.cache(graph, table)
    find_table(graph)
    sent = pickle.dumps(graph)
    assert len(sent) < table.points.nbytes + 100_000
    table_files._memory.clear()
    np.testing.assert_array_equal(pickle.loads(sent).table.points, table.points)


def test_an_unpacked_table_of_another_graph_is_passed_over(graph, table, empty_cache, caplog):
    other = stance_graph(graph.grasp_map, f"mlivr{7 - graph.limbs}")
    NODE_TABLES.cache(other, table).rename(NODE_TABLES.cached(graph))
    assert find_table(graph) is None
    assert "is for another robot; the file is not used" in caplog.text


def test_a_mapped_array_of_another_shape_is_refused(graph, table, empty_cache):
    path = NODE_TABLES.cache(graph, table)
    for name in table._fields[:-1]:  # the last may have any length
        shorter = table._replace(**{name: getattr(table, name)[:-1]})
        path.write_bytes(NODE_TABLES.pack(graph, shorter._asdict(), ZIP_STORED))
        with pytest.raises(TableError, match="is damaged"):
            NODE_TABLES.read(graph, path)


def test_a_compressed_file_is_unpacked_once(graph, table, empty_cache, caplog):
    compressed, mapped = empty_cache / NODE_TABLES.name(graph), NODE_TABLES.cached(graph)
    NODE_TABLES.write(graph, table, compressed)
    np.testing.assert_array_equal(find_table(graph)[1].joined, table.joined)
    assert mapped.is_file()
    table_files._memory.clear()
    mapped.unlink()
    compressed.write_bytes(b"")
    assert find_table(graph) is None
    assert "is damaged, or not of format" in caplog.text


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
def test_numbers_that_are_not_possible_are_refused(graph, table, tmp_path, name, change):
    path = tmp_path / "nodes.npz"
    NODE_TABLES.write(graph, table, path)
    arrays = dict(NODE_TABLES.arrays(graph, path))
    path.write_bytes(NODE_TABLES.pack(graph, arrays | {name: change(arrays[name])}, ZIP_STORED))
    with pytest.raises(TableError, match="is damaged"):
        NODE_TABLES.read(graph, path)


@few(0.1)
@given(data=st.data())
def test_a_damaged_file_is_refused_or_still_the_same(data, graph, table, tmp_path):
    """The checksums notice what was altered; bytes between arrays do not matter."""
    path = tmp_path / "nodes.npz"
    NODE_TABLES.write(graph, table, path)
    again = loaded(partial(NODE_TABLES.read, graph), path, data.draw(damaged(path.read_bytes())))
    for one, other in zip(again or (), table if again else (), strict=True):
        np.testing.assert_allclose(one, other, atol=ROUNDED, rtol=0)
