"""Tables whose files were altered after they were written: used as before, or built anew."""

import os
import re
from collections import OrderedDict

import numpy as np
import pytest
from fuzz import damaged, few
from hypothesis import given
from hypothesis import strategies as st
from small_tables import small_table

from mlivr_gym.stances import table_files
from mlivr_gym.stances.graph_table import GraphTable
from mlivr_gym.stances.table_build import find_table
from mlivr_gym.stances.table_file import TABLES
from mlivr_gym.stances.table_files import CHECKED, TableError


@pytest.fixture(scope="module")
def known():
    return small_table(3)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache folder, and no table in memory."""
    monkeypatch.setenv("MLIVR_GYM_CACHE", str(tmp_path))
    monkeypatch.setattr(table_files, "_memory", OrderedDict())
    return tmp_path


def found(graph):
    """The table that a new process finds."""
    table_files._memory.clear()
    answer = find_table(graph)
    return answer and answer[1].nodes


def is_equal(table, other):
    return all(np.array_equal(*pair) for pair in zip(table, other, strict=True))


def unpacked(known):
    """A table in the cache folder that was checked, and in compressed form."""
    graph, table = known
    TABLES.write(
        graph, GraphTable(table, False), TABLES.cached(graph).with_name(TABLES.name(graph))
    )
    path = TABLES.cache(graph, GraphTable(table, False))
    assert is_equal(found(graph), table)
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


def is_close(table, other):
    """Whether two tables are equal, base positions up to the resolution of a compressed file."""
    return all(np.allclose(*pair, rtol=0, atol=1e-4) for pair in zip(table, other, strict=True))


@few(0.07)
@given(data=st.data())
def test_a_flipped_bit_changes_no_answer(data, known, tmp_path_factory):
    """Wherever it is: in an array, in a header, or in the head and the directory of the archive."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLIVR_GYM_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(table_files, "_memory", OrderedDict())
        path, (graph, table) = unpacked(known), known
        content = bytearray(path.read_bytes())
        heads = [one.start() for one in re.finditer(b"\x93NUMPY", content)]
        near = st.sampled_from(heads).flatmap(lambda i: st.integers(i - 60, i + 160))
        place = data.draw(st.one_of(st.integers(0, len(content) - 1), near), label="byte")
        place = min(max(place, 0), len(content) - 1)
        content[place] ^= 1 << data.draw(st.integers(0, 7), label="bit")
        altered(path, bytes(content))
        # What was noticed once is not taken for checked.
        assert is_refused(graph, path) == is_refused(graph, path)
        assert is_close(found(graph), table)


@few(0.07)
@given(data=st.data())
def test_a_cut_or_patched_file_changes_no_answer(data, known, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLIVR_GYM_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(table_files, "_memory", OrderedDict())
        path, (graph, table) = unpacked(known), known
        altered(path, data.draw(damaged(path.read_bytes())))
        assert is_close(found(graph), table)


def test_a_mapped_table_is_checked_once_and_again_when_its_time_differs(known, cache, monkeypatch):
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
