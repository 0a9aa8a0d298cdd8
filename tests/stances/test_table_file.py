"""Files of node tables: read as written, mapped into memory, and refused where damaged."""

import pickle
from collections import OrderedDict
from zipfile import ZIP_STORED

import numpy as np
import pytest
from numba import typeof
from small_tables import small_table

from mlivr_gym import Settings, stance_graph
from mlivr_gym.stances import table_files
from mlivr_gym.stances.graph_table import GraphTable
from mlivr_gym.stances.node_table import ROUNDED
from mlivr_gym.stances.table_build import find_table
from mlivr_gym.stances.table_file import MOST_BASE_POSES, TABLES
from mlivr_gym.stances.table_files import TableError


@pytest.fixture(scope="module", params=[3])
def known(request):
    return small_table(request.param)


@pytest.fixture(scope="module")
def graph(known):
    return known[0]


@pytest.fixture(scope="module")
def table(known):
    return known[1]


def of(table):
    """The table of a graph of three or four limbs with these nodes."""
    return GraphTable(table, False)


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """A cache folder without tables, and none in memory."""
    monkeypatch.setattr(table_files, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(table_files, "_memory", OrderedDict())
    return tmp_path


def test_a_table_is_read_as_it_was_written(graph, table, tmp_path):
    path = tmp_path / "nodes.npz"
    TABLES.write(graph, of(table), path)
    again = TABLES.read(graph, path).nodes
    for name in table._fields:
        mine, other = getattr(table, name), getattr(again, name)
        assert mine.dtype == other.dtype
        np.testing.assert_allclose(mine, other, atol=ROUNDED, rtol=0)
    other = stance_graph(graph.grasp_map, graph.robot, Settings(collisions=False))
    with pytest.raises(TableError, match=r"nodes\.npz' is for other settings \(collisions\)"):
        TABLES.read(other, path)


def test_a_mapped_table_is_found_again(graph, table, empty_cache, caplog):
    assert find_table(graph) is None
    in_columns = table._replace(points=np.asfortranarray(table.points))
    path = TABLES.cache(graph, of(in_columns))
    assert path == TABLES.cached(graph)
    known = find_table(graph)[1]
    found = known.nodes
    for one, other in zip(found, table, strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype
        assert one.ctypes.data % table_files.ALIGNED == 0
    assert find_table(graph)[1] is known
    found.points[:] = 0  # in memory alone
    table_files._memory.clear()
    np.testing.assert_array_equal(find_table(graph)[1].nodes.points, table.points)
    table_files._memory.clear()
    path.write_bytes(path.read_bytes()[:200])
    assert find_table(graph) is None
    assert "is damaged, or not of format" in caplog.text


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


def test_a_copied_graph_has_the_table_that_is_stored(graph, table, empty_cache):
    """It is found again and not copied, since it may take gigabytes."""
    TABLES.cache(graph, of(table))
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
def test_numbers_that_are_not_possible_are_refused(graph, table, tmp_path, name, change):
    path = tmp_path / "nodes.npz"
    TABLES.write(graph, of(table), path)
    arrays = dict(TABLES.arrays(graph, path))
    path.write_bytes(TABLES.pack(graph, arrays | {name: change(arrays[name])}, ZIP_STORED))
    with pytest.raises(TableError, match="is damaged"):
        TABLES.read(graph, path)
