"""Tables of nodes: stopped and gone on with, and what is told beforehand."""

from collections import OrderedDict
from functools import wraps

import numpy as np
import pytest
from small_tables import small_map, small_table, stop_at

from mlivr_gym import stance_graph
from mlivr_gym.compiled import kernels
from mlivr_gym.compiled.cache import CACHE_VARIABLE
from mlivr_gym.stances import node_table_build, table_files
from mlivr_gym.stances.node_table_file import NODE_TABLES
from mlivr_gym.stances.table_build import build_table, find_table


@pytest.fixture(autouse=True)
def cache(monkeypatch, tmp_path):
    """A cache folder without tables, and nothing in memory."""
    folder = tmp_path / "cache"
    monkeypatch.setenv(CACHE_VARIABLE, str(folder))
    monkeypatch.setattr(table_files, "_memory", OrderedDict())
    return folder


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(node_table_build, "STANCES_AT_ONCE", 60)
    monkeypatch.setattr(node_table_build, "PAIRS_AT_ONCE", 200)


def assert_same(table, other):
    for one, two in zip(table, other, strict=True):
        np.testing.assert_array_equal(one, two)


def counted(done, name):
    """A function of the module that counts its calls."""
    work = getattr(node_table_build, name)

    @wraps(work)
    def call(*args):
        done[name] += 1
        return work(*args)

    return call


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("share", [0.3, 0.8])
def test_a_build_that_was_stopped_goes_on_where_it_was(monkeypatch, cache, share):
    (_, truth), done = small_table(3), {"nodes_of_sets": 0, "joined": 0}
    for name in done:
        monkeypatch.setattr(node_table_build, name, counted(done, name))
    graph = stance_graph(small_map(), "mlivr3")
    with pytest.raises(KeyboardInterrupt):
        build_table(graph, stop_at(share))
    first = dict(done)
    assert first["nodes_of_sets"] > 1
    parts = len(list(cache.glob("parts-*/*.npz")))
    assert parts == sum(first.values())
    again = stance_graph(small_map(), "mlivr3")
    assert build_table(again) == NODE_TABLES.cached(again)
    assert_same(again.table, truth)
    assert not list(cache.glob("parts-*"))
    together = dict(done)
    table_files._memory.clear()
    NODE_TABLES.cached(again).unlink()
    build_table(stance_graph(small_map(), "mlivr3"))
    assert {name: done[name] - together[name] for name in done} == together  # each part once


def test_threads_go_on_where_one_was_stopped_and_find_what_it_would(monkeypatch, cache):
    monkeypatch.setattr(node_table_build, "STANCES_AT_ONCE", 300)
    monkeypatch.setattr(kernels, "_cores", lambda: 1)
    with pytest.raises(KeyboardInterrupt):
        build_table(stance_graph(small_map(), "mlivr3"), stop_at(1e-9))
    (first,) = cache.glob("parts-*/nodes_of_sets-*.npz")
    monkeypatch.setattr(kernels, "_cores", lambda: 2)
    graph, shares, worked_out = stance_graph(small_map(), "mlivr3"), [], first.stat().st_mtime_ns

    def progress(share):
        shares.append(share)
        assert not first.exists() or first.stat().st_mtime_ns == worked_out

    build_table(graph, progress)
    assert_same(graph.table, small_table(3)[1])
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)


def test_an_unpacked_table_of_another_graph_is_passed_over(caplog):
    graph = stance_graph(small_map(), "mlivr3")
    path, (_, table) = NODE_TABLES.cached(graph), small_table(3)
    other = stance_graph(small_map(), "mlivr4")
    NODE_TABLES.cache(other, table).rename(path)
    assert find_table(graph) is None
    assert "is for another robot; the file is not used" in caplog.text
